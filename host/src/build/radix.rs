//! Sorts by digits (Knuth 1998, section 5.2.5): which kernels run, over which buffers.

use super::room::Arena;
use crate::{
    Error,
    exec::{Buffer, Launch, Step},
};
use raykd_kernels::{
    build::sweep::{
        deal,
        digits::{self, BLOCK, DIGITS, VALUES},
        runs,
    },
    glam::UVec2,
};

/// In which of two buffers it begins, to end in the first.
pub(super) const UNSORTED: usize = DIGITS as usize % 2;

/// Sorts lists that are of one length.
pub(super) struct Radix {
    passes: Vec<Buffer<UVec2>>,
    counts: Buffer<u32>,
    totals: Buffer<u32>,
    lists: u32,
    blocks: u32,
}

impl Radix {
    /// For so many lists of so many elements, which have room for so many.
    pub(super) fn new(arena: &mut Arena<'_>, lists: u32, elements: u32, room: u32) -> Result<Self, Error> {
        let blocks = elements.div_ceil(BLOCK);
        let pass = |digit| arena.upload("digit", &[UVec2::new(digit, room)]);
        Ok(Self {
            passes: (0..DIGITS).map(pass).collect::<Result<_, _>>()?,
            counts: arena.alloc("digit counts", blocks, lists * VALUES)?,
            totals: arena.alloc("digit totals", lists, VALUES)?,
            lists,
            blocks,
        })
    }

    /// Sorts the lists in the buffer [`UNSORTED`] into the first one, by way of both. `level` is the record of a level
    /// that has them.
    pub(super) fn steps<'b>(
        &'b self,
        level: &'b Buffer<u32>,
        elements: &'b [Buffer<UVec2>; 2],
    ) -> impl Iterator<Item = Step<'b>> {
        let Self { counts, totals, lists, blocks, .. } = self;
        self.passes.iter().zip(UNSORTED..).flat_map(move |(pass, i)| {
            let (from, to) = (&elements[i % 2], elements[(i + 1) % 2].out());
            let digits = digits::Buffers { pass, level, from, counts: counts.out() };
            let runs = runs::Buffers { level, counts: counts.out(), totals: totals.out() };
            let deal = deal::Buffers { pass, level, from, counts, totals, to };
            [digits.groups(lists * blocks), runs.groups(lists * VALUES), deal.groups(lists * blocks)]
        })
    }
}
