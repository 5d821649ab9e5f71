//! The level loop: which kernels run, over which buffers.

use super::{
    built::{Given, Grown, KeptIn, MeshBuffers},
    options::BuildTimes,
    retry::Stop,
    room::{Arena, growth, usual_levels},
};
use crate::{
    Error,
    clock::Instant,
    exec::{Buffer, Device, Launch, Step},
};
use raykd_kernels::{
    build::{
        ARGS_ACTIVE, ARGS_BLOCKS, ARGS_CHUNKS, ARGS_SEVERAL_ACTIVE, ARGS_SEVERAL_CHUNKS, ARGS_TREELET_BLOCKS,
        ARGS_TREELETS, ARGS_WORDS, Item, Level, State,
        alloc::{self, put_groups},
        alone,
        bin::{self, HIST_WORDS},
        boxes, count, emit, place,
        reference::Reference,
        scatter, split,
        tally::{self, BLOCK, blocks_of},
        to_bits, top,
        treelet::{self, scratch_base},
    },
    glam::{UVec2, UVec4, Vec3},
};
use raykd_shared::{BuildParams, Node, limits::CHUNK, status};
use std::ops::Range;

/// The buffers of one try, in pairs where a level is made from the one above.
#[derive(Debug)]
struct Lists {
    given: BuildParams,
    mesh: MeshBuffers,
    params: Buffer<BuildParams>,
    state: Buffer<u32>,
    levels: [Buffer<u32>; 2],
    args: [Buffer<u32>; 2],
    active: [Buffer<UVec4>; 2],
    chunks: [Buffer<u32>; 2],
    refs: [Buffer<UVec4>; 2],
    /// The triangles that take part. If the host has listed them, the memory of the second list of references, which
    /// is free until the first is moved.
    kept: Buffer<u32>,
    hists: Buffer<u32>,
    /// What treelets keep: the memory of the histograms, which are done with by then.
    scratch: Buffer<UVec2>,
    planes: Buffer<UVec2>,
    sides: Buffer<UVec2>,
    targets: Buffer<UVec2>,
    /// How many references go below and above, and the same word by word.
    sizes: Buffer<UVec2>,
    size_words: Buffer<u32>,
    blocks: Buffer<u32>,
    top: Buffer<UVec2>,
    treelets: Buffer<UVec4>,
    treelet_refs: Buffer<UVec4>,
    treelet_sizes: Buffer<UVec2>,
    treelet_blocks: Buffer<u32>,
    places: Buffer<UVec2>,
}

/// Levels more than the build before took: an empty one costs a tenth of what another look at the device does.
const SPARE: u32 = 2;

/// More levels, where nodes are left below those that were encoded.
const MORE: u32 = 12;

/// Builds a tree by the level loop.
pub(super) fn build(
    arena: &mut Arena<'_>,
    from: &Given<'_>,
    params: &BuildParams,
    profile: bool,
) -> Result<Grown, Stop> {
    let device = arena.device;
    let lists = Lists::new(arena, params, from)?;
    let begin = Instant::now();
    lists.write(device, &from.kept)?;
    let mut times = BuildTimes { upload: begin.elapsed(), ..BuildTimes::default() };
    let most = if lists.root_is_large() { params.max_depth + 1 } else { 0 };
    let guess = device.levels_before().map_or(usual_levels(params.references), |before| before + SPARE);
    let mut levels = 0..guess.min(most);
    let state = loop {
        let steps = lists.steps(levels.clone());
        // The one look at the device, if these levels are enough: how large is the tree?
        let (timing, state): (_, State) = device.dispatch_and_read(&steps, profile, &lists.state.view())?;
        times.add(&steps, &timing);
        if state.status & status::CAPACITY != 0 {
            return Err(Stop::Room);
        }
        if state.status != 0 {
            return Err(Error::Kernel(status::describe(state.status)).into());
        }
        if state.left == 0 {
            break state;
        }
        if levels.end == most {
            return Err(Error::Kernel(status::describe(status::LEVELS)).into());
        }
        levels = levels.end..(levels.end + MORE).min(most);
    };
    device.note_levels(state.levels);
    let counts = [state.nodes, state.refs];
    let nodes = arena.alloc("nodes", counts[0], 1)?;
    let refs = arena.alloc("refs", counts[1], 1)?;
    let last = Last { lists, state };
    let grown = |last, times| Grown {
        nodes: nodes.view(),
        refs: refs.clone(),
        counts,
        depth: state.depth,
        times,
        last,
    };
    if device.recycles() && !profile {
        return Ok(grown(Some(last), times));
    }
    // The lists' memory is given back before more is taken.
    let steps = last.steps(&nodes, &refs);
    times.add(&steps, &device.dispatch(&steps, profile)?);
    Ok(grown(None, times))
}

