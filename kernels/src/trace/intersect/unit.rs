//! Lengths in a unit of the ray's own, for the published triangle tests.
//!
//! Devices may flush them, so none may matter. Differences of points are multiplied with a power of two that
//! brings the farthest corner of the scene to `2^38` to `2^39` ([`Unit`]), and what is then below `2^-24`,
//! that is `2^-62` of that distance, is 0. Components of directions are 0 or at least `2^-30`. So are sums of
//! products of up to three such numbers, differences included, either 0 or normal: no rounding is changed by
//! this.

use crate::{
    glam::Vec3,
    math::{abs, exp2, exponent},
    trace::frame::{Frame, flush},
};

/// Differences of points that are smaller, in a [`Unit`], are 0.
const LENGTH_FLOOR: f32 = exp2(-24);

/// The power of two that brings the scene's farthest corner, seen from the ray's origin, to `2^38` to `2^39`.
#[derive(Clone, Copy, Debug)]
pub struct Unit {
    /// Its exponent.
    pub exponent: i32,
    scale: f32,
    inverse: f32,
}

impl Unit {
    /// For a ray.
    #[inline(always)]
    pub fn new(ray: &Frame) -> Self {
        // The pad is 2^-19 of that distance.
        let exponent = 38 - 19 - exponent(ray.pad);
        Self { exponent, scale: exp2(exponent), inverse: exp2(-exponent) }
    }

    /// The way from `a` to `b` in this unit.
    #[inline(always)]
    pub fn between(self, a: Vec3, b: Vec3) -> Vec3 {
        let way = (b - a) * self.scale;
        Vec3::new(flush(way.x, LENGTH_FLOOR), flush(way.y, LENGTH_FLOOR), flush(way.z, LENGTH_FLOOR))
    }

    /// A length in this unit as one in the scene's.
    #[inline(always)]
    pub fn undone(self, length: f32) -> f32 {
        length * self.inverse
    }
}

/// Cross product, by products and differences alone.
#[inline(always)]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

/// Scalar product, by products and sums alone.
#[inline(always)]
pub fn dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// Axis of the largest component, the first of several.
#[inline(always)]
pub fn largest(v: Vec3) -> u32 {
    let (x, y, z) = (abs(v.x), abs(v.y), abs(v.z));
    if x >= y && x >= z {
        0
    } else if y >= z {
        1
    } else {
        2
    }
}
