//! The sweep by kernels, level by level: which run, over which buffers, how large.

use crate::{
    Error, Mesh,
    build::{
        BuildTimes, Grown, MeshBuffers,
        retry::Stop,
        room::{Arena, Need, growth},
    },
    exec::{Buffer, Step},
};
use raykd_kernels::build::sweep::{
    CHEAPEST_BITS, LEVEL_WORDS, LISTS, OVER_CELLS, OVER_FACES, OVER_FRESH, OVER_RANKS, OVER_REFERENCES, ROWS,
    SORT_BITS, STATE_CELLS, STATE_DEPTH, STATE_FRESH, STATE_LEVEL, STATE_LISTS, STATE_NODES, STATE_REFS,
    STATE_STATUS, STATE_WORDS,
    advance::{ADVANCE, Level, record},
    blocks,
    carry::CARRY,
    cheapest::CHEAPEST,
    children::CHILDREN,
    classify::CLASSIFY,
    distribute::DISTRIBUTE,
    fresh_room,
    insert::INSERT,
    leaves::LEAVES,
    number::NUMBER,
    rank::RANK,
    sizes::SIZES,
    sort::SORT,
    start::START,
    total::TOTAL,
    weigh::WEIGH,
};
use raykd_shared::{BuildParams, Node, status};
use std::time::Instant;

/// Levels after which the host looks whether there are more.
const LOOK: usize = 16;

/// Builds the tree.
pub(in crate::build) fn build(
    arena: &mut Arena<'_>,
    mesh: &Mesh,
    on_device: &MeshBuffers,
    params: &BuildParams,
    profile: bool,
) -> Result<Grown, Stop> {
    let device = arena.device;
    let begin = Instant::now();
    let kept = arena.alloc("kept", mesh.kept().len() as u32, 4)?;
    device.write(&kept, 0, bytemuck::cast_slice(mesh.kept()))?;
    let upload = begin.elapsed();
    let attempt = Attempt::new(arena, params)?;
    let grown = attempt.run(arena, (on_device, &kept), profile)?;
    Ok(Grown { times: BuildTimes { upload, ..grown.times }, ..grown })
}

/// How many passes of `2^bits` to one it takes until `count` are one.
fn passes(count: u32, bits: u32) -> u32 {
    (32 - count.saturating_sub(1).leading_zeros()).div_ceil(bits)
}

/// One try: its buffers, in pairs where a level is made from the one above.
struct Attempt {
    given: BuildParams,
    params: Buffer,
    state: Buffer,
    levels: Vec<Buffer>,
    first_sorts: Vec<Buffer>,
    sorts: Vec<Buffer>,
    cheapest: Vec<Buffer>,
    refs: [Buffer; 2],
    cells: [Buffer; 2],
    faces: [Buffer; 2],
    fresh: [Buffer; 2],
    bests: Buffer,
    codes: Buffer,
    moved: Buffer,
    ranks: Buffer,
    totals: Buffer,
    tree: Buffer,
    sizes: Buffer,
    places: Buffer,
    listed: Buffer,
}

