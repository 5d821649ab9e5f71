//! The faces of a node's boxes, in order along each axis.
//!
//! An event is one word: position, kind, reference; comparing events is comparing integers, and no two are equal.

use raykd_kernels::{
    bounds::Bounds,
    build::{
        bin::{ordered, unordered},
        reference::Reference,
    },
};

/// A face of a reference's box: position (ordered as an integer), kind, reference.
pub(super) type Event = u64;

/// The low bits: which of the node's references.
pub(super) const REFERENCE: u64 = (1 << 30) - 1;
/// What ends at a plane lies below it, what starts there lies above, so ends come first.
pub(super) const END: u64 = 0;
/// A box that is flat on this axis.
pub(super) const PLANAR: u64 = 1 << 30;
pub(super) const START: u64 = 2 << 30;
pub(super) const KIND: u64 = 3 << 30;

pub(super) fn position(event: Event) -> f32 {
    unordered((event >> 32) as u32)
}

pub(super) fn event(at: f32, kind: u64, reference: u32) -> Event {
    u64::from(ordered(at)) << 32 | kind | u64::from(reference)
}

/// A list that is written from the front without being cleared.
#[derive(Debug)]
pub(super) struct List<T> {
    pub(super) room: Vec<T>,
    pub(super) len: usize,
}

impl<T> Default for List<T> {
    fn default() -> Self {
        Self { room: Vec::new(), len: 0 }
    }
}

impl<T: Copy> List<T> {
    pub(super) fn all(&self) -> &[T] {
        &self.room[..self.len]
    }

    /// Makes room for `n`, full of something.
    pub(super) fn reserve(&mut self, n: usize, something: T) {
        if self.room.len() < n {
            // Fresh pages are zero without being written.
            self.room = vec![something; n + n / 4];
        }
    }
}

impl List<Event> {
    /// Sorts what is in order of references: by digits, the lowest first.
    pub(super) fn sort(&mut self) {
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
    pub(super) fn merge(&mut self, fresh: &mut [Event]) {
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
pub(super) struct Axis {
    pub(super) events: List<Event>,
    /// New events.
    pub(super) fresh: Vec<Event>,
}

/// Events of a reference where its box ends or is flat, and where it starts: those on axis `i` are by `2 i`
/// bits higher.
pub(super) const ENDS: u64 = 1 << 32;
pub(super) const STARTS: u64 = 2 << 32;

impl Axis {
    /// Takes in the faces of a reference, but for those where its box had one `before`, whose events are kept; and what
    /// starts or ends at a face of the node needs none. Returns [`ENDS`] and [`STARTS`] for what is kept.
    pub(super) fn add(
        &mut self,
        reference: u32,
        lo_hi: (f32, f32),
        before: (f32, f32),
        node: (f32, f32),
    ) -> u64 {
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
pub(super) struct Set {
    /// By triangle, rising; their boxes hold what the node holds of them.
    pub(super) references: List<Reference>,
    /// Their faces, unless the node is small.
    pub(super) axes: [Axis; 3],
}

impl Set {
    pub(super) fn clear(&mut self) {
        self.references.len = 0;
        for axis in &mut self.axes {
            axis.events.len = 0;
            axis.fresh.clear();
        }
    }

    /// Takes in the faces of reference `number`, whose box is `bounds` and was another `before`. Returns
    /// which events are kept.
    pub(super) fn add(&mut self, number: u32, bounds: &Bounds, before: &Bounds, node: &Bounds) -> u64 {
        let mut kept = 0;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            kept |= axis.add(number, extent(bounds, i), extent(before, i), extent(node, i)) << (2 * i);
        }
        kept
    }
}

/// Bytes of a list's memory.
pub(super) fn bytes<T>(list: &Vec<T>) -> u64 {
    (list.capacity() * size_of::<T>()) as u64
}

impl Set {
    pub(super) fn bytes(&self) -> u64 {
        let axes = self.axes.iter().map(|axis| bytes(&axis.events.room) + bytes(&axis.fresh));
        axes.sum::<u64>() + bytes(&self.references.room)
    }
}

/// How far a box reaches on an axis.
#[inline(always)]
pub(super) fn extent(bounds: &Bounds, axis: usize) -> (f32, f32) {
    (bounds.lo.as_ref()[axis], bounds.hi.as_ref()[axis])
}
