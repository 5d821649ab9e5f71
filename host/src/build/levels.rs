//! The level loop: which kernels run, over which buffers.

use super::{
    built::{Given, Grown, KeptIn, Laid, MeshBuffers},
    header,
    options::BuildOptions,
    retry::Stop,
    room::{Arena, Room, growth, usual_levels},
    survey::{Root, Survey},
    times::BuildTimes,
};
use crate::{
    Error,
    clock::Instant,
    exec::{Buffer, Device, Launch, OnDevice, Step, Timed},
};
use raykd_kernels::{
    build::{
        ARGS_ACTIVE, ARGS_BLOCKS, ARGS_BRANCHES, ARGS_CHUNKS, ARGS_CORNERS, ARGS_EMIT, ARGS_TOP,
        ARGS_TREELET_BLOCKS, ARGS_TREELETS, ARGS_WORDS, Item, Level, Round, State, alloc, assign,
        bin::{self, HIST_WORDS, histograms},
        boxes,
        branch::{self, SHARE, branches},
        count, emit, join,
        marks::bits,
        place::{self, COPIERS},
        reference::Reference,
        scatter,
        survey::Found,
        tally::{self, BLOCK, blocks_of},
        to_bits, top,
        treelet::{self, scratch_base},
    },
    glam::{UVec2, UVec4, Vec3, Vec4},
    put_groups,
    trace::prepare::corners,
};
use raykd_shared::{
    BuildParams, Node, TreeHeader,
    limits::{BRANCH, TREELET, chunk},
    status,
};
use std::ops::Range;

/// The buffers of one try, in pairs where a level is made from the one above.
#[derive(Debug)]
struct Lists {
    given: BuildParams,
    mesh: MeshBuffers,
    params: Buffer<BuildParams>,
    param_words: Buffer<u32>,
    state: Buffer<u32>,
    levels: [Buffer<u32>; 2],
    args: [Buffer<u32>; 2],
    active: [Buffer<UVec4>; 2],
    chunks: [Buffer<u32>; 2],
    refs: [Buffer<UVec4>; 2],
    /// The triangles that take part. If the host has listed them, the memory of the second list of references, which
    /// is free until the first is moved.
    kept: Buffer<u32>,
    /// Of the nodes of a level, and of the next one: the memory of the list of treelets, of which there are none yet.
    hists: [Buffer<u32>; 2],
    /// What treelets keep: the memory of the first list of references, which is done with by then.
    scratch: Buffer<UVec2>,
    planes: Buffer<UVec2>,
    /// Which references of a chunk go where, and how many.
    bits: Buffer<UVec2>,
    sides: Buffer<UVec2>,
    targets: Buffer<UVec4>,
    /// How many references go below and above, and the same word by word.
    sizes: [Buffer<UVec2>; 2],
    size_words: [Buffer<u32>; 2],
    blocks: Buffer<u32>,
    top: Buffer<UVec2>,
    rounds: [Buffer<u32>; 2],
    branches: Buffer<UVec4>,
    /// What branches become: the memory of the second list, and their nodes: of the first.
    items: Buffer<UVec4>,
    item_nodes: Buffer<UVec2>,
    /// The memory of what treelets keep of their sizes and places.
    branch_sizes: Buffer<UVec4>,
    branch_places: Buffer<UVec4>,
    treelets: Buffer<UVec4>,
    /// References of branches and treelets.
    treelet_refs: Buffer<UVec4>,
    treelet_sizes: Buffer<UVec2>,
    treelet_blocks: Buffer<u32>,
    places: Buffer<UVec2>,
    header: Buffer<TreeHeader>,
    header_words: Buffer<u32>,
}

/// A tree, laid out for tracing.
#[derive(Debug)]
struct Tree {
    nodes: Buffer<UVec2>,
    refs: Buffer<u32>,
    corners: Buffer<Vec4>,
}

/// Levels more than the build before took: an empty one costs a tenth of what another look at the device does.
const SPARE: u32 = 2;

/// More levels, where nodes are left below those that were encoded.
const MORE: u32 = 12;