impl Attempt {
    /// Allocates, and writes the root.
    fn new(arena: &mut Arena<'_>, given: &BuildParams) -> Result<Self, Error> {
        let (device, room) = (arena.device, given.level_refs);
        let sorts = passes(given.references, SORT_BITS);
        let halvings = passes(given.references, CHEAPEST_BITS);
        let mut many = |name, count: u32, words| -> Result<Vec<Buffer>, Error> {
            (0..count).map(|_| arena.alloc(name, words, 4)).collect()
        };
        let levels = many("level", given.max_depth + 2, LEVEL_WORDS)?;
        let first_sorts = many("first sort pass", sorts, 2)?;
        let next_sorts = many("sort pass", sorts, 2)?;
        let cheapest = many("cheapest pass", halvings, 2)?;
        let mut pair = |name, count, stride| -> Result<[Buffer; 2], Error> {
            Ok([arena.alloc(name, count, stride)?, arena.alloc(name, count, stride)?])
        };
        let attempt = Self {
            given: *given,
            // The largest first: if they fit, no number of elements is too large for a word.
            faces: pair("faces", LISTS * room, 8)?,
            refs: pair("references", room, 32)?,
            cells: pair("cells", given.active, 48)?,
            fresh: pair("new faces", LISTS * fresh_room(room), 8)?,
            bests: arena.alloc("candidates", room, 16)?,
            codes: arena.alloc("codes", room, 4)?,
            moved: arena.alloc("moved", room, 4)?,
            ranks: arena.alloc("ranks", ROWS * (room + 1), 4)?,
            totals: arena.alloc("totals", ROWS * blocks(room), 8)?,
            tree: arena.alloc("tree", given.treelets, 8)?,
            sizes: arena.alloc("sizes", given.treelets, 8)?,
            places: arena.alloc("places", given.treelets, 16)?,
            listed: arena.alloc("listed", given.treelet_refs, 8)?,
            params: arena.alloc("params", 1, size_of::<BuildParams>() as u64)?,
            state: arena.alloc("state", STATE_WORDS, 4)?,
            levels,
            first_sorts,
            sorts: next_sorts,
            cheapest,
        };
        device.write(&attempt.params, 0, bytemuck::bytes_of(given))?;
        device.write(&attempt.state, 0, &[0; STATE_WORDS as usize * 4])?;
        let number = given.references;
        let mut words = [0u32; LEVEL_WORDS as usize];
        // The faces of all its references are new to the root.
        record(&mut words, Level { cells: 1, refs: number, fresh: number, lists: LISTS, ..Level::default() });
        device.write(&attempt.levels[0], 0, bytemuck::cast_slice(&words))?;
        let bits = |v: [f32; 3]| [v[0].to_bits(), v[1].to_bits(), v[2].to_bits(), 0];
        let mut root = [[0, number, 0, number], bits(given.lo), bits(given.hi)];
        root[2][3] = growth(number).to_bits();
        device.write(&attempt.cells[0], 0, bytemuck::cast_slice(&root))?;
        let tell = |passes: &[Buffer], bits: u32, room: u32| {
            let mut numbered = passes.iter().zip(0..);
            numbered.try_for_each(|(pass, i)| device.write(pass, 0, bytemuck::cast_slice(&[i * bits, room])))
        };
        tell(&attempt.first_sorts, SORT_BITS, room)?;
        tell(&attempt.sorts, SORT_BITS, fresh_room(room))?;
        tell(&attempt.cheapest, CHEAPEST_BITS, 0)?;
        Ok(attempt)
    }

    /// In which of two buffers a sort begins, to end in the first.
    fn unsorted(&self) -> usize {
        self.sorts.len() % 2
    }

