//! The search for the cheapest plane of a node.
//!
//! One pass over events in order counts references on either side of each face. Counts and areas rise on the
//! one side of a plane and fall on the other, so that a part of the list tells by its first and its last
//! event what a plane in it costs at least; only parts that may hold the cheapest are weighed. In small nodes
//! every face is weighed against every box.

use super::events::{Event, KIND, PLANAR, REFERENCE, START, Set, extent, position};
use raykd_kernels::{
    Usual,
    build::{
        Across, Sah, SplitPlane,
        faces::{First, Flat, MOST, cheapest},
        reference::Reference,
    },
    glam::Vec4,
    math::Number,
};
use raykd_shared::Node;

/// A plane that cuts a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Split {
    pub(super) axis: usize,
    pub(super) at: f32,
    /// Where references go that lie in it.
    pub(super) flat: Flat,
    pub(super) cost: f32,
    /// How many go below and above at most.
    pub(super) most: [usize; 2],
}

impl Split {
    /// [`Sah::middle`] of a node of so many references.
    pub(super) fn middle(sah: &Sah, count: usize) -> Option<Self> {
        let SplitPlane { axis, at, .. } = sah.middle(count as u32);
        let plane =
            Self { axis: axis as usize, at, flat: Flat::Below, cost: f32::INFINITY, most: [count; 2] };
        (axis != Node::LEAF).then_some(plane)
    }

    /// Whether it makes the node cheaper.
    pub(super) fn pays(&self) -> bool {
        self.cost < f32::INFINITY
    }
}

/// The cheapest plane across an axis, if one costs less than `cost`.
pub(super) fn cheapest_across(set: &Set, axis: usize, sah: &Sah, cost: f32) -> Option<Split> {
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

/// The search for the cheapest plane across an axis of a node.
struct Sweep<'a> {
    events: &'a [Event],
    axis: usize,
    across: Across,
    /// The cheapest so far, and the number of its event.
    best: Option<Split>,
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
                // Before all that ends in the plane is counted, and after some of what starts there is, it is
                // no cheaper.
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
            self.best = Some(Split { axis: self.axis, at: at[chosen], flat, cost, most });
            (self.cost, self.number) = (cost, number);
        }
    }
}

/// The cheaper one, the first if they cost the same.
#[inline(always)]
pub(super) fn cheaper(a: Option<Split>, b: Option<Split>) -> Option<Split> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.cost < a.cost { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// The cheapest plane of a small node, if one costs less than a leaf: every face is weighed against every box.
#[inline(always)]
fn weighed(usual: Usual, references: &[Reference], sah: &Sah) -> Option<Split> {
    let number = references.len();
    let (mut lows, mut highs) = ([[0; MOST]; 3], [[0; MOST]; 3]);
    let mut has_flat = false;
    for axis in 0..3 {
        for ((low, high), reference) in lows[axis].iter_mut().zip(&mut highs[axis]).zip(references) {
            let (lo, hi) = extent(&reference.bounds, axis);
            (*low, *high) = (lo.to_bits(), hi.to_bits());
            has_flat |= lo == hi;
        }
    }
    // No closures: they would not be compiled for the same instructions.
    let faces = [(&lows[0][..], &highs[0][..]), (&lows[1][..], &highs[1][..]), (&lows[2][..], &highs[2][..])];
    let across = [sah.across(0), sah.across(1), sah.across(2)];
    let above = cheapest(usual, faces, number as u32, &across, Flat::Above, First::Place);
    let mut below = [(f32::INFINITY, f32::INFINITY); 3];
    if has_flat {
        below = cheapest(usual, faces, number as u32, &across, Flat::Below, First::Place);
    }
    let mut best = None;
    let mut least = sah.leaf;
    for axis in 0..3 {
        let ((mut cost, mut at), mut flat) = (above[axis], Flat::Above);
        let (other, there) = below[axis];
        if other < cost || (other == cost && there < at) {
            (flat, cost, at) = (Flat::Below, other, there);
        }
        if cost < least {
            least = cost;
            best = Some(Split { axis, at, flat, cost, most: [number; 2] });
        }
    }
    best
}

/// The cheapest plane of a small node, if one costs less than a leaf.
pub(super) fn face(references: &[Reference], sah: &Sah) -> Option<Split> {
    weighed(Usual::NO, references, sah)
}

/// The same, compiled for the usual instructions.
///
/// # Safety
/// The processor has them.
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt"))]
pub(super) unsafe fn face_usually(usual: Usual, references: &[Reference], sah: &Sah) -> Option<Split> {
    weighed(usual, references, sah)
}
