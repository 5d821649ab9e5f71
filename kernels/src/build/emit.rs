//! Writes the nodes and references of a treelet to their final places.

use super::{Item, STATE_TREELETS, reference::triangle_at, treelet::scratch_base};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::{Node, limits::TREELET};

const LANES: u32 = TREELET;

/// Emits treelet `group.id`; a lane takes every 32nd node.
pub fn emit(
    group: Group,
    state: &Buf<u32>,
    treelets: &Buf<UVec4>,
    refs: &Buf<UVec4>,
    scratch: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
    places: &Buf<UVec2>,
    nodes: &mut Buf<UVec2>,
    out: &mut Buf<u32>,
) {
    if group.id < state.at(STATE_TREELETS) {
        let item = Item::load(treelets, group.id);
        let place = places.at(group.id);
        let size = sizes.at(group.id);
        lanes!(group, |lane| {
            if item.count > TREELET {
                let mut i = lane;
                while i < item.count {
                    out.put(place.y + i, triangle_at(refs, item.first + i));
                    i += LANES;
                }
                if lane == 0 {
                    let (word0, word1) = Node::leaf(place.y, item.count).words();
                    nodes.put(item.node, UVec2::new(word0, word1));
                }
            } else {
                let mut i = lane;
                while i <= size.x {
                    let words = scratch.at(scratch_base(item.first, group.id) + i);
                    let local = Node::from_words(words.x, words.y);
                    let mut made = Node::inner(local.axis(), local.split(), place.x + local.below() - 1);
                    if local.is_leaf() {
                        let first = place.y + local.count();
                        let mut mask = words.x;
                        made = Node::leaf(first, mask.count_ones());
                        let mut at = first;
                        while mask != 0 {
                            out.put(at, triangle_at(refs, item.first + mask.trailing_zeros()));
                            mask &= mask - 1;
                            at += 1;
                        }
                    }
                    let (word0, word1) = made.words();
                    // The root takes the slot its parent points to.
                    nodes.put(if i == 0 { item.node } else { place.x + i - 1 }, UVec2::new(word0, word1));
                    i += LANES;
                }
            }
        });
    }
}

kernel! {
    /// [`emit`] over all treelets.
    group EMIT = emit, threads 32, shared [], {
        0 state: read u32, 1 treelets: read UVec4, 2 refs: read UVec4, 3 scratch: read UVec2, 4 sizes: read UVec2,
        5 places: read UVec2, 6 nodes: write UVec2, 7 out: write u32,
    }
}
