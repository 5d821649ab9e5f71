//! Gives every treelet its place in the final lists: an exclusive scan of their sizes, a block of treelets a
//! workgroup.

use super::{
    LEVEL_ACTIVE, STATE_DEPTH, STATE_LEFT, STATE_NODES, STATE_REFS, STATE_STATUS, STATE_TOP, STATE_TREELETS,
    scan::{self, LANES, before, scan, word},
    tally::blocks_of,
};
use crate::{
    Group,
    glam::UVec2,
    mem::{Atomics, Buf, Slots},
};
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
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn place(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    outer: &mut [u32; OUTER],
    level: &Buf<u32>,
    sizes: &Buf<UVec2>,
    blocks: &Buf<u32>,
    places: &mut Buf<UVec2>,
    state: &mut Buf<u32>,
) {
    let left = level.at(LEVEL_ACTIVE);
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
            state.put(STATE_NODES, top + outer.at(SCANNED + NODES));
            state.put(STATE_REFS, outer.at(SCANNED + REFS));
            state.put(STATE_DEPTH, outer.at(SCANNED + DEPTH));
            state.put(STATE_LEFT, left);
        }
    });
}

kernel! {
    /// [`place`] over all blocks of treelets.
    group PLACE = place, threads 256, shared [sums: SUMS, parts: PARTS, outer: OUTER], {
        0 level: read u32, 1 sizes: read UVec2, 2 blocks: read u32, 3 places: write UVec2, 4 state: write u32,
    }
}
