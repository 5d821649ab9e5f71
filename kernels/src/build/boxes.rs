//! The references of the root: the triangles that take part, each with its box.

use super::{clip::Bounds, reference::Reference};
use crate::{
    glam::{UVec4, Vec3},
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// The vertices of triangle `id` of an indexed mesh.
#[inline(always)]
pub fn triangle(positions: &Buf<f32>, indices: &Buf<u32>, id: u32) -> (Vec3, Vec3, Vec3) {
    (vertex(positions, indices, id, 0), vertex(positions, indices, id, 1), vertex(positions, indices, id, 2))
}

#[inline(always)]
fn vertex(positions: &Buf<f32>, indices: &Buf<u32>, id: u32, corner: u32) -> Vec3 {
    let p = indices.at(3 * id + corner) * 3;
    Vec3::new(positions.at(p), positions.at(p + 1), positions.at(p + 2))
}

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
        let id = kept.at(i);
        let (a, b, c) = triangle(positions, indices, id);
        Reference { triangle: id, bounds: Bounds::of(a, b, c) }.store(refs, i);
    }
}

kernel! {
    /// [`bound`] over all references of the root.
    map BOXES = bound, threads 64, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 kept: read u32, 4 refs: write UVec4,
    }
}
