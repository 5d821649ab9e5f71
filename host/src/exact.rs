//! The best tree a greedy builder finds: every face of every reference's box is a candidate, in O(N log N)
//! (Wald & Havran 2006, section 4.2), and references that straddle a plane are clipped (section 4.3).
//!
//! A node keeps its references' box faces, *events*, in order along each axis. One pass over them counts
//! references on either side of each face. A split moves the events of references that lie on one side in
//! order to that child; only those of clipped references are new, sorted and merged. So sorting happens once.
//!
//! This is the CPU's way, depth first; `levels` builds the same tree by kernels, breadth first.
//!
//! An event is one word: position, kind, reference; comparing events is comparing integers, no two are equal, and
//! the tree does not depend on how many threads build it.

pub(crate) mod levels;

use crate::{BuildOptions, KdTree, build::most_refs, mesh::Mesh};
use raykd_kernels::{
    build::{
        Costs, Sah,
        bin::{ordered, unordered},
        clip::{Bounds, clip_plane},
    },
    glam::Vec3,
};
use raykd_shared::{Node, TreeHeader, limits::MAX_DEPTH};
use std::sync::{
    Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
};

/// Nodes of more references are built by several threads.
const GRAIN: usize = 4096;

/// A face of a reference's box: position (ordered as an integer), kind, reference.
type Event = u64;

/// The low bits: which of the node's references.
const REFERENCE: u64 = (1 << 30) - 1;
/// What ends at a plane lies below it, what starts there lies above, so ends come first.
const END: u64 = 0;
/// A box that is flat on this axis.
const PLANAR: u64 = 1 << 30;
const START: u64 = 2 << 30;
const KIND: u64 = 3 << 30;

fn position(event: Event) -> f32 {
    unordered((event >> 32) as u32)
}

fn event(at: f32, kind: u64, reference: u32) -> Event {
    u64::from(ordered(at)) << 32 | kind | u64::from(reference)
}

/// A list that is written from the front without being cleared.
#[derive(Debug, Default)]
struct List {
    room: Vec<Event>,
    len: usize,
}

impl List {
    fn events(&self) -> &[Event] {
        &self.room[..self.len]
    }

    /// Makes room for `n` events.
    fn reserve(&mut self, n: usize) {
        if self.room.len() < n {
            // Fresh pages are zero without being written.
            self.room = vec![0; n + n / 4];
        }
    }

    /// Merges new events in, for which there is room.
    fn merge(&mut self, fresh: &mut [Event]) {
        fresh.sort_unstable();
        let (mut old, mut new) = (self.len, fresh.len());
        self.len += new;
        let mut to = self.len;
        while new > 0 {
            to -= 1;
            if old > 0 && self.room[old - 1] > fresh[new - 1] {
                old -= 1;
                self.room[to] = self.room[old];
            } else {
                new -= 1;
                self.room[to] = fresh[new];
            }
        }
    }
}

/// The references of a node along one axis.
#[derive(Debug, Default)]
struct Axis {
    events: List,
    /// New events.
    fresh: Vec<Event>,
}

impl Axis {
    /// Takes in a reference; what ends at the node's upper face needs no event for that.
    fn add(&mut self, reference: u32, (lo, hi): (f32, f32), end: f32) {
        if lo == hi {
            self.fresh.push(event(lo, PLANAR, reference));
        } else {
            self.fresh.push(event(lo, START, reference));
            if hi < end {
                self.fresh.push(event(hi, END, reference));
            }
        }
    }
}

/// The references of a node.
#[derive(Debug, Default)]
struct Set {
    /// Triangle numbers, rising.
    triangles: Vec<u32>,
    /// Boxes of what the node holds of them.
    boxes: Vec<Bounds>,
    axes: [Axis; 3],
}

impl Set {
    fn clear(&mut self) {
        self.triangles.clear();
        self.boxes.clear();
        for axis in &mut self.axes {
            axis.events.len = 0;
            axis.fresh.clear();
        }
    }

    /// Takes in a reference whose faces are new.
    fn add(&mut self, triangle: u32, bounds: Bounds, node: &Bounds) {
        let reference = self.triangles.len() as u32;
        self.triangles.push(triangle);
        self.boxes.push(bounds);
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.add(reference, (bounds.lo[i], bounds.hi[i]), node.hi[i]);
        }
    }
}

/// Bytes of a list's memory.
fn bytes<T>(list: &Vec<T>) -> u64 {
    (list.capacity() * size_of::<T>()) as u64
}

