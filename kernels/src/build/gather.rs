//! Triangles and their boxes from the indexed mesh.

use crate::{
    glam::{Vec3, Vec4},
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// The smaller of two numbers.
#[inline(always)]
fn low(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// The larger of two numbers.
#[inline(always)]
fn high(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// Writes triangle `i` as three points (`w` unused) and its box as two.
pub fn gather(
    i: u32,
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    triangles: &mut Buf<Vec4>,
    boxes: &mut Buf<Vec4>,
) {
    if i < params.at(0).triangles {
        let point = move |corner: u32| {
            let p = indices.at(3 * i + corner) * 3;
            Vec3::new(positions.at(p), positions.at(p + 1), positions.at(p + 2))
        };
        let (a, b, c) = (point(0), point(1), point(2));
        triangles.put(3 * i, a.extend(0.0));
        triangles.put(3 * i + 1, b.extend(0.0));
        triangles.put(3 * i + 2, c.extend(0.0));
        let lo = Vec3::new(low(low(a.x, b.x), c.x), low(low(a.y, b.y), c.y), low(low(a.z, b.z), c.z));
        let hi = Vec3::new(high(high(a.x, b.x), c.x), high(high(a.y, b.y), c.y), high(high(a.z, b.z), c.z));
        boxes.put(2 * i, lo.extend(0.0));
        boxes.put(2 * i + 1, hi.extend(0.0));
    }
}

kernel! {
    /// [`gather`] over all triangles.
    map GATHER = gather, threads 64, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32,
        3 triangles: write Vec4, 4 boxes: write Vec4,
    }
}
