//! The level loop: which kernels run, over which buffers.

use super::{
    BuildTimes, Grown, MeshBuffers,
    retry::Stop,
    room::{Arena, growth},
};
use crate::{
    Error,
    exec::{Buffer, Device, Step},
    mesh::Mesh,
};
use raykd_kernels::build::{
    ARGS_ACTIVE, ARGS_BLOCKS, ARGS_CHUNKS, ARGS_SEVERAL_ACTIVE, ARGS_SEVERAL_CHUNKS, ARGS_TREELET_BLOCKS,
    ARGS_TREELETS, ARGS_WORDS, LEVEL_WORDS, STATE_DEPTH, STATE_LEFT, STATE_NODES, STATE_REFS, STATE_STATUS,
    STATE_TOP, STATE_TREELET_REFS, STATE_TREELETS, STATE_WORDS,
    alloc::{ALLOC, put_groups},
    alone::ALONE,
    bin::{BIN, HIST_WORDS},
    boxes::BOXES,
    count::COUNT,
    emit::EMIT,
    place::{self, PLACE},
    scatter::SCATTER,
    split::SPLIT,
    tally::{self, BLOCK, TALLY, blocks_of},
    top::TOP,
    treelet::{TREELETS, scratch_base},
};
use raykd_shared::{BuildParams, Node, limits::CHUNK, status};
use std::time::Instant;

/// The buffers of one try, in pairs where a level is made from the one above.
struct Lists<'a> {
    given: &'a BuildParams,
    mesh: &'a MeshBuffers,
    params: Buffer,
    state: Buffer,
    levels: [Buffer; 2],
    args: [Buffer; 2],
    active: [Buffer; 2],
    chunks: [Buffer; 2],
    refs: [Buffer; 2],
    /// Histograms; once these are done with, what treelets keep.
    scratch: Buffer,
    planes: Buffer,
    sides: Buffer,
    targets: Buffer,
    sizes: Buffer,
    blocks: Buffer,
    top: Buffer,
    treelets: Buffer,
    treelet_refs: Buffer,
    treelet_sizes: Buffer,
    treelet_blocks: Buffer,
    places: Buffer,
}

/// Builds a tree with so many levels above its treelets at most.
pub(super) fn build(
    arena: &mut Arena<'_>,
    mesh: &Mesh,
    on_device: &MeshBuffers,
    params: &BuildParams,
    levels: u32,
    profile: bool,
) -> Result<Grown, Stop> {
    let device = arena.device;
    let lists = Lists::new(arena, params, on_device)?;
    let begin = Instant::now();
    lists.write(device, mesh)?;
    let mut times = BuildTimes { upload: begin.elapsed(), ..BuildTimes::default() };
    let levels = if lists.root_is_large() { levels.min(params.max_depth + 1) } else { 0 };
    let steps = lists.steps(levels as usize);
    times.add(&steps, &device.dispatch(&steps, profile)?);

    // The one look at the device: how large is the tree?
    let words: Vec<u32> = device.read(&lists.state, 0, STATE_WORDS as usize)?;
    let state = |i: u32| words[i as usize];
    if state(STATE_STATUS) & status::CAPACITY != 0 {
        return Err(Stop::Room);
    }
    if state(STATE_STATUS) != 0 {
        return Err(Error::Kernel(status::describe(state(STATE_STATUS))).into());
    }
    if state(STATE_LEFT) != 0 {
        return Err(Stop::Levels);
    }
    let counts = [state(STATE_NODES), state(STATE_REFS)];
    let nodes = arena.alloc("nodes", counts[0], 8)?;
    let refs = arena.alloc("refs", counts[1], 4)?;
    let steps = lists.last_steps(state(STATE_TOP), state(STATE_TREELETS), &nodes, &refs);
    times.add(&steps, &device.dispatch(&steps, profile)?);
    Ok(Grown { nodes, refs, counts, depth: state(STATE_DEPTH), times })
}