impl Set {
    fn bytes(&self) -> u64 {
        let axes = self.axes.iter().map(|axis| bytes(&axis.events.room) + bytes(&axis.fresh));
        axes.sum::<u64>() + bytes(&self.triangles) + bytes(&self.boxes)
    }
}

/// A plane that cuts a node.
#[derive(Clone, Copy, Debug)]
struct Plane {
    axis: usize,
    at: f32,
    /// On which side references that lie in it go.
    planar_above: bool,
    cost: f32,
}

/// A node to be built.
#[derive(Clone, Copy, Debug)]
struct Cell {
    bounds: Bounds,
    depth: u32,
}

impl Cell {
    /// The cells below and above a plane.
    fn cut(&self, plane: &Plane) -> [Self; 2] {
        let mut halves = [Self { depth: self.depth + 1, ..*self }; 2];
        halves[0].bounds.hi[plane.axis] = plane.at;
        halves[1].bounds.lo[plane.axis] = plane.at;
        halves
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
    fn leaf(&mut self, triangles: &[u32], depth: u32) -> Node {
        let first = self.refs.len() as u32;
        self.refs.extend_from_slice(triangles);
        self.depth = self.depth.max(depth);
        Node::leaf(first, triangles.len() as u32)
    }
}

/// A part of the tree as threads leave it.
#[derive(Debug)]
enum Part {
    Grown(Node, Branch),
    Cut(Plane, Box<[Part; 2]>),
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
    pool: Pool,
    /// References so far, of the leaves and of the nodes of each depth, and how many there may be of either.
    listed: AtomicUsize,
    passed: [AtomicUsize; MAX_DEPTH as usize + 1],
    most: usize,
    /// Whether there are more: the tree is given up.
    full: AtomicBool,
}

/// Where a reference goes: its number among the child's and one of these, or neither if it is clipped.
const BELOW: u32 = 1 << 30;
const ABOVE: u32 = 1 << 31;

/// Memory that is used again and again: new pages cost more than what is done with them.
#[derive(Debug, Default)]
struct Spare {
    targets: Vec<u32>,
    sets: Vec<Set>,
}

impl Spare {
    fn set(&mut self) -> Set {
        self.sets.pop().unwrap_or_default()
    }
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
        let large: u64 = locked(&self.large).iter().map(Set::bytes).sum();
        let each = |spare: &Spare| bytes(&spare.targets) + spare.sets.iter().map(Set::bytes).sum::<u64>();
        large + locked(&self.spares).iter().map(each).sum::<u64>()
    }
}

