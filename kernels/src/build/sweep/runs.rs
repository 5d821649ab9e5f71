//! How many faces of a list with a digit's value lie in the blocks before each: one workgroup a list and value.

use super::{
    LEVEL_REFS,
    digits::{BLOCK, LANES},
};
use crate::{
    Group,
    build::scan::{self, before, scan, total, word},
    mem::{Buf, Slots},
};

const SUMS: usize = scan::sums(1);
const PARTS: usize = scan::blocks(1);

/// Replaces the counts of run `group.id` by the sums of those before them, and adds up all.
pub fn runs(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    level: &Buf<u32>,
    counts: &mut Buf<u32>,
    totals: &mut Buf<u32>,
) {
    let blocks = level.at(LEVEL_REFS).div_ceil(BLOCK);
    let (first, each) = (group.id * blocks, blocks.div_ceil(LANES));
    lanes!(group, |lane| {
        let mut sum = 0;
        let mut i = lane * each;
        while i < (lane + 1) * each && i < blocks {
            sum += counts.at(first + i);
            i += 1;
        }
        sums.put(word(0, lane), sum);
    });
    scan(group, 1, sums, parts);
    lanes!(group, |lane| {
        let mut sum = before(sums, parts, 0, lane);
        let mut i = lane * each;
        while i < (lane + 1) * each && i < blocks {
            let count = counts.at(first + i);
            counts.put(first + i, sum);
            sum += count;
            i += 1;
        }
        if lane == 0 {
            totals.put(group.id, total(1, parts, 0));
        }
    });
}

kernel! {
    /// [`runs`] over all lists and values.
    group RUNS = runs, threads 256, shared [sums: SUMS, parts: PARTS], {
        0 level: read u32, 1 counts: write u32, 2 totals: write u32,
    }
}
