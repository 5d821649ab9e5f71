//! Box and parent of every node, for `backtrack`: 32 bytes a node.

use super::crossing::Place;
use crate::{
    glam::UVec4,
    mem::{Buf, Slots, scratch},
};
use raykd_shared::TreeHeader;

/// The box of a node: lower corner, upper corner. It is found by climbing to the root: on each side the first
/// plane met bounds it, and `met` is told the side (`3 * upper + axis`) and the child that lies beyond.
#[inline(always)]
pub fn climb(
    i: u32,
    header: &TreeHeader,
    pairs: &Buf<UVec4>,
    parents: &Buf<u32>,
    beyond: &mut [u32; 6],
) -> [f32; 6] {
    let mut sides = scratch::<f32, 6>();
    let mut side = 0;
    while side < 3 {
        sides.put(side, header.lo[side as usize]);
        sides.put(side + 3, header.hi[side as usize]);
        beyond.put(side, super::rope_links::NONE);
        beyond.put(side + 3, super::rope_links::NONE);
        side += 1;
    }
    let mut child = i;
    while child != 0 {
        let up = parents.at(child >> 1);
        let node = Place::load(up, pairs).node;
        // A child above its parent's plane has that plane on its lower side.
        let side = node.axis() + if child & 1 == 0 { 3 } else { 0 };
        if beyond.at(side) == super::rope_links::NONE {
            sides.put(side, node.split());
            beyond.put(side, child ^ 1);
        }
        child = up;
    }
    sides
}

/// Writes box and parent of node `i`.
pub fn node_boxes(
    i: u32,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    parents: &Buf<u32>,
    boxes: &mut Buf<UVec4>,
) {
    let header = header.at(0);
    // The slot beside the root is no node.
    if i < header.nodes && i != 1 {
        let sides = climb(i, &header, pairs, parents, &mut scratch());
        let bits = |side: u32| sides.at(side).to_bits();
        boxes.put(2 * i, UVec4::new(bits(0), bits(1), bits(2), parents.at(i >> 1)));
        boxes.put(2 * i + 1, UVec4::new(bits(3), bits(4), bits(5), 0));
    }
}

kernel! {
    /// [`node_boxes`] over all nodes.
    map NODE_BOXES = node_boxes, threads 64, {
        0 header: read TreeHeader, 1 pairs: read UVec4, 2 parents: read u32, 3 boxes: write UVec4,
    }
}
