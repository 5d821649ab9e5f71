//! The sweep by the host: depth first.
//!
//! A split moves a node's events in order to the children; only those of faces that clipping has moved are
//! new, sorted and merged. So sorting happens once. Small nodes have no events. The tree does not depend on
//! how many threads build it.

use super::{
    events::{Axis, List, REFERENCE, Set, bytes, extent},
    split::{Split, cheaper, cheapest_across, face, face_usually},
};
use crate::{
    build::{
        built::Grown,
        retry::Stop,
        room::{Arena, growth, most_of_sweep},
        times::BuildTimes,
    },
    clock::Instant,
    exec::cpu::usual,
    lock::lock,
    mesh::Mesh,
};
use raykd_kernels::{
    Usual,
    bounds::Bounds,
    build::{
        Costs, Sah,
        clip::clip_plane,
        faces::{Flat, MOST},
        growth_left,
        reference::Reference,
        sides,
    },
    glam::Vec3,
};
use raykd_shared::{BuildParams, Node, limits::MAX_DEPTH, rule};
use rayon::prelude::*;
use std::{
    ops::Range,
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
};

/// Nodes of more references are built by several threads.
const GRAIN: usize = 4096;

/// Nodes of no more references have no events: all boxes are looked at for every face.
const ONE_BY_ONE: usize = MOST;

/// A node to be built.
#[derive(Clone, Copy, Debug)]
struct Cell {
    bounds: Bounds,
    depth: u32,
    /// How many each of its references may become: see [`Costs::most`].
    growth: f32,
}

impl Cell {
    /// The cells below and above a plane.
    fn cut(&self, plane: &Split) -> [Self; 2] {
        let mut halves = [Self { depth: self.depth + 1, ..*self }; 2];
        halves[0].bounds.hi[plane.axis] = plane.at;
        halves[1].bounds.lo[plane.axis] = plane.at;
        halves
    }

    /// The same, where `count` references became those of two sets.
    fn cut_to(&self, plane: &Split, count: usize, halves: &[Set; 2]) -> [Self; 2] {
        let now: usize = halves.iter().map(|half| half.references.len).sum();
        let growth = growth_left(self.growth, count as u32, now as u32, plane.pays());
        self.cut(plane).map(|half| Self { growth, ..half })
    }
}

/// Nodes and references of a part of the tree; children are numbered within it.
#[derive(Debug, Default)]
struct Branch {
    nodes: Vec<Node>,
    refs: Vec<u32>,
    depth: u32,
}

impl Branch {
    fn leaf(&mut self, references: &[Reference], depth: u32) -> Node {
        let first = self.refs.len() as u32;
        self.refs.extend(references.iter().map(|r| r.triangle));
        self.depth = self.depth.max(depth);
        Node::leaf(first, references.len() as u32)
    }
}

/// A part of the tree as threads leave it.
#[derive(Debug)]
enum Part {
    Grown(Node, Branch),
    Cut(Split, Box<[Part; 2]>),
}

impl Part {
    /// Numbers of nodes, the root not counted, and of references.
    fn size(&self) -> (usize, usize) {
        match self {
            Self::Cut(_, halves) => {
                let [(n, r), (m, s)] = halves.each_ref().map(Self::size);
                (n + m + 2, r + s)
            }
            Self::Grown(_, branch) => (branch.nodes.len(), branch.refs.len()),
        }
    }

    fn bytes(&self) -> u64 {
        match self {
            Self::Cut(_, halves) => halves.iter().map(Self::bytes).sum(),
            Self::Grown(_, branch) => bytes(&branch.nodes) + bytes(&branch.refs),
        }
    }

    /// Appends it to the tree; the root is the caller's to place.
    fn place(self, tree: &mut Branch) -> Node {
        match self {
            Self::Cut(plane, halves) => {
                let slot = tree.nodes.len();
                tree.nodes.extend([Node::PADDING; 2]);
                for (i, half) in halves.into_iter().enumerate() {
                    tree.nodes[slot + i] = half.place(tree);
                }
                Node::inner(plane.axis as u32, plane.at, slot as u32)
            }
            Self::Grown(root, branch) => {
                let (nodes, refs) = (tree.nodes.len() as u32, tree.refs.len() as u32);
                let shift = |node: Node| match node.is_leaf() {
                    true => Node::leaf(node.first() + refs, node.count()),
                    false => Node::inner(node.axis(), node.split(), node.below() + nodes),
                };
                tree.nodes.extend(branch.nodes.into_iter().map(shift));
                tree.refs.extend_from_slice(&branch.refs);
                tree.depth = tree.depth.max(branch.depth);
                shift(root)
            }
        }
    }
}