/// Rounds over branches, an even number: dragons need one, Sponza and small teapots two, large teapots three or four.
/// Where treelets are smaller, branches become more of them.
const fn usual_rounds(params: &BuildParams) -> u32 {
    if params.small < TREELET {
        12
    } else if params.references < SMALL {
        2
    } else {
        4
    }
}

/// References of meshes so small that two rounds more would be felt.
const SMALL: u32 = 1 << 16;

/// What a build notes for the next one, where memory is used again.
#[derive(Clone, Copy, Debug)]
struct Noted {
    /// Triangles of the mesh.
    triangles: u32,
    /// References of the root.
    references: u32,
    /// Levels of large nodes.
    levels: u32,
    /// Rounds over branches.
    rounds: u32,
    nodes: u32,
    refs: u32,
    /// Of its lists.
    room: Room,
}

impl Noted {
    fn of(device: &Device) -> Option<Self> {
        let [triangles, references, levels, rounds, nodes, refs, room @ ..] = device.past()?;
        Some(Self { triangles, references, levels, rounds, nodes, refs, room: Room::of_words(room) })
    }

    fn keep(self, device: &Device) {
        let Self { triangles, references, levels, rounds, nodes, refs, room } = self;
        let [a, b, c, d] = room.words();
        device.note(Some([triangles, references, levels, rounds, nodes, refs, a, b, c, d]));
    }

    /// Whether a tree over so many triangles may be expected to be as large as that one.
    const fn is_like(self, references: u32) -> bool {
        self.references.abs_diff(references) <= references / 8
    }
}

/// How many triangles of a mesh of so many may be expected to take part: as many as of the one before.
pub(super) fn expected(device: &Device, triangles: u32) -> Option<u32> {
    let alike = |noted: &Noted| noted.triangles == triangles && noted.references > 0;
    Noted::of(device).filter(alike).map(|noted| noted.references)
}

/// The room that the build before had, if a mesh is about as large as that one.
pub(super) fn room_before(device: &Device, references: u32) -> Option<Room> {
    Noted::of(device).filter(|noted| noted.is_like(references)).map(|noted| noted.room)
}

impl Tree {
    /// Room for a tree like the last one, or somewhat larger.
    fn expected(arena: &mut Arena<'_>, noted: Noted) -> Result<Self, Error> {
        Ok(Self {
            nodes: arena.at_least("nodes", noted.nodes.into())?,
            refs: arena.at_least("refs", noted.refs.into())?,
            corners: arena.at_least("corners", 3 * u64::from(noted.refs))?,
        })
    }

    /// For how many nodes and references there is room.
    fn room(&self) -> [u32; 2] {
        let refs = self.refs.elements().min(self.corners.elements() / 3);
        [self.nodes.elements(), refs].map(|elements| elements.try_into().unwrap_or(u32::MAX))
    }
}

