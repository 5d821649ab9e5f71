//! How many elements of a list with a digit's value lie in the blocks before each: one workgroup a list and value.

use super::{BLOCK, PASS_ELEMENTS, PASS_LISTS, VALUES};
use crate::{
    Group,
    build::scan::{self, scan_counts, total},
    mem::{Buf, Slots},
};

const SUMS: usize = scan::sums(1);
const PARTS: usize = scan::blocks(1);

/// Replaces the counts of run `group.id` by the sums of those before them, and adds up all.
pub fn runs(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    pass: &Buf<u32>,
    counts: &mut Buf<u32>,
    totals: &mut Buf<u32>,
) {
    let is_one = group.id < pass.at(PASS_LISTS) * VALUES;
    let blocks = if is_one { pass.at(PASS_ELEMENTS).div_ceil(BLOCK) } else { 0 };
    scan_counts(group, sums, parts, counts, group.id * blocks, blocks);
    lanes!(group, ..1, |_lane| {
        if is_one {
            totals.put(group.id, total(1, parts, 0));
        }
    });
}

kernel! {
    /// [`runs`] over all lists and values.
    group RUNS = runs, threads 256, shared [sums: SUMS, parts: PARTS], {
        0 pass: read u32, 1 counts: write u32, 2 totals: write u32,
    }
}
