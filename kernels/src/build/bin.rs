//! Counts of references per bin of one node.
//!
//! Min-max binning (Shevtsov, Soupikov & Kapustin 2007): one counter for the bin where a box starts, one for
//! where it ends; sums of them give the exact number of boxes on either side of every bin border, up to the
//! rounding of the bin's index. The tree does not depend on that: `count` and `scatter` use the plane itself.
//! And the last end and the first start in each bin: planes there cut fewer triangles than one at the bin's
//! border.

use super::{Item, LEVEL_CHUNKS, chunk_of, reference::Words};
use crate::{
    Group, ON_GPU,
    glam::{UVec4, Vec3},
    math::{component, ratio, whole},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{
    BuildParams,
    limits::{BINS, BRANCH},
};

// Where they stand in a histogram, for each axis.
/// How many boxes start in a bin.
pub const STARTS: u32 = 0;
/// How many end there.
pub const ENDS: u32 = 3 * BINS;
/// Where the first that starts in a bin does, [`ordered`] and inverted; [`UNTOLD`] if a flat one does, which
/// lies below a plane through it.
pub const FIRST_STARTS: u32 = 6 * BINS;
/// Where the last that ends in a bin does, [`ordered`].
pub const LAST_ENDS: u32 = 9 * BINS;
/// No first start is told.
pub const UNTOLD: u32 = u32::MAX;
/// Words of a node's histogram.
pub const HIST_WORDS: u32 = 12 * BINS;
/// Where the histogram starts in workgroup memory: [`super::split`] reads a word before it, which does not
/// matter.
pub const BEFORE: u32 = 2;
/// Words for it there.
pub const TABLE: usize = (BEFORE + HIST_WORDS) as usize;

/// Where a histogram's word stands in workgroup memory while boxes are entered: on a CPU, which changes both at once, a
/// count beside the place in the same bin.
#[inline(always)]
const fn entered(word: u32) -> u32 {
    if ON_GPU {
        BEFORE + word
    } else if word < FIRST_STARTS {
        BEFORE + 2 * word
    } else {
        BEFORE + 2 * (word - FIRST_STARTS) + 1
    }
}

/// Puts the words of a histogram into their order, when all boxes are entered.
#[inline(always)]
fn put_in_order(table: &mut [u32; TABLE]) {
    let entries = *table;
    let mut count = 0;
    while count < FIRST_STARTS {
        table.put(BEFORE + count, entries.at(BEFORE + 2 * count));
        table.put(BEFORE + FIRST_STARTS + count, entries.at(BEFORE + 2 * count + 1));
        count += 1;
    }
}

/// How many large nodes may have histograms, if lists have room for so many references.
#[inline(always)]
pub const fn histograms(level_refs: u32) -> u32 {
    level_refs / BRANCH + 1
}

/// The bin of coordinate `x`.
#[inline(always)]
fn bin_of(x: f32, lo: f32, per_bin: f32) -> u32 {
    // Boxes that are not clipped reach beyond the node; what starts before it starts in its first bin.
    whole::<{ BINS - 1 }>((x - lo) * per_bin)
}

/// Numbers as integers in the same order; all above 0.
#[inline(always)]
pub fn ordered(x: f32) -> u32 {
    ordered_bits(x.to_bits())
}

/// The same of a number's bits.
#[inline(always)]
pub const fn ordered_bits(bits: u32) -> u32 {
    if bits >> 31 == 0 { bits | 0x8000_0000 } else { !bits }
}

/// The number that [`ordered`] made this of.
#[inline(always)]
pub fn unordered(bits: u32) -> f32 {
    f32::from_bits(if bits >> 31 == 0 { !bits } else { bits & 0x7FFF_FFFF })
}

/// Counts a box's start and end on an axis.
#[inline(always)]
fn enter(table: &mut [u32; TABLE], axis: u32, lo: f32, hi: f32, from: f32, per_bin: f32) {
    let start = axis * BINS + bin_of(lo, from, per_bin);
    let end = axis * BINS + bin_of(hi, from, per_bin);
    table.add(entered(STARTS + start), 1);
    table.add(entered(ENDS + end), 1);
    table.raise(entered(LAST_ENDS + end), ordered(hi));
    table.raise(entered(FIRST_STARTS + start), if lo < hi { !ordered(lo) } else { UNTOLD });
}

/// Clears a table, and finds how many bins there are to a unit of length on each axis of a box.
#[inline(always)]
pub fn start(group: Group, table: &mut [u32; TABLE], rate: &mut [u32; 3], lo: Vec3, hi: Vec3) {
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = lane;
        while word < HIST_WORDS {
            table.put(BEFORE + word, 0);
            word += step;
        }
        let mut axis = lane;
        while axis < 3 {
            let d = component(hi, axis) - component(lo, axis);
            rate.put(axis, if d < super::FLAT { 0 } else { ratio(BINS as f32, d).to_bits() });
            axis += step;
        }
    });
}