/// What writes a tree out that has been found.
#[derive(Debug)]
pub(crate) struct Last {
    lists: Lists,
    state: State,
}

impl Last {
    /// To be run before anything else is done with the tree.
    pub(crate) fn steps<'a>(&'a self, nodes: &'a Buffer<UVec2>, refs: &'a Buffer<u32>) -> [Step<'a>; 2] {
        self.lists.last_steps(&self.state, nodes, refs)
    }
}

impl Lists {
    fn new(arena: &mut Arena<'_>, given: &BuildParams, from: &Given<'_>) -> Result<Self, Error> {
        let scratch = 2 * u64::from(scratch_base(given.treelet_refs, given.treelets));
        let words = (u64::from(given.active) * u64::from(HIST_WORDS)).max(scratch);
        let hists: Buffer<u32> = arena.alloc("histograms", words.div_ceil(4) as u32, 4)?;
        let sizes: Buffer<UVec2> = arena.alloc("sizes", given.active, 1)?;
        let refs: [Buffer<UVec4>; 2] = arena.pair("level refs", given.level_refs, Reference::ELEMENTS)?;
        Ok(Self {
            given: *given,
            mesh: from.on_device.clone(),
            params: arena.upload("params", std::slice::from_ref(given))?,
            state: arena.alloc::<State>("state", 1, 1)?.view(),
            levels: arena.pair::<Level>("level", 1, 1)?.map(|level| level.view()),
            args: arena.pair("args", 1, ARGS_WORDS)?,
            active: arena.pair("active", given.active, Item::ELEMENTS)?,
            chunks: arena.pair("chunks", given.active, 1)?,
            kept: match from.kept {
                KeptIn::Host(_) => refs[1].view(),
                KeptIn::Device(kept) => kept.clone(),
            },
            refs,
            scratch: hists.view(),
            hists,
            planes: arena.alloc("planes", given.active, 1)?,
            sides: arena.alloc("sides", given.active, 1)?,
            targets: arena.alloc("targets", given.active, 1)?,
            size_words: sizes.view(),
            sizes,
            blocks: arena.alloc("blocks", blocks_of(given.active), tally::KINDS)?,
            top: arena.alloc("top", 2 * given.treelets, 1)?,
            treelets: arena.alloc("treelets", given.treelets, Item::ELEMENTS)?,
            treelet_refs: arena.alloc("treelet refs", given.treelet_refs, Reference::ELEMENTS)?,
            treelet_sizes: arena.alloc("treelet sizes", given.treelets, 1)?,
            treelet_blocks: arena.alloc("treelet blocks", blocks_of(given.treelets), place::KINDS)?,
            places: arena.alloc("treelet places", given.treelets, 1)?,
        })
    }

    /// Whether the root is a node of the level loop, and not the only treelet.
    const fn root_is_large(&self) -> bool {
        self.given.references > self.given.small
    }

