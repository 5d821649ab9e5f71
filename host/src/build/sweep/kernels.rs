//! The sweep by kernels, level by level: which run, over which buffers, how large.

use crate::{
    Error,
    build::{
        built::{Given, Grown, KeptIn, Laid, MeshBuffers},
        radix::{Radix, UNSORTED},
        retry::Stop,
        room::{Arena, Need, growth},
        times::BuildTimes,
    },
    clock::Instant,
    exec::{Buffer, Launch, Step},
};
use raykd_kernels::{
    build::{
        reference::Reference,
        sweep::{
            CHEAPEST_BITS, Cell, LEVEL_WORDS, LISTS, OVER_BLOCKS, OVER_CELLS, OVER_FACES, OVER_FRESH,
            OVER_RANKS, OVER_REFERENCES, OVER_SAMPLES, ROWS, SORT_BITS, State,
            advance::{self, Level, record},
            blocks, carry, cheapest, children, classify, distribute, fresh_room, insert, leaves, number,
            rank, sample, sizes, sort, start, total, weigh,
        },
        to_bits,
    },
    glam::{UVec2, UVec4, Vec3},
};
use raykd_shared::{BuildParams, Node, status};
use std::iter;

/// Levels after which the host looks first whether there are more: most trees need a few more.
fn first_levels(references: u32) -> usize {
    2 + 3 * references.ilog2() as usize / 2
}

/// Levels from one look to the next.
const LOOK: usize = 4;

/// Builds the tree.
pub(in crate::build) fn build(
    arena: &mut Arena<'_>,
    from: &Given<'_>,
    params: &BuildParams,
    profile: bool,
) -> Result<Grown, Stop> {
    let begin = Instant::now();
    let kept = match from.kept {
        KeptIn::Host(mesh) => arena.upload("kept", mesh.kept())?,
        KeptIn::Device(kept) => kept.clone(),
    };
    let upload = begin.elapsed();
    let grown = Lists::new(arena, params, &from.on_device, kept)?.run(arena, profile)?;
    Ok(Grown { times: BuildTimes { upload, ..grown.times }, ..grown })
}

/// How many passes of `2^bits` to one it takes until `count` are one.
fn passes(count: u32, bits: u32) -> u32 {
    (32 - count.saturating_sub(1).leading_zeros()).div_ceil(bits)
}

/// Into how many blocks of [`weigh`] so many references of a cell reach at most.
const fn blocks_of(count: u32) -> u32 {
    count.div_ceil(weigh::LANES) + 1
}

/// The buffers of one try, in pairs where a level is made from the one above.
struct Lists<'a> {
    given: &'a BuildParams,
    mesh: &'a MeshBuffers,
    kept: Buffer<u32>,
    params: Buffer<BuildParams>,
    state: Buffer<u32>,
    levels: Vec<Buffer<u32>>,
    radix: Radix,
    sorts: Vec<Buffer<UVec2>>,
    cheapest: Vec<Buffer<UVec2>>,
    refs: [Buffer<UVec4>; 2],
    cells: [Buffer<UVec4>; 2],
    faces: [Buffer<UVec2>; 2],
    fresh: [Buffer<UVec2>; 2],
    bounds: Buffer<u32>,
    bests: Buffer<UVec4>,
    codes: Buffer<u32>,
    moved: Buffer<u32>,
    ranks: Buffer<u32>,
    totals: Buffer<UVec2>,
    tree: Buffer<UVec2>,
    sizes: Buffer<UVec2>,
    places: Buffer<UVec4>,
    listed: Buffer<UVec2>,
}

