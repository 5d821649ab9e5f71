//! Numbers the nodes depth first, as the host form of the builder does; the level above is done.

use super::{LEVEL_CELLS, LEVEL_NODES};
use crate::{
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::Node;

/// Writes node `i` of the level to its place, and says where its children go: a place holds the node's number,
/// where the nodes and where the references below it start.
pub fn number(
    i: u32,
    level: &Buf<u32>,
    tree: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
    places: &mut Buf<UVec4>,
    nodes: &mut Buf<UVec2>,
) {
    if i < level.at(LEVEL_CELLS) {
        let at = level.at(LEVEL_NODES) + i;
        // After the root comes padding.
        let place = if at == 0 { UVec4::new(0, 2, 0, 0) } else { places.at(at) };
        let words = tree.at(at);
        let node = Node::from_words(words.x, words.y);
        let mut made = Node::leaf(place.z, node.count());
        if node.is_leaf() {
            places.put(at, place);
        } else {
            made = Node::inner(node.axis(), node.split(), place.y);
            let below = sizes.at(node.below());
            places.put(node.below(), UVec4::new(place.y, place.y + 2, place.z, 0));
            places
                .put(node.below() + 1, UVec4::new(place.y + 1, place.y + 2 + below.x, place.z + below.y, 0));
        }
        let (word0, word1) = made.words();
        nodes.put(place.x, UVec2::new(word0, word1));
    }
}

kernel! {
    /// [`number`] over the nodes of a level.
    map NUMBER = number, threads 128, {
        0 level: read u32, 1 tree: read UVec2, 2 sizes: read UVec2, 3 places: write UVec4, 4 nodes: write UVec2,
    }
}
