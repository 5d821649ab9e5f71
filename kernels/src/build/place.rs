//! Gives every treelet its place in the final lists: an exclusive scan of their sizes, a block of treelets a
//! workgroup. Tells how large the tree is, and if there is room for that, how many workgroups write it out.

use super::{
    ARGS_CORNERS, ARGS_EMIT, ARGS_TOP, LEVEL_ACTIVE, ROUND_NUMBER, STATE_DEPTH, STATE_LEFT, STATE_NODES,
    STATE_REFS, STATE_ROOM, STATE_STATUS, STATE_TOP, STATE_TREELETS,
    scan::{self, LANES, before, scan, word},
    tally::blocks_of,
};
use crate::{
    Group,
    glam::UVec2,
    mem::{Atomics, Buf, Slots},
    put_groups,
};
use core::mem::offset_of;
use raykd_shared::TreeHeader;

/// Words of the tree's header.
const HEADER_NODES: u32 = offset_of!(TreeHeader, nodes) as u32 / 4;
const HEADER_REFS: u32 = offset_of!(TreeHeader, refs) as u32 / 4;
const HEADER_DEPTH: u32 = offset_of!(TreeHeader, depth) as u32 / 4;

/// Lanes of the workgroups that copy the nodes above the treelets, and of those that lay leaves out.
pub const COPIERS: u32 = 64;

// What [`super::treelet`] adds up of a block's treelets.
/// Nodes without the roots.
pub const NODES: u32 = 0;
/// References.
pub const REFS: u32 = 1;
/// Depth of the deepest leaf.
pub const DEPTH: u32 = 2;
/// How many words that are.
pub const KINDS: u32 = 3;
/// What is scanned of it.
const SCANNED: u32 = 2;
const SUMS: usize = scan::sums(SCANNED);
const PARTS: usize = scan::blocks(SCANNED);
/// Nodes and references in the blocks before this one; then all, and the greatest depth.
const OUTER: usize = (SCANNED + KINDS) as usize;

/// Places the treelets of block `group.id`. The first block writes the tree's sizes.
pub fn place(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    outer: &mut [u32; OUTER],
    level: &Buf<u32>,
    round: &Buf<u32>,
    sizes: &Buf<UVec2>,
    blocks: &Buf<u32>,
    places: &mut Buf<UVec2>,
    state: &mut Buf<u32>,
    header: &mut Buf<u32>,
) {
    let left = level.at(LEVEL_ACTIVE) + round.at(ROUND_NUMBER);
    let number = if (state.at(STATE_STATUS) == 0) & (left == 0) { state.at(STATE_TREELETS) } else { 0 };
    let top = state.at(STATE_TOP);
    lanes!(group, |lane| {
        let k = group.id * LANES + lane;
        let size = if k < number { sizes.at(k) } else { UVec2::new(0, 0) };
        sums.put(word(NODES, lane), size.x);
        sums.put(word(REFS, lane), size.y);
        if lane < OUTER as u32 {
            outer.put(lane, 0);
        }
    });
    lanes!(group, |lane| {
        let mut block = lane;
        while block < blocks_of(number) {
            let (nodes, refs) = (blocks.at(block * KINDS + NODES), blocks.at(block * KINDS + REFS));
            if block < group.id {
                outer.add(NODES, nodes);
                outer.add(REFS, refs);
            }
            outer.add(SCANNED + NODES, nodes);
            outer.add(SCANNED + REFS, refs);
            outer.raise(SCANNED + DEPTH, blocks.at(block * KINDS + DEPTH));
            block += LANES;
        }
    });
    scan(group, SCANNED, sums, parts);
    lanes!(group, |lane| {
        let k = group.id * LANES + lane;
        if k < number {
            let nodes = top + outer.at(NODES) + before(sums, parts, NODES, lane);
            places.put(k, UVec2::new(nodes, outer.at(REFS) + before(sums, parts, REFS, lane)));
        }
        if lane == 0 && group.id == 0 {
            let (nodes, refs) = (top + outer.at(SCANNED + NODES), outer.at(SCANNED + REFS));
            let depth = outer.at(SCANNED + DEPTH);
            state.put(STATE_NODES, nodes);
            state.put(STATE_REFS, refs);
            state.put(STATE_DEPTH, depth);
            state.put(STATE_LEFT, left);
            header.put(HEADER_NODES, nodes);
            header.put(HEADER_REFS, refs);
            header.put(HEADER_DEPTH, depth);
            let fits = (nodes <= state.at(STATE_ROOM)) & (refs <= state.at(STATE_ROOM + 1));
            let write = fits & (number > 0);
            put_groups(state, ARGS_TOP, if write { top.div_ceil(COPIERS) } else { 0 });
            put_groups(state, ARGS_EMIT, if write { number } else { 0 });
            put_groups(state, ARGS_CORNERS, if write { refs.div_ceil(COPIERS) } else { 0 });
        }
    });
}

kernel! {
    /// [`place`] over all blocks of treelets.
    group PLACE = place, threads 256, shared [sums: SUMS, parts: PARTS, outer: OUTER], {
        0 level: read u32, 1 round: read u32, 2 sizes: read UVec2, 3 blocks: read u32, 4 places: write UVec2,
        5 state: write u32, 6 header: write u32,
    }
}
