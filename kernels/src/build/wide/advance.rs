//! The record of the next round, or the next level of wide nodes.

use super::{COUNT, FIRST, PARTS, ROUND, SIZE, STATE_NEXT, STATE_NODES, SUMS, nearest, number, record};
use crate::{
    Group,
    build::scan::scan_pairs,
    glam::UVec2,
    mem::{Buf, Slots},
};

/// Replaces what each block counts by what those before it do. A round counts clusters of the next one and new nodes, a
/// level wide nodes of the next one and its own. Rounds of few clusters are not run, and their record stays.
pub fn advance(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    now: &Buf<u32>,
    totals: &mut Buf<UVec2>,
    next: &mut Buf<u32>,
    state: &mut Buf<u32>,
) {
    let (count, block) = (now.at(COUNT), now.at(SIZE));
    let stays = block == nearest::BLOCK && count <= block;
    let blocks = if stays { 0 } else { count.div_ceil(block) };
    scan_pairs(group, sums, parts, totals, 0, blocks);
    lanes!(group, ..1, |_lane| {
        let (first, round) = (now.at(FIRST) + number(parts, 1), now.at(ROUND));
        if stays {
            record(next, count, block, first, round);
        } else {
            record(next, number(parts, 0), block, first, round + 1);
            state.put(STATE_NODES, first);
            state.put(STATE_NEXT, number(parts, 0));
        }
    });
}

kernel! {
    /// [`advance`]; a single workgroup.
    group ADVANCE = advance, threads 256, shared [sums: SUMS, parts: PARTS], {
        0 now: read u32, 1 totals: write UVec2, 2 next: write u32, 3 state: write u32,
    }
}
