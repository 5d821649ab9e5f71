//! The places of the next level's wide nodes, and of the triangles below them.

use super::{
    Binary, COUNT, FIRST,
    open::{NONE, SLOTS},
    scan::LANES,
};
use crate::{
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};

/// Gives the children of wide node `i` of a level that are nodes their places. The triangles of a node's own slots come
/// first, then those below each of its children.
pub fn place(
    i: u32,
    level: &Buf<u32>,
    next: &Buf<u32>,
    totals: &Buf<UVec2>,
    nodes: &Buf<UVec4>,
    slots: &Buf<u32>,
    queue: &mut Buf<UVec4>,
) {
    if i < level.at(COUNT) {
        let at = level.at(FIRST) + i;
        let entry = queue.at(at);
        let first = next.at(FIRST) + totals.at(i / LANES).x + entry.z;
        queue.put(at, UVec4::new(entry.x, entry.y, first, 0));
        let (mut number, mut triangle) = (first, entry.y + entry.w);
        let mut slot = 0;
        while slot < SLOTS {
            let child = slots.at(SLOTS * at + slot);
            if child != NONE {
                let node = Binary::load(nodes, child);
                if !node.is_slot() {
                    queue.put(number, UVec4::new(child, triangle, 0, 0));
                    triangle += node.count;
                    number += 1;
                }
            }
            slot += 1;
        }
    }
}

kernel! {
    /// [`place`] over the wide nodes of a level.
    map PLACE = place, threads 128, {
        0 level: read u32, 1 next: read u32, 2 totals: read UVec2, 3 nodes: read UVec4, 4 slots: read u32,
        5 queue: write UVec4,
    }
}
