//! The places of triangles along a Morton curve (Morton 1966): numbers whose bits are those of the three coordinates in
//! turn, so that what is near in order is mostly near in space.

use super::{JOB_LO, JOB_PLACES, JOB_TRIANGLES, centre};
use crate::{
    bounds::Bounds,
    glam::UVec2,
    math::whole,
    mem::{Buf, Slots},
    mesh::triangle,
};

/// Bits of a coordinate.
const BITS: u32 = 10;
/// Places along an axis.
pub const PLACES: u32 = 1 << BITS;

/// Leaves two bits free between every two of ten.
#[inline(always)]
fn spread(x: u32) -> u32 {
    let x = (x | (x << 16)) & 0x0300_00FF;
    let x = (x | (x << 8)) & 0x0300_F00F;
    let x = (x | (x << 4)) & 0x030C_30C3;
    (x | (x << 2)) & 0x0924_9249
}

/// Writes the place of triangle `i` of those that take part, and its number among them, as faces are sorted.
pub fn curve(
    i: u32,
    job: &Buf<u32>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    kept: &Buf<u32>,
    places: &mut Buf<UVec2>,
) {
    if i < job.at(JOB_TRIANGLES) {
        let (a, b, c) = triangle(positions, indices, kept.at(i));
        let twice = centre(&Bounds::of(a, b, c));
        let scale = f32::from_bits(job.at(JOB_PLACES));
        let along =
            |x: f32, axis: u32| whole::<{ PLACES - 1 }>((x - f32::from_bits(job.at(JOB_LO + axis))) * scale);
        let place =
            spread(along(twice.x, 0)) | spread(along(twice.y, 1)) << 1 | spread(along(twice.z, 2)) << 2;
        places.put(i, UVec2::new(place << (32 - 3 * BITS), i));
    }
}

kernel! {
    /// [`curve`] over all triangles.
    map CURVE = curve, threads 128, {
        0 job: read u32, 1 positions: read f32, 2 indices: read u32, 3 kept: read u32, 4 places: write UVec2,
    }
}
