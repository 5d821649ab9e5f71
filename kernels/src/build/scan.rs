//! Exclusive scan of several sums over the 256 lanes of one workgroup.

use crate::{
    Group,
    glam::UVec2,
    mem::{Buf, Slots, Table},
};

/// Lanes of a scanning workgroup.
pub(super) const LANES: u32 = 256;
const BLOCK: u32 = 32;
const BLOCKS: u32 = LANES / BLOCK;
/// From a kind to the next.
const PITCH: u32 = LANES + BLOCKS;

/// Words for the sums of `kinds` kinds: what each lane adds, then what comes before it in its block of lanes.
pub(super) const fn sums(kinds: u32) -> usize {
    (kinds * PITCH) as usize
}

/// Words for the blocks: what comes before each block, then the total of each kind.
pub(super) const fn blocks(kinds: u32) -> usize {
    (kinds * BLOCKS + kinds) as usize
}

/// Where what `lane` adds to `kind` stands: a word is left free behind every block of lanes, or those that
/// add blocks up would all ask the same bank of a GPU's workgroup memory at a time.
#[inline(always)]
pub(super) fn word(kind: u32, lane: u32) -> u32 {
    kind * PITCH + lane + lane / BLOCK
}

/// Replaces each of `count` words, a multiple of four, by the sum of those before it, and returns the sum of
/// all.
#[inline(always)]
pub(super) fn serial(table: &mut impl Table, from: u32, count: u32) -> u32 {
    let mut sum = 0;
    let mut i = from;
    while i < from + count {
        let [a, b, c, d] = table.four(i);
        table.put(i, sum);
        table.put(i + 1, sum + a);
        table.put(i + 2, sum + a + b);
        table.put(i + 3, sum + a + b + c);
        sum += a + b + c + d;
        i += 4;
    }
    sum
}

/// Replaces each of `count` words, a multiple of four, by the sum of it and those behind it.
#[inline(always)]
pub(super) fn serial_back(table: &mut impl Table, from: u32, count: u32) {
    let mut sum = 0;
    let mut i = from + count;
    while i > from {
        i -= 4;
        let [a, b, c, d] = table.four(i);
        table.put(i + 3, sum + d);
        table.put(i + 2, sum + d + c);
        table.put(i + 1, sum + d + c + b);
        sum += a + b + c + d;
        table.put(i, sum);
    }
}

/// Scans in place: first within blocks of lanes, then over blocks.
#[inline(always)]
pub(super) fn scan(group: Group, kinds: u32, sums: &mut impl Table, blocks: &mut impl Table) {
    lanes!(group, |lane| {
        if lane < kinds * BLOCKS {
            blocks.put(lane, serial(sums, lane * (BLOCK + 1), BLOCK));
        }
    });
    lanes!(group, |lane| {
        if lane < kinds {
            let total = serial(blocks, lane * BLOCKS, BLOCKS);
            blocks.put(kinds * BLOCKS + lane, total);
        }
    });
}

/// Replaces each of `number` counts from `first` on by the sum of those before it; [`total`] then tells the sum of all.
/// Each lane has as many, one after the other.
#[inline(always)]
pub(super) fn scan_counts(
    group: Group,
    sums: &mut impl Table,
    parts: &mut impl Table,
    counts: &mut Buf<u32>,
    first: u32,
    number: u32,
) {
    let share = number.div_ceil(LANES);
    lanes!(group, |lane| {
        let mut sum = 0;
        let mut i = lane * share;
        while i < (lane + 1) * share && i < number {
            sum += counts.at(first + i);
            i += 1;
        }
        sums.put(word(0, lane), sum);
    });
    scan(group, 1, sums, parts);
    lanes!(group, |lane| {
        let mut sum = before(sums, parts, 0, lane);
        let mut i = lane * share;
        while i < (lane + 1) * share && i < number {
            let count = counts.at(first + i);
            counts.put(first + i, sum);
            sum += count;
            i += 1;
        }
    });
}

/// What entry `i` counts, nothing from `end` on.
#[inline(always)]
fn up_to(i: u32, end: u32, counts: &Buf<UVec2>) -> UVec2 {
    if i < end { counts.at(i) } else { UVec2::new(0, 0) }
}

/// Replaces each of `number` pairs of counts from `first` on by the sums of those before it; [`total`] then tells the
/// sums of all.
#[inline(always)]
pub(super) fn scan_pairs(
    group: Group,
    sums: &mut impl Table,
    parts: &mut impl Table,
    counts: &mut Buf<UVec2>,
    first: u32,
    number: u32,
) {
    let share = number.div_ceil(LANES);
    lanes!(group, |lane| {
        let mut sum = UVec2::new(0, 0);
        let mut i = first + lane * share;
        let end = first + if (lane + 1) * share < number { (lane + 1) * share } else { number };
        while i < end {
            // Read side by side: a GPU would wait for each.
            let (a, b) = (up_to(i, end, counts), up_to(i + 1, end, counts));
            let (c, d) = (up_to(i + 2, end, counts), up_to(i + 3, end, counts));
            sum += a + b + c + d;
            i += 4;
        }
        sums.put(word(0, lane), sum.x);
        sums.put(word(1, lane), sum.y);
    });
    scan(group, 2, sums, parts);
    lanes!(group, |lane| {
        let mut sum = UVec2::new(before(sums, parts, 0, lane), before(sums, parts, 1, lane));
        let mut i = lane * share;
        while i < (lane + 1) * share && i < number {
            let own = counts.at(first + i);
            counts.put(first + i, sum);
            sum += own;
            i += 1;
        }
    });
}

/// What all lanes before `lane` add to `kind`, after [`scan`].
#[inline(always)]
pub(super) fn before(sums: &impl Table, blocks: &impl Table, kind: u32, lane: u32) -> u32 {
    sums.at(word(kind, lane)) + blocks.at(kind * BLOCKS + lane / BLOCK)
}

/// What all lanes add to `kind`, after [`scan`].
#[inline(always)]
pub(super) fn total(kinds: u32, blocks: &impl Table, kind: u32) -> u32 {
    blocks.at(kinds * BLOCKS + kind)
}
