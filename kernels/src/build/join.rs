//! Joins the branches of a round to the tree: their nodes and treelets get their places, and what is left of them
//! becomes the branches of the next round.

use super::{
    Item, ROUND_EARLIER, ROUND_FROM, ROUND_NUMBER, STATE_STATUS,
    branch::{SHARE, begin, room},
    reference::Reference,
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::{BuildParams, Node};

const LANES: u32 = 32;

/// Joins branch `group.id` of the round.
pub fn join(
    group: Group,
    params: &Buf<BuildParams>,
    round: &Buf<u32>,
    state: &Buf<u32>,
    sizes: &Buf<UVec4>,
    places: &Buf<UVec4>,
    items: &Buf<UVec4>,
    nodes: &Buf<UVec2>,
    branches: &mut Buf<UVec4>,
    top: &mut Buf<UVec2>,
    treelets: &mut Buf<UVec4>,
    refs: &mut Buf<UVec4>,
) {
    if group.id < round.at(ROUND_NUMBER) && state.at(STATE_STATUS) == 0 {
        let small = params.at(0).small;
        let earlier = round.at(ROUND_EARLIER);
        let branch = Item::load(branches, round.at(ROUND_FROM) + group.id);
        let base = begin(&branch, room(branch.count, small, earlier)) / SHARE;
        let (size, place) = (sizes.at(group.id), places.at(group.id));
        // The root keeps its slot.
        let slot = move |local: u32| if local == 0 { branch.node } else { place.y + local - 1 };
        lanes!(group, |lane| {
            let mut i = lane;
            while i < 2 * size.y {
                // Slots of treelets and of what is left hold nothing yet.
                let words = nodes.at(2 * base + i);
                let node = Node::from_words(words.x, words.y);
                let (word0, word1) = Node::inner(node.axis(), node.split(), slot(node.below())).words();
                top.put(slot(i), UVec2::new(word0, word1));
                i += LANES;
            }
            let mut i = lane;
            while i < size.x {
                let item = Item::load(items, base + i);
                Item { node: slot(item.node), ..item }.store(treelets, place.x + i);
                i += LANES;
            }
        });
        let mut from = place.w;
        let mut i = 0;
        while i < size.z {
            let item = Item::load(items, base + size.x + i);
            let room = room(item.count, small, earlier + 1);
            let first = from + room - item.count;
            lanes!(group, |lane| {
                let mut k = lane;
                while k < item.count {
                    Reference::load(refs, item.first + k).store(refs, first + k);
                    k += LANES;
                }
                if lane == 0 {
                    Item { node: slot(item.node), first, ..item }.store(branches, place.z + i);
                }
            });
            from += room;
            i += 1;
        }
    }
}

kernel! {
    /// [`join`] over all branches of a round.
    group JOIN = join, threads 32, shared [], {
        0 params: read BuildParams, 1 round: read u32, 2 state: read u32, 3 sizes: read UVec4, 4 places: read UVec4,
        5 items: read UVec4, 6 nodes: read UVec2, 7 branches: write UVec4, 8 top: write UVec2,
        9 treelets: write UVec4, 10 refs: write UVec4,
    }
}