/// Takes a lock; a thread that panicked left nothing half done in a list.
fn locked<T>(list: &Mutex<T>) -> MutexGuard<'_, T> {
    list.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Builder<'_> {
    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| Vec3::from_slice(&self.positions[3 * v as usize..]))
    }

    /// The cheapest plane across an axis.
    fn sweep(&self, set: &Set, node: &Bounds, axis: usize, sah: &Sah) -> Plane {
        let across = sah.across(axis as u32);
        let mut best = Plane { axis, at: node.lo[axis], planar_above: false, cost: f32::INFINITY };
        let (mut below, mut above) = (0, set.triangles.len() as u32);
        let mut consider = |at: f32, below: u32, above: u32, planar_above: bool| {
            let cost = across.cut(at, below as f32, above as f32);
            if cost < best.cost {
                best = Plane { axis, at, planar_above, cost };
            }
        };
        let events = set.axes[axis].events.events();
        let mut next = 0;
        while let Some(&first) = events.get(next) {
            let at = position(first);
            let (mut ends, mut planar, mut starts) = (0, 0, 0);
            while let Some(&event) = events.get(next)
                && event >> 32 == first >> 32
            {
                ends += u32::from(event & KIND == END);
                planar += u32::from(event & KIND == PLANAR);
                starts += u32::from(event & KIND == START);
                next += 1;
            }
            above -= ends;
            consider(at, below, above, true);
            below += planar;
            above -= planar;
            if planar > 0 {
                consider(at, below, above, false);
            }
            below += starts;
        }
        best
    }

    /// Counts references, and notes when there are too many.
    fn count(&self, so_far: &AtomicUsize, references: usize) {
        if so_far.fetch_add(references, Relaxed) + references > self.most {
            self.full.store(true, Relaxed);
        }
    }

    /// The plane that cuts the node, or none if it becomes a leaf.
    fn choose(&self, set: &Set, cell: &Cell, parallel: bool) -> Option<Plane> {
        let sah = Sah::new(cell.bounds.lo, cell.bounds.hi, set.triangles.len() as u32, self.costs);
        if cell.depth >= self.max_depth || !sah.may_pay || self.full.load(Relaxed) {
            return None;
        }
        let sweep = |axis| self.sweep(set, &cell.bounds, axis, &sah);
        let planes = if parallel {
            let (x, (y, z)) = rayon::join(|| sweep(0), || rayon::join(|| sweep(1), || sweep(2)));
            [x, y, z]
        } else {
            [0, 1, 2].map(sweep)
        };
        let best = planes.into_iter().reduce(|a, b| if b.cost < a.cost { b } else { a })?;
        (best.cost < sah.leaf).then_some(best)
    }

    /// The boxes of what lies of a straddling reference below and above a plane.
    fn clip(&self, triangle: u32, bounds: &Bounds, plane: &Plane, cells: &[Cell; 2]) -> [Bounds; 2] {
        if self.clip {
            let [a, b, c] = self.corners(triangle);
            clip_plane(a, b, c, bounds, plane.axis as u32, plane.at).into()
        } else {
            cells.map(|cell| bounds.and(&cell.bounds))
        }
    }

    /// Distributes the references of a node to its children.
    fn split(
        &self,
        set: &Set,
        plane: &Plane,
        cells: &[Cell; 2],
        halves: &mut [Set; 2],
        targets: &mut Vec<u32>,
        parallel: bool,
    ) {
        self.count(&self.passed[cells[0].depth as usize - 1], set.triangles.len());
        for half in halves.iter_mut() {
            half.clear();
            half.triangles.reserve(set.triangles.len());
            half.boxes.reserve(set.boxes.len());
        }
        targets.clear();
        let [low, high] = halves;
        for (&triangle, bounds) in set.triangles.iter().zip(&set.boxes) {
            let (lo, hi) = (bounds.lo[plane.axis], bounds.hi[plane.axis]);
            // What touches the plane from one side is on that side only.
            let planar = lo == plane.at && hi == plane.at;
            let below = lo < plane.at || (planar && !plane.planar_above);
            let above = hi > plane.at || (planar && plane.planar_above);
            let target = if below && above {
                let [under, over] = self.clip(triangle, bounds, plane, cells);
                if !under.is_empty() {
                    low.add(triangle, under, &cells[0].bounds);
                }
                if !over.is_empty() {
                    high.add(triangle, over, &cells[1].bounds);
                }
                0
            } else {
                let (half, side) = if below { (&mut *low, BELOW) } else { (&mut *high, ABOVE) };
                half.triangles.push(triangle);
                half.boxes.push(*bounds);
                side | (half.triangles.len() as u32 - 1)
            };
            targets.push(target);
        }
        let move_events = |axis: usize, low: &mut Axis, high: &mut Axis| {
            let from = &set.axes[axis];
            let events = from.events.events();
            for half in [&mut *low, &mut *high] {
                half.events.reserve(events.len() + half.fresh.len() + 1);
            }
            let (mut b, mut a) = (0, 0);
            let (to_low, to_high) = (&mut low.events.room[..], &mut high.events.room[..]);
            // Written to both and kept in one: no branch to predict.
            for &event in events {
                let target = targets[(event & REFERENCE) as usize];
                let moved = event & !REFERENCE | u64::from(target) & REFERENCE;
                to_low[b] = moved;
                b += (target >> 30 & 1) as usize;
                to_high[a] = moved;
                a += (target >> 31) as usize;
            }
            (low.events.len, high.events.len) = (b, a);
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
        let Some(plane) = self.choose(set, cell, false) else {
            return self.leaf(tree, &set.triangles, cell.depth);
        };
        let slot = tree.nodes.len();
        tree.nodes.extend([Node::PADDING; 2]);
        let cells = cell.cut(&plane);
        let mut halves = [spare.set(), spare.set()];
        self.split(set, &plane, &cells, &mut halves, &mut spare.targets, false);
        for (i, (half, cell)) in halves.iter().zip(&cells).enumerate() {
            tree.nodes[slot + i] = self.grow(half, cell, tree, spare);
        }
        spare.sets.extend(halves);
        Node::inner(plane.axis as u32, plane.at, slot as u32)
    }

    fn leaf(&self, tree: &mut Branch, triangles: &[u32], depth: u32) -> Node {
        self.count(&self.passed[depth as usize], triangles.len());
        self.count(&self.listed, triangles.len());
        tree.leaf(triangles, depth)
    }

    /// The same by several threads.
    fn branch(&self, set: Set, cell: &Cell) -> Part {
        let mut spare = locked(&self.pool.spares).pop().unwrap_or_default();
        if set.triangles.len() > GRAIN
            && let Some(plane) = self.choose(&set, cell, true)
        {
            let cells = cell.cut(&plane);
            let mut halves = [(); 2].map(|()| locked(&self.pool.large).pop().unwrap_or_default());
            self.split(&set, &plane, &cells, &mut halves, &mut spare.targets, true);
            locked(&self.pool.spares).push(spare);
            locked(&self.pool.large).push(set);
            let [low, high] = halves;
            let (below, above) = rayon::join(|| self.branch(low, &cells[0]), || self.branch(high, &cells[1]));
            return Part::Cut(plane, Box::new([below, above]));
        }
        // About what surface meshes need.
        let n = set.triangles.len();
        let (nodes, refs) = (Vec::with_capacity(5 * n), Vec::with_capacity(5 * n));
        let mut tree = Branch { nodes, refs, depth: 0 };
        let root = self.grow(&set, cell, &mut tree, &mut spare);
        locked(&self.pool.spares).push(spare);
        locked(&self.pool.large).push(set);
        Part::Grown(root, tree)
    }
}

