//! Box and parent of every node, for `backtrack`: 32 bytes a node.

use super::climb::climb;
use crate::{
    glam::UVec4,
    mem::{Buf, Slots, scratch},
};
use raykd_shared::TreeHeader;

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
