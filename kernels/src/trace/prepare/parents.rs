//! The parent of every pair of children, for traversals that climb.

use crate::{
    glam::UVec4,
    mem::{Buf, Slots},
    trace::place::Place,
};
use raykd_shared::{MISS, TreeHeader};

/// Writes for node `i` that its children are its; the root writes that it has no parent itself.
pub fn write(i: u32, header: &Buf<TreeHeader>, pairs: &Buf<UVec4>, parents: &mut Buf<u32>) {
    if i == 0 {
        parents.put(0, MISS);
    }
    if i < header.at(0).nodes {
        let node = Place::load(i, pairs).node;
        if !node.is_leaf() {
            parents.put(node.below() >> 1, i);
        }
    }
}

kernel! {
    /// [`write()`] over all nodes.
    map PARENTS = write, threads 64, { 0 header: read TreeHeader, 1 pairs: read UVec4, 2 parents: write u32 }
}