/// What every node needs to know.
struct Builder<'m> {
    positions: &'m [f32],
    triangles: &'m [[u32; 3]],
    costs: Costs,
    max_depth: u32,
    clip: bool,
    /// Whether the processor has its usual instructions.
    usual: Usual,
    pool: Pool,
    /// References so far, of the leaves and of the nodes of each depth, and how many there may be of either.
    listed: AtomicUsize,
    passed: [AtomicUsize; MAX_DEPTH as usize + 1],
    most: usize,
    /// Whether there are more: the tree is given up.
    full: AtomicBool,
}

/// How the references of a node are shared out to its children.
#[derive(Debug, Default)]
struct Shares {
    /// Where each goes.
    sides: Vec<u32>,
    /// Those that straddle the plane, and the boxes of what lies of them below and above.
    straddling: Vec<u32>,
    halves: Vec<[Bounds; 2]>,
    /// The number of each among those of either child, and which of its events go there.
    targets: Vec<[u64; 2]>,
}

/// A side, and that of a reference which is cut.
const BELOW: u32 = 1;
const ABOVE: u32 = 2;
const CUT: u32 = 4;
/// All events of a reference.
const EVERY: u64 = 0x3F << 32;

impl Shares {
    fn bytes(&self) -> u64 {
        bytes(&self.sides) + bytes(&self.straddling) + bytes(&self.halves) + bytes(&self.targets)
    }

    /// How many go below and above.
    fn sizes(&self) -> [usize; 2] {
        [0, 1].map(|side| self.sides.iter().map(|s| (s >> side & 1) as usize).sum())
    }

    /// Moves the references, and leaves room for one more behind those of either child.
    fn place(&mut self, references: &[Reference], [low, high]: [&mut [Reference]; 2]) {
        let (mut below, mut above) = (0, 0);
        self.targets.clear();
        // Written to both and kept in one: no branch to predict.
        self.targets.extend(references.iter().zip(&self.sides).map(|(reference, side)| {
            let target = [
                below | if *side == BELOW { EVERY } else { 0 },
                above | if *side == ABOVE { EVERY } else { 0 },
            ];
            low[below as usize] = *reference;
            high[above as usize] = *reference;
            below += u64::from(side & 1);
            above += u64::from(side >> 1 & 1);
            target
        }));
        for (&i, [under, over]) in self.straddling.iter().zip(&self.halves) {
            let [below, above] = self.targets[i as usize];
            if self.sides[i as usize] & BELOW != 0 {
                low[below as usize].bounds = *under;
            }
            if self.sides[i as usize] & ABOVE != 0 {
                high[above as usize].bounds = *over;
            }
        }
    }
}

/// Memory that is used again and again: new pages cost more than what is done with them.
#[derive(Debug, Default)]
struct Spare {
    shares: Shares,
    /// For the children of a node of each depth.
    sets: Vec<[Set; 2]>,
    /// References of small nodes.
    small: Vec<Reference>,
}

/// The same for what threads pass on to each other.
#[derive(Debug, Default)]
struct Pool {
    spares: Mutex<Vec<Spare>>,
    large: Mutex<Vec<Set>>,
}

impl Pool {
    /// What all sets took, once they are back.
    fn bytes(&self) -> u64 {
        let large: u64 = lock(&self.large).iter().map(Set::bytes).sum();
        let each = |spare: &Spare| {
            spare.shares.bytes()
                + bytes(&spare.small)
                + spare.sets.iter().flatten().map(Set::bytes).sum::<u64>()
        };
        large + lock(&self.spares).iter().map(each).sum::<u64>()
    }
}