    /// Writes what the kernels start from.
    fn write(&self, device: &Device, kept: &KeptIn<'_>) -> Result<(), Error> {
        let given = &self.given;
        let [lo, hi] = [given.lo, given.hi].map(Vec3::from);
        let growth = growth(given.references).to_bits();
        let root = [UVec4::new(0, 0, given.references, 0), to_bits(lo, growth), to_bits(hi, 0)];
        // The root and the padding after it are the first two slots.
        let mut state = State { top: 2, ..State::default() };
        device.write(&self.top.view(), 1, &[Node::PADDING])?;
        let mut level = Level::default();
        let mut args = [0u32; ARGS_WORDS as usize];
        put_groups(&mut args, ARGS_TREELET_BLOCKS, 1);
        if self.root_is_large() {
            let pieces = given.references.div_ceil(CHUNK);
            level = Level { active: 1, chunks: pieces, refs: given.references, top: 2, ..level };
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
            device.write(&self.active[0], 0, &root)?;
            device.write(&self.chunks[0], 0, &vec![0; pieces as usize])?;
        } else {
            state = State { groups: [1; 3], treelets: 1, treelet_refs: given.references, ..state };
            device.write(&self.treelets, 0, &root)?;
        }
        device.write(&self.levels[0].view(), 0, &[level])?;
        device.write(&self.args[0], 0, &args)?;
        device.write(&self.treelet_blocks, 0, &vec![0; self.treelet_blocks.elements()])?;
        if let KeptIn::Host(mesh) = kept {
            device.write(&self.kept, 0, mesh.kept())?;
        }
        device.write(&self.state.view(), 0, &[state])
    }