/// Builds a tree by the level loop. With a survey, by which a mesh is `found`, its box is not known yet.
pub(super) fn build(
    arena: &mut Arena<'_>,
    from: &Given<'_>,
    params: &BuildParams,
    options: &BuildOptions,
    mut survey: Option<(&Survey, &mut Found)>,
) -> Result<Grown, Stop> {
    let (device, profile) = (arena.device, options.profile);
    let noted = Noted::of(device);
    let alike = noted.filter(|noted| noted.is_like(params.references) && !profile);
    // Without room for it, the tree is written once the lists are gone.
    let out = alike.and_then(|noted| Tree::expected(arena, noted).ok());
    let lists = Lists::new(arena, params, from)?;
    let begin = Instant::now();
    let without_size = header(&from.facts, options, [0; 2], 0);
    lists.write(device, &from.kept, &without_size, out.as_ref())?;
    let mut times = BuildTimes { upload: begin.elapsed(), ..BuildTimes::default() };
    let most = if lists.root_is_large() { params.max_depth + 1 } else { 0 };
    let mut looks = 0;
    let guess = noted.map_or(usual_levels(params), |noted| noted.levels + SPARE);
    let mut levels = 0..guess.min(most);
    let mut rounds = noted.map_or(usual_rounds(params), |noted| noted.rounds.next_multiple_of(2).max(2));
    let state = loop {
        let (mut state, mut steps) = ([State::default()], Vec::new());
        let mut back = vec![lists.state.back_from(0, &mut state)];
        if let Some((survey, found)) = survey.take() {
            steps.extend(survey.steps(lists.root()));
            back.push(survey.found.back_from(0, std::slice::from_mut(found)));
        }
        if looks == 0 {
            steps.push(lists.boxes());
        }
        steps.extend(lists.steps(levels.clone(), rounds, out.as_ref()));
        // The one look at the device, if these levels are enough: how large is the tree?
        let timing = device.dispatch_then(&steps, Timed::profiled(profile), &mut back)?;
        drop(back);
        times.add(&steps, &timing);
        let [state] = state;
        if state.status & status::CAPACITY != 0 {
            return Err(Stop::Room);
        }
        if state.status != 0 {
            return Err(Error::of_status(state.status).into());
        }
        if state.left == 0 {
            break state;
        }
        // Each look makes a level or two of what is left.
        looks += 1;
        if looks > params.max_depth + 1 {
            return Err(Error::of_status(status::LEVELS).into());
        }
        // Branches come once the levels are done.
        let more = if state.rounds > 0 { 0 } else { MORE };
        levels = levels.end..(levels.end + more).min(most);
        rounds = usual_rounds(params);
    };
    let State { nodes, refs, levels, rounds, depth, .. } = state;
    let BuildParams { triangles, references, level_refs, treelet_refs, active, treelets, .. } = *params;
    let room = Room { level_refs, treelet_refs, active, treelets };
    Noted { triangles, references, levels, rounds, nodes, refs, room }.keep(device);
    let (nodes, refs, corners) = match out {
        Some(tree) if state.is_written() => {
            (tree.nodes.first(nodes), tree.refs.first(refs), Some(tree.corners.first(3 * refs)))
        }
        // Given back before more is taken.
        out => {
            drop(out);
            let (nodes, refs) = (arena.alloc("nodes", nodes, 1)?, arena.alloc("refs", refs, 1)?);
            let (top, emit) = lists.writers(&nodes, &refs);
            let steps = [top.over(state.top), emit.groups(state.treelets)];
            times.add(&steps, &device.dispatch(&steps, profile)?);
            (nodes, refs, None)
        }
    };
    let laid = Laid { header: Some(lists.header), corners };
    Ok(Grown { nodes: nodes.view(), refs, counts: [state.nodes, state.refs], depth, times, laid })
}

impl Lists {
    fn new(arena: &mut Arena<'_>, given: &BuildParams, from: &Given<'_>) -> Result<Self, Error> {
        // First: if they fit, no number below is too large for a word.
        let treelet_refs = arena.alloc("treelet refs", given.treelet_refs, Reference::ELEMENTS)?;
        let words = histograms(given.level_refs) * HIST_WORDS;
        let hists: Buffer<u32> = arena.alloc("histograms", words.div_ceil(4), 4)?;
        let treelets: Buffer<UVec4> =
            arena.alloc("treelets", (given.treelets * Item::ELEMENTS).max(words.div_ceil(4)), 1)?;
        let sizes: [Buffer<UVec2>; 2] = arena.pair("sizes", given.active, 1)?;
        // What treelets and branches keep comes to lie there, too.
        let scratch = scratch_base(given.treelet_refs, given.treelets).div_ceil(2);
        let items = given.treelet_refs / SHARE * Item::ELEMENTS;
        let references = |others: u32| given.level_refs.max(others.div_ceil(Reference::ELEMENTS));
        let refs: [Buffer<UVec4>; 2] = [
            arena.alloc("level refs", references(scratch), Reference::ELEMENTS)?,
            arena.alloc("level refs", references(items), Reference::ELEMENTS)?,
        ];
        let header: Buffer<TreeHeader> = arena.alloc("header", 1, 1)?;
        let treelet_sizes: Buffer<UVec2> = arena.alloc("treelet sizes", given.treelets, 1)?;
        let places: Buffer<UVec2> = arena.alloc("treelet places", given.treelets, 1)?;
        let params = arena.upload("params", std::slice::from_ref(given))?;
        Ok(Self {
            given: *given,
            mesh: from.on_device.clone(),
            param_words: params.view(),
            params,
            state: arena.alloc::<State>("state", 1, 1)?.view(),
            levels: arena.pair::<Level>("level", 1, 1)?.map(|level| level.view()),
            args: arena.pair("args", 1, ARGS_WORDS)?,
            active: arena.pair("active", given.active, Item::ELEMENTS)?,
            chunks: arena.pair("chunks", given.active, 1)?,
            kept: match from.kept {
                KeptIn::Host(_) => refs[1].view(),
                KeptIn::Device(kept) => kept.clone(),
            },
            scratch: refs[0].view(),
            item_nodes: refs[0].view(),
            items: refs[1].view(),
            refs,
            hists: [hists, treelets.view()],
            planes: arena.alloc("planes", given.active, 1)?,
            bits: arena.alloc("bits", given.active, bits(given.references))?,
            sides: arena.alloc("sides", given.active, 1)?,
            targets: arena.alloc("targets", given.active, 1)?,
            size_words: [sizes[0].view(), sizes[1].view()],
            sizes,
            blocks: arena.alloc("blocks", blocks_of(given.active), tally::KINDS)?,
            top: arena.alloc("top", 2 * given.treelets, 1)?,
            rounds: arena.pair("round", 1, 1)?.map(|round: Buffer<Round>| round.view()),
            branches: arena.alloc("branches", branches(given.treelets), Item::ELEMENTS)?,
            branch_sizes: treelet_sizes.view(),
            branch_places: places.view(),
            treelets,
            treelet_refs,
            treelet_sizes,
            treelet_blocks: arena.alloc("treelet blocks", blocks_of(given.treelets), place::KINDS)?,
            places,
            header_words: header.view(),
            header,
        })
    }

