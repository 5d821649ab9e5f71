//! Sorts by digits: which kernels run, over which buffers.

use super::room::Arena;
use crate::{
    Error,
    exec::{Buffer, Launch, Step},
};
use raykd_kernels::{
    build::radix::{BLOCK, DIGITS, Pass, VALUES, deal, digits, runs},
    glam::UVec2,
};

/// In which of two buffers it begins, to end in the first.
pub(super) const UNSORTED: usize = DIGITS as usize % 2;

/// Sorts lists that are of one length.
pub(super) struct Radix {
    passes: Vec<Buffer<u32>>,
    counts: Buffer<u32>,
    totals: Buffer<u32>,
    lists: u32,
    blocks: u32,
}

impl Radix {
    /// For so many lists of so many elements, which have room for so many.
    pub(super) fn new(arena: &mut Arena<'_>, lists: u32, elements: u32, room: u32) -> Result<Self, Error> {
        let blocks = elements.div_ceil(BLOCK);
        let mut pass = |digit| -> Result<Buffer<u32>, Error> {
            Ok(arena.upload("digit", &[Pass { digit, lists, elements, room }])?.view())
        };
        Ok(Self {
            passes: (0..DIGITS).map(&mut pass).collect::<Result<_, _>>()?,
            counts: arena.alloc("digit counts", blocks, lists * VALUES)?,
            totals: arena.alloc("digit totals", lists, VALUES)?,
            lists,
            blocks,
        })
    }

    /// Sorts the lists in the buffer [`UNSORTED`] into the first one, by way of both.
    pub(super) fn steps<'b>(&'b self, elements: &'b [Buffer<UVec2>; 2]) -> impl Iterator<Item = Step<'b>> {
        let Self { counts, totals, lists, blocks, .. } = self;
        self.passes.iter().zip(UNSORTED..).flat_map(move |(pass, i)| {
            let (from, to) = (&elements[i % 2], elements[(i + 1) % 2].out());
            let digits = digits::Buffers { pass, from, counts: counts.out() };
            let runs = runs::Buffers { pass, counts: counts.out(), totals: totals.out() };
            let deal = deal::Buffers { pass, from, counts, totals, to };
            [digits.groups(lists * blocks), runs.groups(lists * VALUES), deal.groups(lists * blocks)]
        })
    }
}