impl<'a> Lists<'a> {
    /// Allocates, and writes the root.
    fn new(
        arena: &mut Arena<'_>,
        given: &'a BuildParams,
        mesh: &'a MeshBuffers,
        kept: Buffer<u32>,
    ) -> Result<Self, Error> {
        let (device, room, references) = (arena.device, given.level_refs, given.references);
        let mut told = |name, number: u32, bits: u32, room: u32| -> Result<Vec<Buffer<UVec2>>, Error> {
            (0..number).map(|i| arena.upload(name, &[UVec2::new(i * bits, room)])).collect()
        };
        let sorts = told("sort pass", passes(references, SORT_BITS), SORT_BITS, fresh_room(room))?;
        let cheapest = told("cheapest pass", passes(blocks_of(references), CHEAPEST_BITS), CHEAPEST_BITS, 0)?;
        let levels = (0..given.max_depth + 2).map(|_| arena.alloc("level", 1, LEVEL_WORDS));
        let lists = Self {
            levels: levels.collect::<Result<_, _>>()?,
            given,
            mesh,
            kept,
            // The largest first: if they fit, no number of elements is too large for a word.
            faces: arena.pair("faces", room, LISTS)?,
            refs: arena.pair("references", room, Reference::ELEMENTS)?,
            cells: arena.pair("cells", given.active, Cell::ELEMENTS)?,
            fresh: arena.pair("new faces", fresh_room(room), LISTS)?,
            bounds: arena.alloc("bounds", given.active, 1)?,
            bests: arena.alloc("candidates", room, 1)?,
            codes: arena.alloc("codes", room, 1)?,
            moved: arena.alloc("moved", room, 1)?,
            ranks: arena.alloc("ranks", room + 1, ROWS)?,
            totals: arena.alloc("totals", blocks(room), ROWS)?,
            tree: arena.alloc("tree", given.treelets, 1)?,
            sizes: arena.alloc("sizes", given.treelets, 1)?,
            places: arena.alloc("places", given.treelets, 1)?,
            listed: arena.alloc("listed", given.treelet_refs, 1)?,
            params: arena.upload("params", std::slice::from_ref(given))?,
            state: arena.upload("state", &[State::default()])?.view(),
            radix: Radix::new(arena, LISTS, references, room)?,
            sorts,
            cheapest,
        };
        let mut words = [0u32; LEVEL_WORDS as usize];
        // The faces of all its references are new to the root.
        let root = Level { cells: 1, refs: references, fresh: references, lists: LISTS, ..Level::default() };
        record(&mut words, root);
        device.write(&lists.levels[0], 0, &words)?;
        device.write(&lists.bounds, 0, &[children::NO_BOUND])?;
        let [lo, hi] = [given.lo, given.hi].map(Vec3::from);
        let head = UVec4::new(0, references, 0, references);
        let growth = growth(references).to_bits();
        device.write(&lists.cells[0], 0, &[head, to_bits(lo, 0), to_bits(hi, growth)])?;
        Ok(lists)
    }

    /// In which of two buffers a sort begins, to end in the first.
    fn unsorted(&self) -> usize {
        self.sorts.len() % 2
    }

