//! The best tree a greedy builder finds: every face of every reference's box is a candidate, in O(N log N)
//! (Wald & Havran 2006, section 4.2), and references that straddle a plane are clipped (section 4.3).
//!
//! A node keeps its references' box faces, *events*, in order along each axis. One pass over them counts references on either
//! side of each face. Counts and areas rise on the one side of a plane and fall on the other, so that a part of the list tells by
//! its first and its last event what a plane in it costs at least; only parts that may hold the cheapest are weighed. A split moves
//! the events in order to the children; only those of faces that clipping has moved are new, sorted and merged. So sorting happens
//! once. Small nodes have no events: every face is weighed against every box.
//!
//! This is the CPU's way, depth first; `levels` builds the same tree by kernels, breadth first.
//!
//! An event is one word: position, kind, reference; comparing events is comparing integers, no two are equal, and
//! the tree does not depend on how many threads build it.

pub(crate) mod levels;

use crate::{
    BuildOptions, KdTree,
    build::{growth, most_refs, params},
    exec::cpu::has_usual_instructions,
    mesh::Mesh,
};
use raykd_kernels::{
    build::{
        Across, Costs, Sah,
        bin::{ordered, unordered},
        clip::{Bounds, clip_plane},
        faces::{Flat, MOST, cheapest},
        growth_left,
        reference::Reference,
    },
    glam::{Vec3, Vec4},
    math::Number,
};
use raykd_shared::{Node, TreeHeader, limits::MAX_DEPTH};
use rayon::prelude::*;
use std::{
    ops::Range,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

/// Nodes of more references are built by several threads.
const GRAIN: usize = 4096;

/// Nodes of no more references have no events: all boxes are looked at for every face.
const SMALL: usize = MOST;

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
#[derive(Debug)]
struct List<T> {
    room: Vec<T>,
    len: usize,
}

impl<T> Default for List<T> {
    fn default() -> Self {
        Self { room: Vec::new(), len: 0 }
    }
}

impl<T: Copy> List<T> {
    fn all(&self) -> &[T] {
        &self.room[..self.len]
    }

    /// Makes room for `n`, full of something.
    fn reserve(&mut self, n: usize, something: T) {
        if self.room.len() < n {
            // Fresh pages are zero without being written.
            self.room = vec![something; n + n / 4];
        }
    }
}

impl List<Event> {
    /// Sorts what is in order of references: by digits, the lowest first.
    fn sort(&mut self) {
        let mut other = vec![0; self.len];
        for (shift, bits) in [(30, 12), (42, 11), (53, 11)] {
            let digit = |event: Event| (event >> shift) as usize & ((1 << bits) - 1);
            let mut places = [0u32; 1 << 12];
            self.all().iter().for_each(|&event| places[digit(event)] += 1);
            let mut before = 0;
            for place in &mut places {
                before += std::mem::replace(place, before);
            }
            for &event in self.all() {
                let place = &mut places[digit(event)];
                other[*place as usize] = event;
                *place += 1;
            }
            std::mem::swap(&mut self.room, &mut other);
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
    events: List<Event>,
    /// New events.
    fresh: Vec<Event>,
}

impl Axis {
    /// Takes in the faces of a reference, but for those where its box had one `before`, whose events are kept; and what
    /// starts or ends at a face of the node needs none. Returns [`ENDS`] and [`STARTS`] for what is kept.
    fn add(&mut self, reference: u32, lo_hi: (f32, f32), before: (f32, f32), node: (f32, f32)) -> u64 {
        let ((lo, hi), (start, end)) = (lo_hi, node);
        if lo == hi {
            if before.0 == before.1 {
                return ENDS | STARTS;
            }
            self.fresh.push(event(lo, PLANAR, reference));
            return 0;
        }
        let (starts, ends) = (lo == before.0, hi == before.1);
        if !starts && lo > start {
            self.fresh.push(event(lo, START, reference));
        }
        if !ends && hi < end {
            self.fresh.push(event(hi, END, reference));
        }
        (u64::from(starts) * STARTS) | (u64::from(ends) * ENDS)
    }
}

/// The references of a node.
#[derive(Debug, Default)]
struct Set {
    /// By triangle, rising; their boxes hold what the node holds of them.
    references: List<Reference>,
    /// Their faces, unless the node is small.
    axes: [Axis; 3],
}

impl Set {
    fn clear(&mut self) {
        self.references.len = 0;
        for axis in &mut self.axes {
            axis.events.len = 0;
            axis.fresh.clear();
        }
    }

    /// Takes in the faces of reference `number`, whose box is `bounds` and was another `before`. Returns which events are kept.
    fn add(&mut self, number: u32, bounds: &Bounds, before: &Bounds, node: &Bounds) -> u64 {
        let mut kept = 0;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            kept |= axis.add(number, extent(bounds, i), extent(before, i), extent(node, i)) << (2 * i);
        }
        kept
    }
}

/// Bytes of a list's memory.
fn bytes<T>(list: &Vec<T>) -> u64 {
    (list.capacity() * size_of::<T>()) as u64
}

impl Set {
    fn bytes(&self) -> u64 {
        let axes = self.axes.iter().map(|axis| bytes(&axis.events.room) + bytes(&axis.fresh));
        axes.sum::<u64>() + bytes(&self.references.room)
    }
}

/// A plane that cuts a node.
#[derive(Clone, Copy, Debug)]
struct Plane {
    axis: usize,
    at: f32,
    /// Where references go that lie in it.
    flat: Flat,
    cost: f32,
    /// How many go below and above at most.
    most: [usize; 2],
}

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
    fn cut(&self, plane: &Plane) -> [Self; 2] {
        let mut halves = [Self { depth: self.depth + 1, ..*self }; 2];
        halves[0].bounds.hi[plane.axis] = plane.at;
        halves[1].bounds.lo[plane.axis] = plane.at;
        halves
    }

    /// The same, where `count` references became those of two sets.
    fn cut_to(&self, plane: &Plane, count: usize, halves: &[Set; 2]) -> [Self; 2] {
        let now: usize = halves.iter().map(|half| half.references.len).sum();
        let growth = growth_left(self.growth, count as u32, now as u32);
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

/// The search for the cheapest plane across an axis of a node.
struct Sweep<'a> {
    events: &'a [Event],
    axis: usize,
    across: Across,
    /// The cheapest so far, and the number of its event.
    best: Option<Plane>,
    cost: f32,
    number: usize,
}

/// Events weighed together.
const BATCH: usize = 16;
/// Parts of a list of events: those that cannot hold the cheapest plane are left out.
const PARTS: usize = 32;

/// How many references reach below a plane and above it.
type Counts = [u32; 2];

impl Sweep<'_> {
    /// What is below and above behind all of `events`, if it is `counts` before.
    fn pass(events: &[Event], [below, above]: Counts) -> Counts {
        let sum: u64 = events.iter().map(|e| (e >> 31 & 1) | (e >> 30 & 1) << 32).sum();
        let (starts, flats) = (sum as u32, (sum >> 32) as u32);
        [below + starts + flats, above - (events.len() as u32 - starts)]
    }

    /// Whether the cheapest plane may be one of `events`; what reaches below is counted before them, above behind them.
    fn may_hold(&self, events: &[Event], below: u32, above: u32) -> bool {
        let (from, to) = (position(events[0]), position(events[events.len() - 1]));
        below == 0 || above == 0 || self.across.least(from, to, below as f32, above as f32) <= self.cost
    }

    /// Goes through events `from..to`.
    fn go(&mut self, from: usize, to: usize, mut counts: Counts) {
        for first in (from..to).step_by(BATCH) {
            let events = &self.events[first..to.min(first + BATCH)];
            let behind = Self::pass(events, counts);
            if self.may_hold(events, counts[0], behind[1]) {
                self.weigh(first, events.len(), counts);
            }
            counts = behind;
        }
    }

    /// Weighs so many events from `first` on.
    fn weigh(&mut self, first: usize, len: usize, [mut below, mut above]: Counts) {
        const ROOM: usize = 2 * BATCH;
        let mut at = [f32::INFINITY; ROOM];
        let (mut belows, mut aboves, mut numbers) = ([0.0; ROOM], [0.0; ROOM], [0.0; ROOM]);
        // The candidates behind which what is flat and in the plane lies below.
        let mut flats = 0u32;
        let mut n = 0;
        let mut candidate = |event, below, above, i| {
            (at[n], belows[n], aboves[n]) = (position(event), below as f32, above as f32);
            numbers[n] = i as f32;
            n += 1;
            n - 1
        };
        for i in 0..len {
            let event = self.events[first + i];
            let other = |other: Option<&Event>| other.is_none_or(|other| (other ^ event) & !REFERENCE != 0);
            if event & KIND == PLANAR {
                if other(self.events[..first + i].last()) {
                    candidate(event, below, above, i);
                }
                below += 1;
                above -= 1;
                if other(self.events.get(first + i + 1)) {
                    flats |= 1 << candidate(event, below, above, i);
                }
            } else {
                // Before all that ends in the plane is counted, and after some of what starts there is, it is no cheaper.
                let starts = u32::from(event & KIND == START);
                above -= 1 - starts;
                candidate(event, below, above, i);
                below += starts;
            }
        }
        let (mut least, mut chosen) = (Vec4::INFINITY, Vec4::ZERO);
        let mut number = Vec4::new(0.0, 1.0, 2.0, 3.0);
        for i in (0..n).step_by(4) {
            let four = |numbers: &[f32]| Vec4::from_slice(&numbers[i..]);
            let cost = self.across.cut(four(&at), four(&belows), four(&aboves));
            let less = least.exceeds(cost);
            least = Vec4::select(less, cost, least);
            chosen = Vec4::select(less, number, chosen);
            number += 4.0;
        }
        let cost = least.min_element();
        if cost.is_nan() || cost > self.cost {
            return;
        }
        let chosen = Vec4::select(least.is(Vec4::splat(cost)), chosen, Vec4::INFINITY).min_element() as usize;
        let number = first + numbers[chosen] as usize;
        if cost < self.cost || number < self.number {
            let flat = if flats >> chosen & 1 == 1 { Flat::Below } else { Flat::Above };
            let most = [belows[chosen], aboves[chosen]].map(|n| n as usize);
            self.best = Some(Plane { axis: self.axis, at: at[chosen], flat, cost, most });
            (self.cost, self.number) = (cost, number);
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
    usual: bool,
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
/// Events where a box ends or is flat, where it starts, and on all axes: those on axis `i` are by `2 i` bits higher.
const ENDS: u64 = 1 << 32;
const STARTS: u64 = 2 << 32;
const ALL: u64 = 0x3F << 32;

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
            let target =
                [below | if *side == BELOW { ALL } else { 0 }, above | if *side == ABOVE { ALL } else { 0 }];
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

/// How far a box reaches on an axis.
#[inline(always)]
fn extent(bounds: &Bounds, axis: usize) -> (f32, f32) {
    (bounds.lo.as_ref()[axis], bounds.hi.as_ref()[axis])
}

/// The cheaper one, the first if they cost the same.
#[inline(always)]
fn cheaper(a: Option<Plane>, b: Option<Plane>) -> Option<Plane> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.cost < a.cost { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// The cheapest plane across an axis of a small node, if one costs less than `cost`: every face is weighed against every box.
#[inline(always)]
fn faces_of(references: &[Reference], axis: usize, across: &Across, cost: f32) -> Option<Plane> {
    let faces = |i: usize| extent(&references[i].bounds, axis);
    let mut flat = Flat::Above;
    let (mut least, mut at) = cheapest(references.len(), faces, across, flat, |at, _| at);
    if (0..references.len()).any(|i| faces(i).0 == faces(i).1) {
        let (other, there) = cheapest(references.len(), faces, across, Flat::Below, |at, _| at);
        if other < least || (other == least && there < at) {
            (flat, least, at) = (Flat::Below, other, there);
        }
    }
    (least < cost).then_some(Plane { axis, at, flat, cost: least, most: [references.len(); 2] })
}

/// The cheapest plane of a small node, if one costs less than a leaf.
#[inline(always)]
fn face(references: &[Reference], sah: &Sah) -> Option<Plane> {
    let mut best = None;
    for axis in 0..3 {
        best = cheaper(best, faces_of(references, axis, &sah.across(axis as u32), sah.leaf));
    }
    best
}

/// The same, compiled for the usual instructions.
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt"))]
unsafe fn face_usually(references: &[Reference], sah: &Sah) -> Option<Plane> {
    face(references, sah)
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
        let large: u64 = locked(&self.large).iter().map(Set::bytes).sum();
        let each = |spare: &Spare| {
            spare.shares.bytes()
                + bytes(&spare.small)
                + spare.sets.iter().flatten().map(Set::bytes).sum::<u64>()
        };
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

    /// The cheapest plane across an axis, if one costs less than `cost`.
    fn sweep(&self, set: &Set, axis: usize, sah: &Sah, cost: f32) -> Option<Plane> {
        let events = set.axes[axis].events.all();
        let across = sah.across(axis as u32);
        let mut sweep = Sweep { events, axis, across, best: None, cost, number: 0 };
        let all = set.references.len as u32;
        let len = events.len().div_ceil(PARTS).next_multiple_of(BATCH).max(BATCH);
        let mut counts = [[0, all]; PARTS + 1];
        let parts = || events.chunks(len).enumerate();
        for (i, part) in parts() {
            counts[i + 1] = Sweep::pass(part, counts[i]);
        }
        // What starts at the node's lower face has no event.
        let begun = all - counts[events.len().div_ceil(len)][0];
        let mut likeliest = 0;
        let mut least = f32::INFINITY;
        for (i, part) in parts() {
            counts[i][0] += begun;
            let (from, to) = (position(part[0]), position(part[part.len() - 1]));
            let bound = across.least(from, to, counts[i][0] as f32, counts[i + 1][1] as f32);
            if bound < least {
                (likeliest, least) = (i, bound);
            }
        }
        if let Some(part) = events.chunks(len).nth(likeliest) {
            sweep.go(likeliest * len, likeliest * len + part.len(), counts[likeliest]);
        }
        for (i, part) in parts() {
            if i != likeliest && sweep.may_hold(part, counts[i][0], counts[i + 1][1]) {
                sweep.go(i * len, i * len + part.len(), counts[i]);
            }
        }
        sweep.best
    }

    /// Counts references, and notes when there are too many.
    fn count(&self, so_far: &AtomicUsize, references: usize) {
        if so_far.fetch_add(references, Relaxed) + references > self.most {
            self.full.store(true, Relaxed);
        }
    }

    /// The plane that cuts the node, or none if it becomes a leaf.
    fn choose(&self, set: &Set, cell: &Cell, parallel: bool) -> Option<Plane> {
        let sah = self.sah(cell, set.references.len)?;
        let sweep = |axis, cost| self.sweep(set, axis, &sah, cost);
        if parallel {
            let leaf = sah.leaf;
            let (x, (y, z)) =
                rayon::join(|| sweep(0, leaf), || rayon::join(|| sweep(1, leaf), || sweep(2, leaf)));
            return cheaper(cheaper(x, y), z);
        }
        (0..3).fold(None, |best, axis| sweep(axis, best.map_or(sah.leaf, |plane: Plane| plane.cost)).or(best))
    }

    /// What planes cost in a node of so many references, if any may pay.
    fn sah(&self, cell: &Cell, count: usize) -> Option<Sah> {
        let Bounds { lo, hi } = cell.bounds;
        let most = self.costs.most(lo, hi, count as u32, cell.growth);
        let sah = Sah::new(lo, hi, count as u32, most, self.costs);
        (cell.depth < self.max_depth && sah.may_pay && !self.full.load(Relaxed)).then_some(sah)
    }

    /// Says where the references of a node go, and what there is of those that are cut.
    fn share(&self, references: &[Reference], plane: &Plane, cells: &[Cell; 2], shares: &mut Shares) {
        let (at, flat_below) = (plane.at, plane.flat == Flat::Below);
        let (sides, straddling) = (&mut shares.sides, &mut shares.straddling);
        sides.resize(references.len(), 0);
        straddling.resize(references.len(), 0);
        let mut number = 0;
        for (i, (reference, side)) in references.iter().zip(&mut *sides).enumerate() {
            let (lo, hi) = extent(&reference.bounds, plane.axis);
            // What touches the plane from one side is on that side only.
            let flat = (lo == at) & (hi == at);
            let (below, above) = ((lo < at) | (flat & flat_below), (hi > at) | (flat & !flat_below));
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
            sides[i as usize] = (u32::from(below) * BELOW) | (u32::from(above) * ABOVE) | CUT;
            shares.halves.push([under, over]);
        }
    }

    /// Distributes the references of a node to its children.
    fn split(
        &self,
        set: &Set,
        plane: &Plane,
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
        let sorted = plane.most.map(|most| most > SMALL);
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
        if references.len() <= SMALL {
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
            // SAFETY: the processor has these instructions.
            if self.usual { unsafe { face_usually(references, &sah) } } else { face(references, &sah) }
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
        // What goes above comes behind the node's own, then what goes below, which is built first. Each with room for one more.
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
        let mut spare = locked(&self.pool.spares).pop().unwrap_or_default();
        if set.references.len > GRAIN
            && let Some(plane) = self.choose(&set, cell, true)
        {
            let cells = cell.cut(&plane);
            let mut halves = [(); 2].map(|()| locked(&self.pool.large).pop().unwrap_or_default());
            self.split(&set, &plane, &cells, &mut halves, &mut spare.shares, true);
            let cells = cell.cut_to(&plane, set.references.len, &halves);
            locked(&self.pool.spares).push(spare);
            locked(&self.pool.large).push(set);
            let [low, high] = halves;
            let (below, above) = rayon::join(|| self.branch(low, &cells[0]), || self.branch(high, &cells[1]));
            return Part::Cut(plane, Box::new([below, above]));
        }
        // About what surface meshes need.
        let n = set.references.len;
        let (nodes, refs) = (Vec::with_capacity(5 * n), Vec::with_capacity(5 * n));
        let mut tree = Branch { nodes, refs, depth: 0 };
        let root = self.grow(&set, cell, &mut tree, &mut spare);
        locked(&self.pool.spares).push(spare);
        locked(&self.pool.large).push(set);
        Part::Grown(root, tree)
    }
}

/// What a build by [`build_counted`] took beside its result.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Taken {
    /// Most bytes held at once, the mesh included.
    pub bytes: u64,
    /// Tries before the last, and what they took.
    pub retries: u32,
    pub failed: Duration,
}

/// Builds the tree of `mesh` on the CPU, by the threads of the current rayon pool. The same mesh and options give
/// the same bytes. Where splitting does not separate the triangles, the depth is halved until memory suffices.
pub(crate) fn build(mesh: &Mesh, options: &BuildOptions) -> KdTree {
    build_counted(mesh, options).0
}

/// The same, and what it took.
pub(crate) fn build_counted(mesh: &Mesh, options: &BuildOptions) -> (KdTree, Taken) {
    let mut depth = options.max_depth.min(MAX_DEPTH);
    let mut taken = Taken::default();
    loop {
        let begin = Instant::now();
        // A single leaf always fits.
        if let Some((tree, bytes)) = attempt(mesh, &BuildOptions { max_depth: depth, ..options.clone() }) {
            return (tree, Taken { bytes, ..taken });
        }
        depth /= 2;
        taken.retries += 1;
        taken.failed += begin.elapsed();
    }
}

/// Gives up if the leaves, or the nodes of some depth, get too long in all.
fn attempt(mesh: &Mesh, options: &BuildOptions) -> Option<(KdTree, u64)> {
    let positions = mesh.scaled_positions();
    let (lo, hi) = mesh.scaled_bounds();
    let params = params(mesh, options, levels::first_guess(mesh.kept().len() as u32), options.max_depth);
    let builder = Builder {
        positions: &positions,
        triangles: mesh.triangles(),
        costs: Costs::of(&params),
        max_depth: options.max_depth,
        clip: options.clip,
        usual: has_usual_instructions(),
        pool: Pool::default(),
        listed: AtomicUsize::new(0),
        passed: [const { AtomicUsize::new(0) }; MAX_DEPTH as usize + 1],
        full: AtomicBool::new(false),
        most: most_refs(mesh.kept().len() as u32) as usize,
    };
    let bounds = Bounds { lo: Vec3::from_array(lo), hi: Vec3::from_array(hi) };
    let mut set = Set::default();
    set.references.room.reserve(mesh.kept().len());
    set.axes.iter_mut().for_each(|axis| axis.fresh.reserve(2 * mesh.kept().len()));
    let nowhere = Bounds { lo: Vec3::INFINITY, hi: Vec3::NEG_INFINITY };
    for &triangle in mesh.kept() {
        let [a, b, c] = builder.corners(triangle);
        let reference = Reference { triangle, cell: 0, bounds: Bounds::of(a, b, c) };
        set.add(set.references.room.len() as u32, &reference.bounds, &nowhere, &bounds);
        set.references.room.push(reference);
    }
    set.references.len = set.references.room.len();
    set.axes.par_iter_mut().for_each(|axis| {
        axis.events = List { len: axis.fresh.len(), room: std::mem::take(&mut axis.fresh) };
        axis.events.sort();
    });
    let part = builder.branch(set, &Cell { bounds, depth: 0, growth: growth(mesh.kept().len() as u32) });
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
        mesh: [0; 2],
        checksum: 0,
    };
    let held = held + bytes(&tree.nodes) + bytes(&tree.refs);
    Some((KdTree { header, nodes: tree.nodes, refs: tree.refs }, held))
}