impl<'a> Lists<'a> {
    fn new(arena: &mut Arena<'_>, given: &'a BuildParams, mesh: &'a MeshBuffers) -> Result<Self, Error> {
        let words = (u64::from(given.active) * u64::from(HIST_WORDS))
            .max(2 * u64::from(scratch_base(given.treelet_refs, given.treelets)));
        Ok(Self {
            given,
            mesh,
            params: arena.alloc("params", 1, size_of::<BuildParams>() as u64)?,
            state: arena.alloc("state", STATE_WORDS, 4)?,
            levels: arena.pair("level", LEVEL_WORDS, 4)?,
            args: arena.pair("args", ARGS_WORDS, 4)?,
            active: arena.pair("active", given.active, 48)?,
            chunks: arena.pair("chunks", given.active, 4)?,
            refs: arena.pair("level refs", given.level_refs, 32)?,
            scratch: arena.alloc("histograms", words.div_ceil(4) as u32, 16)?,
            planes: arena.alloc("planes", given.active, 8)?,
            sides: arena.alloc("sides", given.active, 8)?,
            targets: arena.alloc("targets", given.active, 8)?,
            sizes: arena.alloc("sizes", given.active, 8)?,
            blocks: arena.alloc("blocks", blocks_of(given.active), u64::from(tally::KINDS) * 4)?,
            top: arena.alloc("top", 2 * given.treelets, 8)?,
            treelets: arena.alloc("treelets", given.treelets, 48)?,
            treelet_refs: arena.alloc("treelet refs", given.treelet_refs, 32)?,
            treelet_sizes: arena.alloc("treelet sizes", given.treelets, 8)?,
            treelet_blocks: arena.alloc(
                "treelet blocks",
                blocks_of(given.treelets),
                u64::from(place::KINDS) * 4,
            )?,
            places: arena.alloc("treelet places", given.treelets, 8)?,
        })
    }

    /// Whether the root is a node of the level loop, and not the only treelet.
    const fn root_is_large(&self) -> bool {
        self.given.references > self.given.small
    }

    /// The list of triangles that take part. It is the second list of references, which is free until the first is moved.
    const fn kept(&self) -> &Buffer {
        &self.refs[1]
    }

    /// Writes what the kernels start from.
    fn write(&self, device: &Device, mesh: &Mesh) -> Result<(), Error> {
        let given = self.given;
        device.write(&self.params, 0, bytemuck::bytes_of(given))?;
        let bits = |v: [f32; 3], last: u32| [v[0].to_bits(), v[1].to_bits(), v[2].to_bits(), last];
        let growth = growth(given.references).to_bits();
        let root = [[0, 0, given.references, 0], bits(given.lo, growth), bits(given.hi, 0)];
        let mut state = [0u32; STATE_WORDS as usize];
        // The root and the padding after it are the first two slots.
        state[STATE_TOP as usize] = 2;
        device.write(&self.top, 8, bytemuck::bytes_of(&Node::PADDING))?;
        let mut level = [0u32; LEVEL_WORDS as usize];
        let mut args = [0u32; ARGS_WORDS as usize];
        put_groups(&mut args, ARGS_TREELET_BLOCKS, 1);
        if self.root_is_large() {
            let pieces = given.references.div_ceil(CHUNK);
            level = [1, pieces, given.references, 0, 2, 0, 0];
            let several = if pieces > 1 { pieces } else { 0 };
            for (entry, groups) in [
                (ARGS_ACTIVE, 1),
                (ARGS_BLOCKS, 1),
                (ARGS_CHUNKS, pieces),
                (ARGS_SEVERAL_ACTIVE, several.min(1)),
                (ARGS_SEVERAL_CHUNKS, several),
            ] {
                put_groups(&mut args, entry, groups);
            }
            device.write(&self.active[0], 0, bytemuck::cast_slice(&root))?;
            device.write(&self.chunks[0], 0, bytemuck::cast_slice(&vec![0u32; pieces as usize]))?;
        } else {
            state[3 * ARGS_TREELETS as usize..].copy_from_slice(&[1, 1, 1]);
            state[STATE_TREELETS as usize] = 1;
            state[STATE_TREELET_REFS as usize] = given.references;
            device.write(&self.treelets, 0, bytemuck::cast_slice(&root))?;
        }
        device.write(&self.levels[0], 0, bytemuck::cast_slice(&level))?;
        device.write(&self.args[0], 0, bytemuck::cast_slice(&args))?;
        device.write(&self.treelet_blocks, 0, &vec![0; self.treelet_blocks.bytes() as usize])?;
        device.write(self.kept(), 0, bytemuck::cast_slice(mesh.kept()))?;
        device.write(&self.state, 0, bytemuck::cast_slice(&state))
    }