    /// Sorts the faces that are new on a level.
    fn sort(&self, depth: usize) -> impl Iterator<Item = Step<'_>> {
        let (level, refs, cells) = (&self.levels[depth], &self.refs[depth % 2], &self.cells[depth % 2]);
        self.sorts.iter().zip(self.unsorted()..).map(move |(pass, i)| {
            let (from, to) = (&self.fresh[i % 2], self.fresh[(i + 1) % 2].out());
            let sort = sort::Buffers { params: &self.params, pass, level, refs, cells, from, to };
            sort.indirect(level, OVER_FRESH)
        })
    }

    /// Makes the root's lists.
    fn root(&self) -> Vec<Step<'_>> {
        let level = &self.levels[0];
        let start = start::Buffers {
            params: &self.params,
            positions: &self.mesh.positions,
            indices: &self.mesh.indices,
            kept: &self.kept,
            level,
            refs: self.refs[0].out(),
            faces: self.faces[UNSORTED].out(),
        };
        iter::once(start.indirect(level, OVER_REFERENCES)).chain(self.radix.steps(&self.faces)).collect()
    }

    /// Finds where the cells of a level are cut.
    fn choose<'b>(&'b self, depth: usize, lists: bool, steps: &mut Vec<Step<'b>>) {
        let Self { params, bounds, bests, mesh: MeshBuffers { positions, indices, .. }, .. } = self;
        let (level, refs, cells) = (&self.levels[depth], &self.refs[depth % 2], &self.cells[depth % 2]);
        let faces = &self.faces[depth % 2];
        if lists {
            let sample = sample::Buffers { params, level, refs, cells, faces, bounds: bounds.out() };
            steps.push(sample.indirect(level, OVER_SAMPLES));
        }
        let weigh = weigh::Buffers { params, level, refs, cells, faces, bounds, bests: bests.out() };
        steps.push(weigh.indirect(level, OVER_REFERENCES));
        // Without lists all cells are small.
        let most = if lists { self.given.references } else { self.given.small };
        for pass in self.cheapest.iter().take(passes(blocks_of(most), CHEAPEST_BITS) as usize) {
            let cheapest = cheapest::Buffers { pass, level, refs, cells, bests: bests.out() };
            steps.push(cheapest.indirect(level, OVER_BLOCKS));
        }
        let codes = self.codes.out();
        let classify = classify::Buffers { params, positions, indices, level, refs, cells, bests, codes };
        steps.push(classify.indirect(level, OVER_REFERENCES));
    }

    /// Counts what goes where, and makes the cells and references of the level below.
    fn distribute<'b>(&'b self, depth: usize, steps: &mut Vec<Step<'b>>) {
        let (now, then) = (depth % 2, (depth + 1) % 2);
        let Self { params, state, bests, codes, ranks, totals, .. } = self;
        let (level, refs, cells) = (&self.levels[depth], &self.refs[now], &self.cells[now]);
        let rank = rank::Buffers {
            params,
            level,
            codes,
            faces: &self.faces[now],
            ranks: ranks.out(),
            totals: totals.out(),
        };
        let total = total::Buffers { params, level, totals: totals.out() };
        let next_level = self.levels[depth + 1].out();
        let advance = advance::Buffers { params, level, ranks, totals, next_level, state: state.out() };
        let children = children::Buffers {
            params,
            level,
            state,
            cells,
            bests,
            ranks,
            totals,
            next_cells: self.cells[then].out(),
            bounds: self.bounds.out(),
            tree: self.tree.out(),
        };
        let distribute = distribute::Buffers {
            params,
            positions: &self.mesh.positions,
            indices: &self.mesh.indices,
            level,
            state,
            refs,
            cells,
            bests,
            codes,
            ranks,
            totals,
            next_cells: &self.cells[then],
            next_refs: self.refs[then].out(),
            moved: self.moved.out(),
            fresh: self.fresh[self.unsorted()].out(),
            listed: self.listed.out(),
        };
        steps.extend([
            rank.indirect(level, OVER_RANKS),
            total.groups(ROWS),
            advance.groups(1),
            children.indirect(level, OVER_CELLS),
            distribute.indirect(level, OVER_REFERENCES),
        ]);
    }

    /// Makes the lists of faces of the level below.
    fn merge<'b>(&'b self, depth: usize, steps: &mut Vec<Step<'b>>) {
        let (now, then) = (depth % 2, (depth + 1) % 2);
        let Self { params, ranks, totals, fresh, .. } = self;
        let (level, next_level) = (&self.levels[depth], &self.levels[depth + 1]);
        let (next_cells, faces) = (&self.cells[then], &self.faces[now]);
        let carry = carry::Buffers {
            params,
            level,
            state: &self.state,
            refs: &self.refs[now],
            cells: &self.cells[now],
            ranks,
            totals,
            next_cells,
            moved: &self.moved,
            fresh: &fresh[0],
            faces,
            next_faces: self.faces[then].out(),
        };
        let insert = insert::Buffers {
            params,
            cells: &self.cells[now],
            ranks,
            totals,
            next_level,
            next_refs: &self.refs[then],
            next_cells,
            fresh: &fresh[0],
            faces,
            next_faces: self.faces[then].out(),
        };
        steps.extend(self.sort(depth + 1));
        steps.extend([carry.indirect(level, OVER_FACES), insert.indirect(next_level, OVER_FRESH)]);
    }

    /// Writes the tree out: numbers its nodes depth first, and lists the references of its leaves.
    fn last_steps<'b>(
        &'b self,
        depth: u32,
        nodes: &'b Buffer<UVec2>,
        refs: &'b Buffer<u32>,
        count: u32,
    ) -> Vec<Step<'b>> {
        let Self { state, tree, sizes, places, listed, .. } = self;
        let levels = &self.levels[..=depth as usize];
        let size = |level| sizes::Buffers { level, tree, sizes: sizes.out() }.indirect(level, OVER_CELLS);
        let number = |level| {
            let number = number::Buffers { level, tree, sizes, places: places.out(), nodes: nodes.out() };
            number.indirect(level, OVER_CELLS)
        };
        let mut steps: Vec<_> = levels.iter().rev().map(size).collect();
        steps.extend(levels.iter().map(number));
        steps.push(leaves::Buffers { state, listed, tree, places, out: refs.out() }.over(count));
        steps
    }

    /// Builds the tree.
    fn run(&self, arena: &mut Arena<'_>, profile: bool) -> Result<Grown, Stop> {
        let device = arena.device;
        let mut times = BuildTimes::default();
        let number = self.given.max_depth as usize + 1;
        let (mut steps, mut depth, mut lists) = (self.root(), 0, true);
        let mut levels = first_levels(self.given.references.max(1));
        let state = loop {
            let end = (depth + levels).min(number);
            levels = LOOK;
            for depth in depth..end {
                self.choose(depth, lists, &mut steps);
                self.distribute(depth, &mut steps);
                if lists {
                    self.merge(depth, &mut steps);
                }
            }
            let (timing, state): (_, State) =
                device.dispatch_and_read(&steps, profile, &self.state.view())?;
            times.add(&steps, &timing);
            steps.clear();
            if state.status & status::CAPACITY != 0 {
                return Err(Stop::Needs(Need {
                    references: state.level_refs,
                    fresh: state.fresh,
                    cells: state.cells,
                    nodes: state.nodes,
                    listed: state.refs,
                }));
            }
            if state.cells == 0 {
                break state;
            }
            if end == number {
                return Err(Error::of_status(status::LEVELS).into());
            }
            (depth, lists) = (end, state.lists > 0);
        };
        // After the root comes padding.
        let (counts, depth) = ([state.nodes + 1, state.refs], state.depth);
        let nodes = arena.alloc("nodes", counts[0], 1)?;
        let refs = arena.alloc("refs", counts[1], 1)?;
        device.write(&nodes.view(), 1, &[Node::PADDING])?;
        let steps = self.last_steps(depth, &nodes, &refs, counts[1]);
        times.add(&steps, &device.dispatch(&steps, profile)?);
        Ok(Grown { nodes: nodes.view(), refs, counts, depth, times, laid: Laid::default() })
    }
}
