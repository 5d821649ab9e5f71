//! Writes the references of all leaves to their final places.

use super::STATE_REFS;
use crate::{
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};

/// Writes reference `i`, of all leaves in the order in which they were made.
pub fn leaves(
    i: u32,
    state: &Buf<u32>,
    listed: &Buf<UVec2>,
    tree: &Buf<UVec2>,
    places: &Buf<UVec4>,
    out: &mut Buf<u32>,
) {
    if i < state.at(STATE_REFS) {
        let (triangle, leaf) = (listed.at(i).x, listed.at(i).y);
        // The first word of a leaf is where its references start.
        out.put(places.at(leaf).z + (i - tree.at(leaf).x), triangle);
    }
}

kernel! {
    /// [`leaves`] over the references of all leaves.
    map LEAVES = leaves, threads 128, {
        0 state: read u32, 1 listed: read UVec2, 2 tree: read UVec2, 3 places: read UVec4, 4 out: write u32,
    }
}
