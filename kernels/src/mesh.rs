//! The indexed mesh that builders and triangle tests read.

use crate::{
    glam::Vec3,
    mem::{Buf, Slots},
};

/// The vertices of triangle `id`.
#[inline(always)]
pub fn triangle(positions: &Buf<f32>, indices: &Buf<u32>, id: u32) -> (Vec3, Vec3, Vec3) {
    (vertex(positions, indices, id, 0), vertex(positions, indices, id, 1), vertex(positions, indices, id, 2))
}

#[inline(always)]
fn vertex(positions: &Buf<f32>, indices: &Buf<u32>, id: u32, corner: u32) -> Vec3 {
    let p = indices.at(3 * id + corner) * 3;
    Vec3::new(positions.at(p), positions.at(p + 1), positions.at(p + 2))
}
