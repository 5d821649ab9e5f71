//! The references of the root: the triangles that take part, each with its box.

use super::reference::Reference;
use crate::{
    glam::UVec4,
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// Writes reference `i`.
pub fn bound(
    i: u32,
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    kept: &Buf<u32>,
    refs: &mut Buf<UVec4>,
) {
    if i < params.at(0).references {
        Reference::whole(positions, indices, kept.at(i)).store(refs, i);
    }
}

kernel! {
    /// [`bound`] over all references of the root.
    map BOXES = bound, threads 64, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 kept: read u32, 4 refs: write UVec4,
    }
}