/// What [`start`] found.
#[inline(always)]
pub fn rates(rate: &[u32; 3]) -> Vec3 {
    let on = move |rate: &[u32; 3], axis: u32| f32::from_bits(rate.at(axis));
    Vec3::new(on(rate, 0), on(rate, 1), on(rate, 2))
}

/// Counts a box's starts and ends, in a node that begins at `from`.
#[inline(always)]
pub fn enter_box(group: &Group, table: &mut [u32; TABLE], rates: Vec3, from: Vec3, part: Words) {
    by_eight!(
        group.usual,
        Eight::enter::<{ BEFORE as usize }, TABLE>(table, part.lo, part.hi, from, rates),
        else {
            let part = part.bounds();
            enter(table, 0, part.lo.x, part.hi.x, from.x, rates.x);
            enter(table, 1, part.lo.y, part.hi.y, from.y, rates.y);
            enter(table, 2, part.lo.z, part.hi.z, from.z, rates.z);
        }
    );
}

/// The histogram of `count` references from `first` on, of node `item`.
#[inline(always)]
fn fill(
    group: Group,
    table: &mut [u32; TABLE],
    rate: &mut [u32; 3],
    item: &Item,
    refs: &Buf<UVec4>,
    first: u32,
    count: u32,
) {
    start(group, table, rate, item.lo, item.hi);
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let rates = rates(rate);
        let mut i = lane;
        while i < count {
            enter_box(&group, table, rates, item.lo, Words::load(refs, first + i));
            i += step;
        }
    });
}

/// The same, with its words in order.
#[inline(always)]
pub fn fill_in_order(
    group: Group,
    table: &mut [u32; TABLE],
    rate: &mut [u32; 3],
    item: &Item,
    refs: &Buf<UVec4>,
    first: u32,
    count: u32,
) {
    fill(group, table, rate, item, refs, first, count);
    if !ON_GPU {
        put_in_order(table);
    }
}

/// Reads the histogram of a node.
#[inline(always)]
pub fn read(group: Group, table: &mut [u32; TABLE], hists: &Buf<u32>, node: u32) {
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = lane;
        while word < HIST_WORDS {
            table.put(BEFORE + word, hists.at(node * HIST_WORDS + word));
            word += step;
        }
    });
}

/// Adds a table to the histogram of a node.
#[inline(always)]
pub fn add(group: Group, table: &[u32; TABLE], hists: &mut Buf<u32>, node: u32) {
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = lane;
        while word < HIST_WORDS {
            let (at, value) = (node * HIST_WORDS + word, table.at(entered(word)));
            if value != 0 && word < FIRST_STARTS {
                hists.add(at, value);
            } else if value != 0 {
                hists.raise(at, value);
            }
            word += step;
        }
    });
}

/// Adds chunk `group.id` to the histogram of the root; those of other nodes are made by [`super::scatter`].
#[inline(always)]
pub fn bin(
    group: Group,
    table: &mut [u32; TABLE],
    rate: &mut [u32; 3],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    refs: &Buf<UVec4>,
    hists: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) {
        let (node, item, first, count) = chunk_of(group.id, params.at(0).references, chunks, active);
        fill(group, table, rate, &item, refs, first, count);
        add(group, table, hists, node);
    }
}

kernel! {
    /// [`bin`] over all chunks of the root.
    group BIN = bin, threads 256, shared [table: TABLE, rate: 3], {
        0 params: read BuildParams, 1 level: read u32, 2 active: read UVec4, 3 chunks: read u32, 4 refs: read UVec4,
        5 hists: write u32,
    }
}