    /// Whether the root is a node of the level loop, and not the only branch.
    const fn root_is_large(&self) -> bool {
        self.given.references > BRANCH
    }

    /// Writes what the kernels start from.
    fn write(
        &self,
        device: &Device,
        kept: &KeptIn<'_>,
        header: &TreeHeader,
        out: Option<&Tree>,
    ) -> Result<(), Error> {
        let given = &self.given;
        let [lo, hi] = [given.lo, given.hi].map(Vec3::from);
        let growth = growth(given.references).to_bits();
        let first = boxes::first(given.references, given.small);
        let root = [UVec4::new(0, first, given.references, 0), to_bits(lo, growth), to_bits(hi, 0)];
        // The root and the padding after it are the first two slots.
        let room = out.map_or([0; 2], Tree::room);
        let state = State { room, ..State::default() };
        device.write(&self.header, 0, std::slice::from_ref(header))?;
        device.write(&self.top.view(), 1, &[Node::PADDING])?;
        let (mut level, mut round) = (Level::default(), Round { blocks: [1; 3], ..Round::default() });
        let mut args = [0u32; ARGS_WORDS as usize];
        if self.root_is_large() {
            let pieces = given.references.div_ceil(chunk(given.references));
            level = Level { active: 1, chunks: pieces, refs: given.references, top: 2, ..level };
            for (entry, groups) in [(ARGS_ACTIVE, 1), (ARGS_BLOCKS, 1), (ARGS_CHUNKS, pieces)] {
                put_groups(&mut args, entry, groups);
            }
            device.write(&self.active[0], 0, &root)?;
            device.write(&self.chunks[0], 0, &vec![0; pieces as usize])?;
        } else {
            let room = first + given.references;
            round = Round { number: 1, top: 2, room, groups: [1; 3], ..round };
            device.write(&self.branches, 0, &root)?;
        }
        device.write(&self.rounds[0].view(), 0, &[round])?;
        device.write(&self.levels[0].view(), 0, &[level])?;
        device.write(&self.args[0], 0, &args)?;
        device.write(&self.treelet_blocks, 0, &vec![0; self.treelet_blocks.elements()])?;
        if let KeptIn::Host(mesh) = kept {
            device.write(&self.kept, 0, mesh.kept())?;
        }
        device.write(&self.state.view(), 0, &[state])
    }

