//! How many nodes and references lie below the nodes of a level; the level under it is done.

use super::{LEVEL_CELLS, LEVEL_NODES};
use crate::{
    glam::UVec2,
    mem::{Buf, Slots},
};
use raykd_shared::Node;

/// Measures node `i` of the level, itself not counted.
pub fn size(i: u32, level: &Buf<u32>, tree: &Buf<UVec2>, sizes: &mut Buf<UVec2>) {
    if i < level.at(LEVEL_CELLS) {
        let at = level.at(LEVEL_NODES) + i;
        let words = tree.at(at);
        let node = Node::from_words(words.x, words.y);
        let mut its = UVec2::new(0, node.count());
        if !node.is_leaf() {
            its = UVec2::new(2, 0) + sizes.at(node.below()) + sizes.at(node.below() + 1);
        }
        sizes.put(at, its);
    }
}

kernel! {
    /// [`size`] over the nodes of a level.
    map SIZES = size, threads 128, { 0 level: read u32, 1 tree: read UVec2, 2 sizes: write UVec2 }
}