    /// Sorts the faces that are new on a level.
    fn sort<'a>(
        &'a self,
        depth: usize,
        passes: &'a [Buffer],
        lists: &'a [Buffer; 2],
    ) -> impl Iterator<Item = Step<'a>> {
        let (level, refs, cells) = (&self.levels[depth], &self.refs[depth % 2], &self.cells[depth % 2]);
        passes.iter().zip(self.unsorted()..).map(move |(pass, i)| {
            let (from, to) = (&lists[i % 2], &lists[(i + 1) % 2]);
            Step::indirect(&SORT, level, OVER_FRESH, vec![&self.params, pass, level, refs, cells, from, to])
        })
    }

    /// Makes the root's lists.
    fn root<'a>(&'a self, mesh: &'a MeshBuffers, kept: &'a Buffer) -> Vec<Step<'a>> {
        let (level, refs, faces) = (&self.levels[0], &self.refs[0], &self.faces[self.unsorted()]);
        let buffers = vec![&self.params, &mesh.positions, &mesh.indices, kept, level, refs, faces];
        let start = Step::indirect(&START, level, OVER_REFERENCES, buffers);
        [start].into_iter().chain(self.sort(0, &self.first_sorts, &self.faces)).collect()
    }

    /// Makes the level below one.
    fn level<'a>(&'a self, mesh: &'a MeshBuffers, depth: usize, lists: bool) -> Vec<Step<'a>> {
        let (now, then) = (depth % 2, (depth + 1) % 2);
        let (level, next_level) = (&self.levels[depth], &self.levels[depth + 1]);
        let (refs, next_refs) = (&self.refs[now], &self.refs[then]);
        let (cells, next_cells) = (&self.cells[now], &self.cells[then]);
        let (faces, next_faces) = (&self.faces[now], &self.faces[then]);
        let Self { params, state, bests, codes, moved, ranks, totals, .. } = self;
        let (positions, indices, fresh) = (&mesh.positions, &mesh.indices, &self.fresh);
        let over = |kernel, entry, buffers| Step::indirect(kernel, level, entry, buffers);
        let mut steps = vec![over(&WEIGH, OVER_REFERENCES, vec![params, level, refs, cells, faces, bests])];
        // Without lists all cells are small.
        let most = if lists { self.given.references } else { self.given.small };
        for pass in self.cheapest.iter().take(passes(most, CHEAPEST_BITS) as usize) {
            steps.push(over(&CHEAPEST, OVER_REFERENCES, vec![pass, level, refs, cells, bests]));
        }
        steps.extend([
            over(
                &CLASSIFY,
                OVER_REFERENCES,
                vec![params, positions, indices, level, refs, cells, bests, codes],
            ),
            over(&RANK, OVER_RANKS, vec![params, level, codes, faces, ranks, totals]),
            Step::groups(&TOTAL, ROWS, vec![params, level, totals]),
            Step::groups(&ADVANCE, 1, vec![params, level, ranks, totals, next_level, state]),
            over(
                &CHILDREN,
                OVER_CELLS,
                vec![params, level, state, cells, bests, ranks, totals, next_cells, &self.tree],
            ),
            over(
                &DISTRIBUTE,
                OVER_REFERENCES,
                vec![
                    params,
                    positions,
                    indices,
                    level,
                    state,
                    refs,
                    cells,
                    bests,
                    codes,
                    ranks,
                    totals,
                    next_cells,
                    next_refs,
                    moved,
                    &fresh[self.unsorted()],
                    &self.listed,
                ],
            ),
        ]);
        if lists {
            steps.extend(self.sort(depth + 1, &self.sorts, fresh));
            let buffers = vec![
                params, level, state, refs, cells, codes, ranks, totals, next_cells, moved, &fresh[0], faces,
                next_faces,
            ];
            steps.push(over(&CARRY, OVER_FACES, buffers));
            let buffers = vec![
                params, cells, ranks, totals, next_level, next_refs, next_cells, &fresh[0], faces, next_faces,
            ];
            steps.push(Step::indirect(&INSERT, next_level, OVER_FRESH, buffers));
        }
        steps
    }

    /// Builds the tree.
    fn run(
        &self,
        arena: &mut Arena<'_>,
        (mesh, kept): (&MeshBuffers, &Buffer),
        profile: bool,
    ) -> Result<Grown, Stop> {
        let device = arena.device;
        let mut times = BuildTimes::default();
        let mut go = |steps: Vec<Step<'_>>| -> Result<(), Error> {
            let timing = device.dispatch(&steps, profile)?;
            times.add(&steps, &timing);
            Ok(())
        };
        let mut steps = self.root(mesh, kept);
        let number = self.given.max_depth as usize + 1;
        let (mut depth, mut lists) = (0, true);
        let state = loop {
            let end = (depth + LOOK).min(number);
            steps.extend((depth..end).flat_map(|depth| self.level(mesh, depth, lists)));
            go(std::mem::take(&mut steps))?;
            let words: Vec<u32> = device.read(&self.state, 0, STATE_WORDS as usize)?;
            let state = move |i: u32| words[i as usize];
            if state(STATE_STATUS) & status::CAPACITY != 0 {
                return Err(Stop::Needs(Need {
                    references: state(STATE_LEVEL),
                    fresh: state(STATE_FRESH),
                    cells: state(STATE_CELLS),
                    nodes: state(STATE_NODES),
                    listed: state(STATE_REFS),
                }));
            }
            if state(STATE_CELLS) == 0 {
                break state;
            }
            if end == number {
                return Err(Error::Kernel(status::describe(status::LEVELS)).into());
            }
            (depth, lists) = (end, state(STATE_LISTS) > 0);
        };
        // After the root comes padding.
        let (node_count, ref_count, depth) = (state(STATE_NODES) + 1, state(STATE_REFS), state(STATE_DEPTH));
        let nodes = arena.alloc("nodes", node_count, 8)?;
        let out = arena.alloc("refs", ref_count, 4)?;
        device.write(&nodes, 8, bytemuck::bytes_of(&Node::PADDING))?;
        let (tree, sizes, places) = (&self.tree, &self.sizes, &self.places);
        let levels = &self.levels[..=depth as usize];
        let size = |level| Step::indirect(&SIZES, level, OVER_CELLS, vec![level, tree, sizes]);
        let number =
            |level| Step::indirect(&NUMBER, level, OVER_CELLS, vec![level, tree, sizes, places, &nodes]);
        let mut steps: Vec<_> = levels.iter().rev().map(size).collect();
        steps.extend(levels.iter().map(number));
        steps.push(Step::over(&LEAVES, ref_count, vec![&self.state, &self.listed, tree, places, &out]));
        go(steps)?;
        Ok(Grown { nodes, refs: out, counts: [node_count, ref_count], depth, times })
    }
}
