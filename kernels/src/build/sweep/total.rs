//! Sums up the blocks of [`super::rank`]: one workgroup a row.

use super::{FACES, LEVEL_CELLS, LEVEL_LISTS, LEVEL_REFS, blocks, room};
use crate::{
    Group,
    build::scan::{self, LANES, before, scan, word},
    glam::UVec2,
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

const SUMS: usize = scan::sums(2);
const BLOCKS: usize = scan::blocks(2);

/// What block `i` of a row counts, none from `end` on.
#[inline(always)]
fn up_to(i: u32, end: u32, first: u32, totals: &Buf<UVec2>) -> UVec2 {
    if i < end { totals.at(first + i) } else { UVec2::new(0, 0) }
}

/// Replaces what each block of row `group.id` counts by what comes before it.
pub fn total(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; BLOCKS],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    totals: &mut Buf<UVec2>,
) {
    // Rows without lists and levels past the last one are dispatched too, with nothing to do.
    let is_ranked = level.at(LEVEL_CELLS) > 0 && group.id < FACES + level.at(LEVEL_LISTS);
    let number = if is_ranked { blocks(level.at(LEVEL_REFS)) } else { 0 };
    let first = group.id * blocks(room(&params.at(0)));
    let run = number.div_ceil(LANES);
    lanes!(group, |lane| {
        let (mut below, mut above) = (0, 0);
        let mut i = lane * run;
        let end = if (lane + 1) * run < number { (lane + 1) * run } else { number };
        while i < end {
            // Read side by side: a GPU would wait for each.
            let (a, b) = (up_to(i, end, first, totals), up_to(i + 1, end, first, totals));
            let (c, d) = (up_to(i + 2, end, first, totals), up_to(i + 3, end, first, totals));
            below += a.x + b.x + c.x + d.x;
            above += a.y + b.y + c.y + d.y;
            i += 4;
        }
        sums.put(word(0, lane), below);
        sums.put(word(1, lane), above);
    });
    scan(group, 2, sums, parts);
    lanes!(group, |lane| {
        let mut below = before(sums, parts, 0, lane);
        let mut above = before(sums, parts, 1, lane);
        let mut i = lane * run;
        while i < (lane + 1) * run && i < number {
            let both = totals.at(first + i);
            totals.put(first + i, UVec2::new(below, above));
            below += both.x;
            above += both.y;
            i += 1;
        }
    });
}

kernel! {
    /// [`total`] over all rows of a level.
    group TOTAL = total, threads 256, shared [sums: SUMS, parts: BLOCKS], {
        0 params: read BuildParams, 1 level: read u32, 2 totals: write UVec2,
    }
}