    /// Where a survey writes what it finds of the root.
    fn root(&self) -> Root<'_> {
        let large = self.root_is_large();
        Root {
            params: &self.param_words,
            item: if large { &self.active[0] } else { &self.branches },
            header: &self.header_words,
            level: &self.levels[0],
            args: &self.args[0],
            round: &self.rounds[0],
            state: &self.state,
        }
    }

    /// Makes the references of the root.
    fn boxes(&self) -> Step<'_> {
        let Self { params, mesh, kept, .. } = self;
        let (positions, indices) = (&mesh.positions, &mesh.indices);
        let refs = if self.root_is_large() { &self.refs[0] } else { &self.treelet_refs };
        let (hists, sizes) = (self.hists[0].out(), self.size_words[0].out());
        let boxes = boxes::Buffers { params, positions, indices, kept, refs: refs.out(), hists, sizes };
        boxes.over(self.given.references.max(HIST_WORDS))
    }

    /// What there is to do on some levels, and in rounds over branches; then, if neither large nodes nor branches are
    /// left, before the size of the tree is known; and to write it, if that fits the room for it.
    fn steps<'b>(&'b self, levels: Range<u32>, rounds: u32, out: Option<&'b Tree>) -> Vec<Step<'b>> {
        let Self { params, state, mesh, .. } = self;
        let (positions, indices) = (&mesh.positions, &mesh.indices);
        let mut steps = Vec::new();
        for depth in levels.clone() {
            self.level(depth, &mut steps);
        }
        for round in 0..rounds {
            self.round(round, &mut steps);
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
            round: &self.rounds[0],
            sizes: &self.treelet_sizes,
            blocks: &self.treelet_blocks,
            places: self.places.out(),
            state: state.out(),
            header: self.header_words.out(),
        };
        steps.push(place.indirect(&self.rounds[0], ARGS_TREELET_BLOCKS));
        if let Some(Tree { nodes, refs, corners }) = out {
            let (top, emit) = self.writers(nodes, refs);
            let (header, corners) = (&self.header, corners.out());
            let corners = corners::Buffers { header, positions, indices, refs, corners };
            steps.extend([
                top.indirect(state, ARGS_TOP),
                emit.indirect(state, ARGS_EMIT),
                corners.indirect(state, ARGS_CORNERS),
            ]);
        }
        steps
    }

    /// Makes the level below one, and branches of its small nodes.
    fn level<'b>(&'b self, depth: u32, steps: &mut Vec<Step<'b>>) {
        let now = depth as usize % 2;
        let then = 1 - now;
        let Self { params, state, planes, bits, sides, targets, blocks, .. } = self;
        let sizes = &self.sizes[now];
        let (positions, indices) = (&self.mesh.positions, &self.mesh.indices);
        let (level, args) = (&self.levels[now], &self.args[now]);
        let (active, chunks, refs) = (&self.active[now], &self.chunks[now], &self.refs[now]);
        let (these_hists, next_hists) = (&self.hists[now], &self.hists[then]);
        let bin = bin::Buffers { params, level, active, chunks, refs, hists: these_hists.out() };
        let count = count::Buffers {
            params,
            positions,
            indices,
            level,
            active,
            chunks,
            hists: these_hists,
            refs: refs.out(),
            planes: planes.out(),
            bits: bits.out(),
            sides: sides.out(),
            sizes: self.size_words[now].out(),
            next_hists: next_hists.out(),
            next_sizes: self.size_words[then].out(),
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
            branches: self.branches.out(),
            round: self.rounds[0].out(),
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
            bits,
            sides,
            targets,
            next_level: &self.levels[then],
            next: self.refs[then].out(),
            branch_refs: self.treelet_refs.out(),
            hists: next_hists.out(),
        };
        if depth == 0 {
            steps.push(bin.indirect(args, ARGS_CHUNKS));
        }
        steps.push(count.indirect(args, ARGS_CHUNKS));
        // No more nodes than that are active here.
        if self.given.active.min(1 << depth.min(31)) > BLOCK {
            steps.push(tally.indirect(args, ARGS_BLOCKS));
        }
        steps.extend([alloc.indirect(args, ARGS_BLOCKS), scatter.indirect(args, ARGS_CHUNKS)]);
    }

    /// Makes treelets of branches, and what does not fit of them the branches of the next round.
    fn round<'b>(&'b self, number: u32, steps: &mut Vec<Step<'b>>) {
        let Self { params, state, branches, items, item_nodes, branch_sizes, branch_places, .. } = self;
        let (round, next) = (&self.rounds[number as usize % 2], &self.rounds[(number as usize + 1) % 2]);
        let branch = branch::Buffers {
            params,
            positions: &self.mesh.positions,
            indices: &self.mesh.indices,
            state,
            round,
            branches,
            refs: self.treelet_refs.out(),
            items: items.out(),
            nodes: item_nodes.out(),
            sizes: branch_sizes.out(),
        };
        let assign = assign::Buffers {
            params,
            round,
            sizes: branch_sizes,
            places: branch_places.out(),
            next: next.out(),
            state: state.out(),
        };
        let join = join::Buffers {
            params,
            round,
            state,
            sizes: branch_sizes,
            places: branch_places,
            items,
            nodes: item_nodes,
            branches: branches.out(),
            top: self.top.out(),
            treelets: self.treelets.out(),
            refs: self.treelet_refs.out(),
        };
        steps.extend([
            branch.indirect(round, ARGS_BRANCHES),
            assign.groups(1),
            join.indirect(round, ARGS_BRANCHES),
        ]);
    }

    /// What writes the tree out: the nodes above the treelets, and the treelets.
    fn writers<'b>(
        &'b self,
        nodes: &'b Buffer<UVec2>,
        refs: &'b Buffer<u32>,
    ) -> (top::Buffers<'b, OnDevice>, emit::Buffers<'b, OnDevice>) {
        let top = top::Buffers { state: &self.state, from: &self.top, nodes: nodes.out() };
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
        (top, emit)
    }
}

