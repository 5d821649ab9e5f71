//! Copies the nodes above the treelets to the final list.

use super::STATE_TOP;
use crate::{
    glam::UVec2,
    mem::{Buf, Slots},
};

/// Copies node `i`. Slots of treelet roots hold nothing yet; `emit` fills them.
pub fn top(i: u32, state: &Buf<u32>, from: &Buf<UVec2>, nodes: &mut Buf<UVec2>) {
    if i < state.at(STATE_TOP) {
        nodes.put(i, from.at(i));
    }
}

kernel! {
    /// [`top`] over the nodes above the treelets.
    map TOP = top, threads 64, { 0 state: read u32, 1 from: read UVec2, 2 nodes: write UVec2 }
}