impl Builder<'_> {
    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| Vec3::from_slice(&self.positions[3 * v as usize..]))
    }

    /// The references of the root, and their events.
    fn root(&self, triangles: &[u32], bounds: &Bounds) -> Set {
        let mut set = Set::default();
        set.references.room.reserve(triangles.len());
        set.axes.iter_mut().for_each(|axis| axis.fresh.reserve(2 * triangles.len()));
        let nowhere = Bounds { lo: Vec3::INFINITY, hi: Vec3::NEG_INFINITY };
        for &triangle in triangles {
            let [a, b, c] = self.corners(triangle);
            let reference = Reference { triangle, cell: 0, bounds: Bounds::of(a, b, c) };
            set.add(set.references.room.len() as u32, &reference.bounds, &nowhere, bounds);
            set.references.room.push(reference);
        }
        set.references.len = set.references.room.len();
        set.axes.par_iter_mut().for_each(|axis| {
            axis.events = List { len: axis.fresh.len(), room: std::mem::take(&mut axis.fresh) };
            axis.events.sort();
        });
        set
    }

    /// Counts references, and notes when there are too many.
    fn count(&self, so_far: &AtomicUsize, references: usize) {
        if so_far.fetch_add(references, Relaxed) + references > self.most {
            self.full.store(true, Relaxed);
        }
    }

    /// The plane that cuts the node, or none if it becomes a leaf.
    fn choose(&self, set: &Set, cell: &Cell, parallel: bool) -> Option<Split> {
        let sah = self.sah(cell, set.references.len)?;
        let sweep = |axis, cost| cheapest_across(set, axis, &sah, cost);
        let best = if parallel {
            let leaf = sah.leaf;
            let (x, (y, z)) =
                rayon::join(|| sweep(0, leaf), || rayon::join(|| sweep(1, leaf), || sweep(2, leaf)));
            cheaper(cheaper(x, y), z)
        } else {
            (0..3).fold(None, |best, axis| {
                sweep(axis, best.map_or(sah.leaf, |plane: Split| plane.cost)).or(best)
            })
        };
        best.or_else(|| Split::middle(&sah, set.references.len))
    }

    /// What planes cost in a node of so many references, if any may pay.
    fn sah(&self, cell: &Cell, count: usize) -> Option<Sah> {
        let Bounds { lo, hi } = cell.bounds;
        let most = self.costs.most(lo, hi, count as u32, cell.growth);
        let sah = Sah::new(lo, hi, count as u32, most, self.costs);
        (cell.depth < self.max_depth && sah.may_pay && !self.full.load(Relaxed)).then_some(sah)
    }

    /// Says where the references of a node go, and what there is of those that are cut.
    fn share(&self, references: &[Reference], plane: &Split, cells: &[Cell; 2], shares: &mut Shares) {
        let (at, flat_above) = (plane.at, plane.flat == Flat::Above);
        let (codes, straddling) = (&mut shares.sides, &mut shares.straddling);
        codes.resize(references.len(), 0);
        straddling.resize(references.len(), 0);
        let mut number = 0;
        for (i, (reference, side)) in references.iter().zip(&mut *codes).enumerate() {
            let (lo, hi) = extent(&reference.bounds, plane.axis);
            let (below, above) = sides(lo, hi, at, flat_above);
            *side = (u32::from(below) * BELOW) | (u32::from(above) * ABOVE);
            straddling[number] = i as u32;
            number += usize::from(below & above);
        }
        straddling.truncate(number);
        shares.halves.clear();
        for &i in &*straddling {
            let Reference { triangle, bounds, .. } = &references[i as usize];
            let [under, over] = if self.clip {
                let [a, b, c] = self.corners(*triangle);
                clip_plane(a, b, c, bounds, plane.axis as u32, at).into()
            } else {
                cells.map(|cell| bounds.and(&cell.bounds))
            };
            let (below, above) = (!under.is_empty(), !over.is_empty());
            codes[i as usize] = (u32::from(below) * BELOW) | (u32::from(above) * ABOVE) | CUT;
            shares.halves.push([under, over]);
        }
    }

    /// Distributes the references of a node to its children.
    fn split(
        &self,
        set: &Set,
        plane: &Split,
        cells: &[Cell; 2],
        halves: &mut [Set; 2],
        shares: &mut Shares,
        parallel: bool,
    ) {
        let references = set.references.all();
        self.count(&self.passed[cells[0].depth as usize - 1], references.len());
        self.share(references, plane, cells, shares);
        let sizes = shares.sizes();
        for (half, size) in halves.iter_mut().zip(sizes) {
            half.clear();
            half.references.reserve(size + 1, references[0]);
            half.references.len = size;
        }
        let [low, high] = halves;
        shares.place(references, [&mut low.references.room, &mut high.references.room]);
        // Small nodes need no events.
        let sorted = plane.most.map(|most| most > ONE_BY_ONE);
        for (&i, halves) in shares.straddling.iter().zip(&shares.halves) {
            for (k, half) in [&mut *low, &mut *high].into_iter().enumerate() {
                if sorted[k] && shares.sides[i as usize] >> k & 1 == 1 {
                    let target = &mut shares.targets[i as usize][k];
                    let before = &references[i as usize].bounds;
                    *target |= half.add(*target as u32, &halves[k], before, &cells[k].bounds);
                }
            }
        }
        if sorted == [false; 2] {
            return;
        }
        let targets = &shares.targets;
        let move_events = |axis: usize, low: &mut Axis, high: &mut Axis| {
            let events = set.axes[axis].events.all();
            let kept = |event: u64| 32 + 2 * axis as u32 + (event >> 31 & 1) as u32;
            let moved = |event: u64, target: u64| event & !REFERENCE | target & REFERENCE;
            let mut halves = [&mut *low, &mut *high];
            for (half, size) in halves.iter_mut().zip(sizes) {
                half.events.reserve(2 * size + 1, 0);
            }
            // Written to all that need them, and kept in one: no branch to predict.
            match sorted.iter().position(|sorted| !sorted) {
                None => {
                    let (mut b, mut a) = (0, 0);
                    let (to_low, to_high) = (&mut low.events.room[..], &mut high.events.room[..]);
                    for &event in events {
                        let [below, above] = targets[(event & REFERENCE) as usize];
                        to_low[b] = moved(event, below);
                        b += (below >> kept(event) & 1) as usize;
                        to_high[a] = moved(event, above);
                        a += (above >> kept(event) & 1) as usize;
                    }
                    (low.events.len, high.events.len) = (b, a);
                }
                Some(other) => {
                    let half = &mut halves[1 - other].events;
                    half.len = 0;
                    for &event in events {
                        let target = targets[(event & REFERENCE) as usize][1 - other];
                        half.room[half.len] = moved(event, target);
                        half.len += (target >> kept(event) & 1) as usize;
                    }
                }
            }
            low.events.merge(&mut low.fresh);
            high.events.merge(&mut high.fresh);
        };
        let [low_x, low_y, low_z] = &mut low.axes;
        let [high_x, high_y, high_z] = &mut high.axes;
        if parallel {
            rayon::join(
                || move_events(0, low_x, high_x),
                || rayon::join(|| move_events(1, low_y, high_y), || move_events(2, low_z, high_z)),
            );
        } else {
            move_events(0, low_x, high_x);
            move_events(1, low_y, high_y);
            move_events(2, low_z, high_z);
        }
    }

    /// Builds a node and all below it; returns its words.
    fn grow(&self, set: &Set, cell: &Cell, tree: &mut Branch, spare: &mut Spare) -> Node {
        let references = set.references.all();
        if references.len() <= ONE_BY_ONE {
            spare.small.clear();
            spare.small.extend_from_slice(references);
            return self.finish(0..references.len(), cell, tree, spare);
        }
        let Some(plane) = self.choose(set, cell, false) else {
            return self.leaf(tree, references, cell.depth);
        };
        let slot = tree.nodes.len();
        tree.nodes.extend([Node::PADDING; 2]);
        let cells = cell.cut(&plane);
        let depth = cell.depth as usize;
        if spare.sets.len() <= depth {
            spare.sets.resize_with(depth + 1, Default::default);
        }
        let mut halves = std::mem::take(&mut spare.sets[depth]);
        self.split(set, &plane, &cells, &mut halves, &mut spare.shares, false);
        let cells = cell.cut_to(&plane, references.len(), &halves);
        for (i, (half, cell)) in halves.iter().zip(&cells).enumerate() {
            tree.nodes[slot + i] = self.grow(half, cell, tree, spare);
        }
        spare.sets[depth] = halves;
        Node::inner(plane.axis as u32, plane.at, slot as u32)
    }

    /// The same for a small node, whose references are numbers `own` of the small ones; there is room behind them.
    fn finish(&self, own: Range<usize>, cell: &Cell, tree: &mut Branch, spare: &mut Spare) -> Node {
        let references = &spare.small[own.clone()];
        let plane = self.sah(cell, references.len()).and_then(|sah| {
            if self.usual.has() {
                // SAFETY: the processor has these instructions.
                unsafe { face_usually(self.usual, references, &sah) }
            } else {
                face(references, &sah)
            }
        });
        let Some(plane) = plane else {
            return self.leaf(tree, references, cell.depth);
        };
        self.count(&self.passed[cell.depth as usize], references.len());
        let slot = tree.nodes.len();
        tree.nodes.extend([Node::PADDING; 2]);
        let cells = cell.cut(&plane);
        let shares = &mut spare.shares;
        self.share(references, &plane, &cells, shares);
        let [below, above] = spare.shares.sizes();
        // What goes above comes behind the node's own, then what goes below, which is built first. Each with
        // room for one more.
        let high = own.end..own.end + above;
        let low = high.end + 1..high.end + 1 + below;
        if spare.small.len() <= low.end {
            spare.small.resize(2 * low.end, spare.small[0]);
        }
        let (earlier, room) = spare.small.split_at_mut(own.end);
        let (to_high, to_low) = room.split_at_mut(above + 1);
        spare.shares.place(&earlier[own], [to_low, to_high]);
        for (i, (references, cell)) in [low, high].into_iter().zip(&cells).enumerate() {
            tree.nodes[slot + i] = self.finish(references, cell, tree, spare);
        }
        Node::inner(plane.axis as u32, plane.at, slot as u32)
    }

    fn leaf(&self, tree: &mut Branch, references: &[Reference], depth: u32) -> Node {
        self.count(&self.passed[depth as usize], references.len());
        self.count(&self.listed, references.len());
        tree.leaf(references, depth)
    }

    /// The same by several threads.
    fn branch(&self, set: Set, cell: &Cell) -> Part {
        let mut spare = lock(&self.pool.spares).pop().unwrap_or_default();
        if set.references.len > GRAIN
            && let Some(plane) = self.choose(&set, cell, true)
        {
            let cells = cell.cut(&plane);
            let mut halves = [(); 2].map(|()| lock(&self.pool.large).pop().unwrap_or_default());
            self.split(&set, &plane, &cells, &mut halves, &mut spare.shares, true);
            let cells = cell.cut_to(&plane, set.references.len, &halves);
            lock(&self.pool.spares).push(spare);
            lock(&self.pool.large).push(set);
            let [low, high] = halves;
            let (below, above) = rayon::join(|| self.branch(low, &cells[0]), || self.branch(high, &cells[1]));
            return Part::Cut(plane, Box::new([below, above]));
        }
        // About what surface meshes need.
        let n = set.references.len;
        let (nodes, refs) = (Vec::with_capacity(5 * n), Vec::with_capacity(5 * n));
        let mut tree = Branch { nodes, refs, depth: 0 };
        let root = self.grow(&set, cell, &mut tree, &mut spare);
        lock(&self.pool.spares).push(spare);
        lock(&self.pool.large).push(set);
        Part::Grown(root, tree)
    }
}

