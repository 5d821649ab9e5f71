//! The box of every triangle.

use crate::{
    glam::{Vec3, Vec4},
    math::{high, low},
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

/// Writes the box of triangle `i` as two points.
pub fn bound(
    i: u32,
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    boxes: &mut Buf<Vec4>,
) {
    if i < params.at(0).triangles {
        let (a, b, c) = triangle(positions, indices, i);
        let lo = Vec3::new(low(low(a.x, b.x), c.x), low(low(a.y, b.y), c.y), low(low(a.z, b.z), c.z));
        let hi = Vec3::new(high(high(a.x, b.x), c.x), high(high(a.y, b.y), c.y), high(high(a.z, b.z), c.z));
        boxes.put(2 * i, lo.extend(0.0));
        boxes.put(2 * i + 1, hi.extend(0.0));
    }
}

kernel! {
    /// [`bound`] over all triangles.
    map BOXES = bound, threads 64, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 boxes: write Vec4,
    }
}