/// Builds the tree of `mesh` on the CPU, by the threads of the current rayon pool. The same mesh and options give
/// the same bytes. Where splitting does not separate the triangles, the depth is halved until memory suffices.
pub fn build(mesh: &Mesh, options: &BuildOptions) -> KdTree {
    build_counted(mesh, options).0
}

/// The same, and the most bytes that were held at once, the mesh included.
pub(crate) fn build_counted(mesh: &Mesh, options: &BuildOptions) -> (KdTree, u64) {
    let mut depth = options.max_depth.min(MAX_DEPTH);
    loop {
        // A single leaf always fits.
        match attempt(mesh, &BuildOptions { max_depth: depth, ..options.clone() }) {
            Some(counted) => return counted,
            None => depth /= 2,
        }
    }
}

/// Gives up if the leaves, or the nodes of some depth, get too long in all.
fn attempt(mesh: &Mesh, options: &BuildOptions) -> Option<(KdTree, u64)> {
    let positions = mesh.scaled_positions();
    let (lo, hi) = mesh.scaled_bounds();
    let builder = Builder {
        positions: &positions,
        triangles: mesh.triangles(),
        costs: options.costs(mesh),
        max_depth: options.max_depth,
        clip: options.clip,
        pool: Pool::default(),
        listed: AtomicUsize::new(0),
        passed: [const { AtomicUsize::new(0) }; MAX_DEPTH as usize + 1],
        full: AtomicBool::new(false),
        most: most_refs(mesh.kept().len() as u32) as usize,
    };
    let bounds = Bounds { lo: Vec3::from_array(lo), hi: Vec3::from_array(hi) };
    let mut set = Set::default();
    set.triangles.reserve(mesh.kept().len());
    set.boxes.reserve(mesh.kept().len());
    set.axes.iter_mut().for_each(|axis| axis.fresh.reserve(2 * mesh.kept().len()));
    for &triangle in mesh.kept() {
        let [a, b, c] = builder.corners(triangle);
        set.add(triangle, Bounds::of(a, b, c), &bounds);
    }
    let sort = |axis: &mut Axis| {
        use rayon::prelude::*;
        axis.fresh.par_sort_unstable();
        axis.events = List { len: axis.fresh.len(), room: std::mem::take(&mut axis.fresh) };
    };
    set.axes.iter_mut().for_each(sort);
    let part = builder.branch(set, &Cell { bounds, depth: 0 });
    if builder.full.load(Relaxed) {
        return None;
    }
    let (nodes, refs) = part.size();
    // Memory is used again, not given back, so all of it is there at the end.
    let held = builder.pool.bytes()
        + part.bytes()
        + (size_of_val(&*positions) + size_of_val(mesh.triangles())) as u64;
    let mut tree = Branch { nodes: Vec::with_capacity(nodes + 2), refs: Vec::with_capacity(refs), depth: 0 };
    tree.nodes.extend([Node::PADDING; 2]);
    tree.nodes[0] = part.place(&mut tree);
    let header = TreeHeader {
        lo,
        nodes: tree.nodes.len() as u32,
        hi,
        refs: tree.refs.len() as u32,
        triangles: mesh.triangles().len() as u32,
        depth: tree.depth,
        scale: mesh.scale(),
        cost_step: options.cost_step,
        cost_test: options.cost_test,
        reserved: [0; 3],
    };
    let held = held + bytes(&tree.nodes) + bytes(&tree.refs);
    Some((KdTree { header, nodes: tree.nodes, refs: tree.refs }, held))
}