/// Builds the tree by the threads of the device. The same mesh and parameters give the same bytes.
pub(in crate::build) fn build(
    arena: &mut Arena<'_>,
    mesh: &Mesh,
    params: &BuildParams,
) -> Result<Grown, Stop> {
    let begin = Instant::now();
    let (tree, bytes) = arena.device.install(|| grow(mesh, params)).ok_or(Stop::Crowd)?;
    let times = BuildTimes { build: begin.elapsed(), ..BuildTimes::default() };
    arena.bytes += bytes;
    Ok(Grown::put(arena, &tree.nodes, &tree.refs, tree.depth, times)?)
}

/// The tree, and the most bytes that were held at once. None if the leaves, or the nodes of some depth, get
/// too long in all.
fn grow(mesh: &Mesh, params: &BuildParams) -> Option<(Branch, u64)> {
    let positions = mesh.scaled_positions();
    let builder = Builder {
        positions: &positions,
        triangles: mesh.triangles(),
        costs: Costs::of(params),
        max_depth: params.max_depth,
        clip: params.rule & rule::CLIP != 0,
        usual: usual(),
        pool: Pool::default(),
        listed: AtomicUsize::new(0),
        passed: [const { AtomicUsize::new(0) }; MAX_DEPTH as usize + 1],
        full: AtomicBool::new(false),
        most: most_of_sweep(params.references) as usize,
    };
    let bounds = Bounds { lo: Vec3::from_array(params.lo), hi: Vec3::from_array(params.hi) };
    let set = builder.root(mesh.kept(), &bounds);
    let part = builder.branch(set, &Cell { bounds, depth: 0, growth: growth(params.references) });
    if builder.full.load(Relaxed) {
        return None;
    }
    let (nodes, refs) = part.size();
    // Memory is used again, not given back, so all of it is there at the end.
    let held = builder.pool.bytes() + part.bytes() + size_of_val(&*positions) as u64;
    let mut tree = Branch { nodes: Vec::with_capacity(nodes + 2), refs: Vec::with_capacity(refs), depth: 0 };
    tree.nodes.extend([Node::PADDING; 2]);
    tree.nodes[0] = part.place(&mut tree);
    let held = held + bytes(&tree.nodes) + bytes(&tree.refs);
    Some((tree, held))
}