    /// All there is to do before the size of the tree is known.
    fn steps(&self, levels: usize) -> Vec<Step<'_>> {
        let Self { params, state, mesh, .. } = self;
        let (positions, indices) = (&mesh.positions, &mesh.indices);
        let whole = if self.root_is_large() { &self.refs[0] } else { &self.treelet_refs };
        let buffers = vec![params, positions, indices, self.kept(), whole];
        let mut steps = vec![Step::over(&BOXES, self.given.references, buffers)];
        for depth in 0..levels {
            self.level(depth, &mut steps);
        }
        let buffers = vec![
            params,
            positions,
            indices,
            state,
            &self.treelets,
            &self.treelet_refs,
            &self.scratch,
            &self.treelet_sizes,
            &self.treelet_blocks,
        ];
        steps.push(Step::indirect(&TREELETS, state, ARGS_TREELETS, buffers));
        let last = levels % 2;
        let buffers =
            vec![&self.levels[last], &self.treelet_sizes, &self.treelet_blocks, &self.places, state];
        steps.push(Step::indirect(&PLACE, &self.args[last], ARGS_TREELET_BLOCKS, buffers));
        steps
    }

    /// Makes the level below one, and treelets of its small nodes.
    fn level<'b>(&'b self, depth: usize, steps: &mut Vec<Step<'b>>) {
        let (now, then) = (depth % 2, (depth + 1) % 2);
        let Self { params, state, mesh, scratch, planes, sides, targets, sizes, blocks, .. } = self;
        let (level, args) = (&self.levels[now], &self.args[now]);
        let (active, chunks, refs) = (&self.active[now], &self.chunks[now], &self.refs[now]);
        // What those bind that clip references.
        let clipping = [params, &mesh.positions, &mesh.indices, level, active];
        let of_chunks = [&clipping[..], &[chunks, refs, planes, sides]].concat();
        let buffers = [&clipping[..], &[refs, planes, sizes, scratch]].concat();
        steps.push(Step::indirect(&ALONE, args, ARGS_ACTIVE, buffers));
        let buffers = vec![level, active, chunks, refs, scratch];
        steps.push(Step::indirect(&BIN, args, ARGS_SEVERAL_CHUNKS, buffers));
        let buffers = vec![params, level, active, scratch, planes];
        steps.push(Step::indirect(&SPLIT, args, ARGS_SEVERAL_ACTIVE, buffers));
        let buffers = [&of_chunks[..], &[sizes]].concat();
        steps.push(Step::indirect(&COUNT, args, ARGS_SEVERAL_CHUNKS, buffers));
        // No more nodes than that are active here.
        if self.given.active.min(1 << depth.min(31)) > BLOCK {
            let buffers = vec![params, level, planes, sizes, blocks];
            steps.push(Step::indirect(&TALLY, args, ARGS_BLOCKS, buffers));
        }
        let buffers = vec![
            params,
            level,
            active,
            planes,
            sizes,
            blocks,
            targets,
            &self.top,
            &self.levels[then],
            &self.active[then],
            &self.chunks[then],
            &self.args[then],
            &self.treelets,
            state,
        ];
        steps.push(Step::indirect(&ALLOC, args, ARGS_BLOCKS, buffers));
        let buffers = [&of_chunks[..], &[targets, state, &self.refs[then], &self.treelet_refs]].concat();
        steps.push(Step::indirect(&SCATTER, args, ARGS_CHUNKS, buffers));
    }

    /// Writes the tree out.
    fn last_steps<'b>(
        &'b self,
        top: u32,
        treelets: u32,
        nodes: &'b Buffer,
        refs: &'b Buffer,
    ) -> [Step<'b>; 2] {
        let buffers = vec![
            &self.state,
            &self.treelets,
            &self.treelet_refs,
            &self.scratch,
            &self.treelet_sizes,
            &self.places,
            nodes,
            refs,
        ];
        [Step::over(&TOP, top, vec![&self.state, &self.top, nodes]), Step::groups(&EMIT, treelets, buffers)]
    }
}
