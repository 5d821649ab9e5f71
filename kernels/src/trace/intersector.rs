//! What a triangle test is to a traversal, and what the published ones share.
//!
//! `strict` (triangle.rs) is what raykd uses, `exact` (exact.rs) rounds nothing but its answer. The others are there to be
//! compared with them: each in a file of its own, with the formulas and thresholds of its source, so that it fails where
//! it is known to fail. Common to all are the rules of the contract: edges belong to triangles, ranges of `t` are
//! inclusive, the lowest number wins.
//!
//! # Subnormal numbers
//! Devices may flush them, so none may matter. Differences of points are multiplied with a power of two that
//! brings the farthest corner of the scene to `2^38` to `2^39` ([`Unit`]), and what is then below `2^-24`, that is
//! `2^-62` of that distance, is 0. Components of directions are 0 or at least `2^-30`. So are sums of products of up
//! to three such numbers, differences included, either 0 or normal: no rounding is changed by this.

use super::frame::{Frame, flush};
use crate::{
    glam::{Vec3, Vec4},
    math::{abs, exp2, exponent},
};

/// The best hit of a ray so far. `u` and `v` stay undivided until the end.
#[derive(Clone, Copy, Debug)]
pub struct Best {
    /// Scaled ray parameter.
    pub t: f32,
    /// Triangle, or [`raykd_shared::MISS`].
    pub triangle: u32,
    /// Weight of the second vertex, to be divided by `det`.
    pub u: f32,
    /// Weight of the third vertex, to be divided by `det`.
    pub v: f32,
    /// Sum of the three weights.
    pub det: f32,
}

impl Best {
    /// Whether a hit at `t` may be taken.
    #[inline(always)]
    pub fn may_take(&self, ray: &Frame, t: f32) -> bool {
        t >= ray.t_min && t <= ray.t_max && t <= self.t
    }

    /// Keeps the better of this and a hit that is in the ray's range. Smaller `t` wins, then the smaller number.
    #[inline(always)]
    pub fn offer(&mut self, ray: &Frame, hit: Self) {
        let inside = hit.t >= ray.t_min && hit.t <= ray.t_max;
        let better = hit.t < self.t || (hit.t == self.t && hit.triangle < self.triangle);
        if inside && better {
            *self = hit;
        }
    }
}

/// A triangle test. Triangles come as leaves keep them: what [`Intersector::lay_out`] made of them, `w` of the first
/// vector not counted.
pub trait Intersector: Copy {
    /// Whether its test has loops, which a driver may leave early.
    const LOOPS: bool = false;
    /// Whether it takes rays as [`Frame::whole`] makes them.
    const WHOLE: bool = false;

    /// Made ready for a ray.
    fn new(ray: &Frame) -> Self;

    /// What leaves keep of a triangle.
    #[inline(always)]
    fn lay_out(a: Vec3, b: Vec3, c: Vec3) -> (Vec4, Vec4, Vec4) {
        (a.extend(0.0), b.extend(0.0), c.extend(0.0))
    }

    /// A cheap first look, false only for triangles that [`Intersector::test`] would not take; always true where the
    /// test is as quick.
    #[inline(always)]
    fn may_hit(self, _ray: &Frame, _a: Vec4, _b: Vec4, _c: Vec4) -> bool {
        true
    }

    /// The whole test of triangle `id`: keeps the better of it and `best`. False if a driver left a loop of it early.
    fn test(self, ray: &Frame, id: u32, a: Vec4, b: Vec4, c: Vec4, best: &mut Best) -> bool;
}

/// Differences of points that are smaller, in a [`Unit`], are 0.
const FLOOR: f32 = exp2(-24);

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
        Vec3::new(flush(way.x, FLOOR), flush(way.y, FLOOR), flush(way.z, FLOOR))
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