const _: () =
    assert!(top::TOP.threads == COPIERS && corners::CORNERS.threads == COPIERS, "as `place` counts");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        BuildOptions, Builder, Mesh,
        build::{
            built::Facts,
            retry::{Setting, Stop, Way},
        },
    };
    use raykd_shared::limits::MAX_TRIANGLES;

    #[test]
    fn lists_that_are_too_long_are_told() -> Result<(), Error> {
        let (device, mesh) = (Device::cpu(), Mesh::teapot(1));
        let given = Given::of(&device, &mesh)?;
        for kept in [180_000_000, MAX_TRIANGLES] {
            let from =
                Given { facts: Facts { kept, ..given.facts }, on_device: given.on_device.clone(), ..given };
            for &builder in Builder::ALL {
                let options = BuildOptions { builder, ..BuildOptions::default() };
                let params = Setting::first(&from, &options, Way::Levels).params();
                let lists = Lists::new(&mut Arena { device: &device, bytes: 0 }, &params, &from);
                assert!(matches!(lists, Err(Error::TooLarge { buffer: "treelet refs", .. })), "{builder}");
            }
        }
        Ok(())
    }

    /// Around one vertex a branch becomes more than its room holds.
    #[test]
    fn what_branches_leave_is_built_in_other_rounds() -> Result<(), Error> {
        let rim = |k: u16| {
            let (angle, tilt) = (f32::from(k) * 0.7, f32::from(k % 97) - 48.0);
            [40.0 * angle.cos(), 40.0 * angle.sin(), tilt]
        };
        let mut positions = vec![[0.0; 3]];
        positions.extend((0..6001).map(rim));
        let mesh = Mesh::new(positions, (1..6001).map(|k| [0, k, k + 1]).collect())?;
        let device = Device::cpu();
        let from = Given::of(&device, &mesh)?;
        let options = BuildOptions { profile: true, ..BuildOptions::default() };
        let mut setting = Setting::first(&from, &options, Way::Levels);
        let usual = usual_rounds(&setting.params());
        let (times, deepest) = loop {
            let mut arena = Arena { device: &device, bytes: 0 };
            match build(&mut arena, &from, &setting.params(), &options, None) {
                Ok(Grown { times, depth, .. }) => break (times, depth),
                Err(stop @ Stop::Room) => setting.change(stop)?,
                Err(stop) => panic!("{stop:?}"),
            }
        };
        let rounds =
            times.kernels.iter().find(|kernel| kernel.name == "join").map(|kernel| kernel.dispatches);
        assert!(rounds > Some(usual) && deepest > 20, "{rounds:?} rounds, depth {deepest}");
        Ok(())
    }
}
