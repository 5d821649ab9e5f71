//! Sums up the blocks of [`super::rank`]: one workgroup a row.

use super::{FACES, LEVEL_CELLS, LEVEL_LISTS, LEVEL_REFS, blocks, room};
use crate::{
    Group,
    build::scan::{self, scan_pairs},
    glam::UVec2,
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

const SUMS: usize = scan::sums(2);
const BLOCKS: usize = scan::blocks(2);

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
    scan_pairs(group, sums, parts, totals, first, number);
}

kernel! {
    /// [`total`] over all rows of a level.
    group TOTAL = total, threads 256, shared [sums: SUMS, parts: BLOCKS], {
        0 params: read BuildParams, 1 level: read u32, 2 totals: write UVec2,
    }
}
