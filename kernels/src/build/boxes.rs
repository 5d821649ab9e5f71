//! The box of every triangle.

use super::clip::Bounds;
use crate::{
    glam::{Vec3, Vec4},
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// The vertices of triangle `id` of an indexed mesh.
#[inline(always)]
pub fn triangle(positions: &Buf<f32>, indices: &Buf<u32>, id: u32) -> (Vec3, Vec3, Vec3) {
    let vertex = move |positions: &Buf<f32>, i: u32| {
        Vec3::new(positions.at(3 * i), positions.at(3 * i + 1), positions.at(3 * i + 2))
    };
    let (a, b, c) = (indices.at(3 * id), indices.at(3 * id + 1), indices.at(3 * id + 2));
    (vertex(positions, a), vertex(positions, b), vertex(positions, c))
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
        let Bounds { lo, hi } = Bounds::of(a, b, c);
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
