//! Gives every treelet its place in the final lists: an exclusive scan of their sizes. One workgroup.

use super::{
    LEVEL_ACTIVE, STATE_DEPTH, STATE_NODES, STATE_REFS, STATE_STATUS, STATE_TOP, STATE_TREELETS,
    scan::{self, LANES, before, scan, total},
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::status;

const NODES: u32 = 0;
const REFS: u32 = 1;
const KINDS: u32 = 2;
const SUMS: usize = scan::sums(KINDS);
const BLOCKS: usize = scan::blocks(KINDS);

/// Places all treelets; raises [`status::LEVELS`] if the level loop left active nodes.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn place(
    group: Group,
    sums: &mut [u32; SUMS],
    blocks: &mut [u32; BLOCKS],
    deepest: &mut [u32; 1],
    level: &Buf<u32>,
    sizes: &Buf<UVec4>,
    places: &mut Buf<UVec2>,
    state: &mut Buf<u32>,
) {
    let number = if state.at(STATE_STATUS) == 0 { state.at(STATE_TREELETS) } else { 0 };
    let top = state.at(STATE_TOP);
    let run = number.div_ceil(LANES);
    lanes!(group, |lane| {
        if lane == 0 {
            deepest.put(0, 0);
        }
    });
    lanes!(group, |lane| {
        let (mut n, mut r, mut d) = (0, 0, 0);
        let mut i = 0;
        while i < run {
            let k = lane * run + i;
            if k < number {
                let size = sizes.at(k);
                n += size.x;
                r += size.y;
                d = if size.z > d { size.z } else { d };
            }
            i += 1;
        }
        sums.put(NODES * LANES + lane, n);
        sums.put(REFS * LANES + lane, r);
        deepest.raise(0, d);
    });
    scan(group, KINDS, sums, blocks);
    lanes!(group, |lane| {
        let mut n = top + before(sums, blocks, NODES, lane);
        let mut r = before(sums, blocks, REFS, lane);
        let mut i = 0;
        while i < run {
            let k = lane * run + i;
            if k < number {
                let size = sizes.at(k);
                places.put(k, UVec2::new(n, r));
                n += size.x;
                r += size.y;
            }
            i += 1;
        }
        if lane == 0 {
            state.put(STATE_NODES, top + total(KINDS, blocks, NODES));
            state.put(STATE_REFS, total(KINDS, blocks, REFS));
            state.put(STATE_DEPTH, deepest.at(0));
            if level.at(LEVEL_ACTIVE) > 0 {
                let old = state.at(STATE_STATUS);
                state.put(STATE_STATUS, old | status::LEVELS);
            }
        }
    });
}

kernel! {
    /// [`place`]; a single workgroup.
    group PLACE = place, threads 1024, shared [sums: SUMS, blocks: BLOCKS, deepest: 1], {
        0 level: read u32, 1 sizes: read UVec4, 2 places: write UVec2, 3 state: write u32,
    }
}