    /// What there is to do on some levels, and then, if no large node is left, before the size of the tree is known.
    fn steps(&self, levels: Range<u32>) -> Vec<Step<'_>> {
        let Self { params, state, mesh, kept, .. } = self;
        let (positions, indices) = (&mesh.positions, &mesh.indices);
        let mut steps = Vec::new();
        if levels.start == 0 {
            let refs = if self.root_is_large() { &self.refs[0] } else { &self.treelet_refs };
            let boxes = boxes::Buffers { params, positions, indices, kept, refs: refs.out() };
            steps.push(boxes.over(self.given.references));
        }
        for depth in levels.clone() {
            self.level(depth, &mut steps);
        }
        let treelets = treelet::Buffers {
            params,
            positions,
            indices,
            state,
            treelets: &self.treelets,
            refs: &self.treelet_refs,
            scratch: self.scratch.out(),
            sizes: self.treelet_sizes.out(),
            blocks: self.treelet_blocks.out(),
        };
        steps.push(treelets.indirect(state, ARGS_TREELETS));
        let last = levels.end as usize % 2;
        let place = place::Buffers {
            level: &self.levels[last],
            sizes: &self.treelet_sizes,
            blocks: &self.treelet_blocks,
            places: self.places.out(),
            state: state.out(),
        };
        steps.push(place.indirect(&self.args[last], ARGS_TREELET_BLOCKS));
        steps
    }

    /// Makes the level below one, and treelets of its small nodes.
    fn level<'b>(&'b self, depth: u32, steps: &mut Vec<Step<'b>>) {
        let now = depth as usize % 2;
        let then = 1 - now;
        let Self { params, state, hists, planes, sides, targets, sizes, size_words, blocks, .. } = self;
        let (positions, indices) = (&self.mesh.positions, &self.mesh.indices);
        let (level, args) = (&self.levels[now], &self.args[now]);
        let (active, chunks, refs) = (&self.active[now], &self.chunks[now], &self.refs[now]);
        let alone = alone::Buffers {
            params,
            positions,
            indices,
            level,
            active,
            refs: refs.out(),
            planes: planes.out(),
            sizes: size_words.out(),
            hists: hists.out(),
            sides: sides.out(),
        };
        let bin = bin::Buffers { level, active, chunks, refs, hists: hists.out() };
        let split = split::Buffers { params, level, active, hists, planes: planes.out() };
        let count = count::Buffers {
            params,
            positions,
            indices,
            level,
            active,
            chunks,
            refs: refs.out(),
            planes,
            sides: sides.out(),
            sizes: size_words.out(),
        };
        let tally = tally::Buffers { params, level, planes, sizes, blocks: blocks.out() };
        let alloc = alloc::Buffers {
            params,
            level,
            active,
            planes,
            sizes,
            blocks,
            targets: targets.out(),
            top: self.top.out(),
            next_level: self.levels[then].out(),
            next_active: self.active[then].out(),
            next_chunks: self.chunks[then].out(),
            next_args: self.args[then].out(),
            treelets: self.treelets.out(),
            state: state.out(),
        };
        let scatter = scatter::Buffers {
            params,
            positions,
            indices,
            level,
            active,
            chunks,
            refs,
            planes,
            sides,
            targets,
            state,
            next: self.refs[then].out(),
            treelet_refs: self.treelet_refs.out(),
        };
        steps.push(alone.indirect(args, ARGS_ACTIVE));
        if depth < self.given.alone {
            steps.extend([
                bin.indirect(args, ARGS_SEVERAL_CHUNKS),
                split.indirect(args, ARGS_SEVERAL_ACTIVE),
                count.indirect(args, ARGS_SEVERAL_CHUNKS),
            ]);
        }
        // No more nodes than that are active here.
        if self.given.active.min(1 << depth.min(31)) > BLOCK {
            steps.push(tally.indirect(args, ARGS_BLOCKS));
        }
        steps.extend([alloc.indirect(args, ARGS_BLOCKS), scatter.indirect(args, ARGS_CHUNKS)]);
    }

    /// Writes the tree out.
    fn last_steps<'b>(
        &'b self,
        state: &State,
        nodes: &'b Buffer<UVec2>,
        refs: &'b Buffer<u32>,
    ) -> [Step<'b>; 2] {
        let emit = emit::Buffers {
            state: &self.state,
            treelets: &self.treelets,
            refs: &self.treelet_refs,
            scratch: &self.scratch,
            sizes: &self.treelet_sizes,
            places: &self.places,
            nodes: nodes.out(),
            out: refs.out(),
        };
        let nodes = top::Buffers { state: &self.state, from: &self.top, nodes: nodes.out() };
        [nodes.over(state.top), emit.groups(state.treelets)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        BuildOptions, Mesh,
        build::{
            options::Builder,
            retry::{Setting, Stop, Way},
        },
    };

    /// Whether one workgroup or several go over the chunks of a node, the tree is the same.
    #[test]
    fn chunks_are_counted_alone_or_together() -> Result<(), Error> {
        // All around one vertex: large nodes on many levels.
        let rim = |k: u16| {
            let (angle, tilt) = (f32::from(k) * 0.7, f32::from(k % 97) - 48.0);
            [40.0 * angle.cos(), 40.0 * angle.sin(), tilt]
        };
        let mut positions = vec![[0.0; 3]];
        positions.extend((0..6001).map(rim));
        let mesh = Mesh::new(positions, (1..6001).map(|k| [0, k, k + 1]).collect())?;
        let device = Device::cpu();
        let from = Given::of(&device, &mesh)?;
        for (builder, clip) in [(Builder::Binned, true), (Builder::Binned, false), (Builder::Median, true)] {
            let options = BuildOptions::default().with_builder(builder).with_clip(clip);
            let mut setting = Setting::first(&from, &options, Way::Levels);
            let trees = [u32::MAX, 0, 2, 5].map(|alone| {
                loop {
                    let params = BuildParams { alone, ..setting.params() };
                    let mut arena = Arena { device: &device, bytes: 0 };
                    match build(&mut arena, &from, &params, false) {
                        Ok(Grown { nodes, refs, counts, .. }) => {
                            let [nodes, refs] = [nodes.view::<u32>(), refs.view()];
                            break (
                                device.read(&nodes, 0, 2 * counts[0] as usize),
                                device.read(&refs, 0, counts[1] as usize),
                            );
                        }
                        Err(stop @ Stop::Room) => setting.change(stop).expect("more room"),
                        Err(stop) => panic!("{stop:?}"),
                    }
                }
            });
            let [several, rest @ ..] =
                trees.map(|(nodes, refs)| (nodes.expect("nodes"), refs.expect("refs")));
            assert!(rest.iter().all(|tree| *tree == several), "{builder}, clip {clip}");
        }
        Ok(())
    }
}
