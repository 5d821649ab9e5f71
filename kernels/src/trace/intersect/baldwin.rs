//! The test of Baldwin & Weber 2016, "Fast ray-triangle intersections by coordinate transformation", with
//! nine stored coefficients.
//!
//! Leaves keep, instead of corners, the transformation that takes the triangle to the corner of the unit
//! square, and the rest of space so that its third coordinate is the distance from the plane. Its
//! coefficients are rounded for each triangle apart, so edges do not fit; and they are for coordinates, so
//! far from the scene's origin digits are lost.
//!
//! The axis of the largest component of the normal comes last here, the others in cyclic order. The edge
//! across from the first corner belongs to the triangle (`<= 1`; the paper has `< 1`).

use super::{
    Best, Corners, Intersector, NORMAL,
    unit::{cross, dot, largest},
};
use crate::{
    glam::{Vec3, Vec4},
    math::{abs, cycle, div, exp2, exponent},
    trace::frame::{Frame, flush},
};

/// Coefficients, `t` and coordinates of the point below this are 0: their products are normal numbers.
const FLOOR: f32 = exp2(-60);
/// Slopes of the plane below this are 0, for the same reason.
const SLOPE_FLOOR: f32 = exp2(-50);
/// Sums below this are 0. A subnormal part of a sum is lost beside one that is not.
const SUM_FLOOR: f32 = exp2(-100);
/// Triangles with larger coefficients are too small to be seen.
const COEFFICIENT_MOST: f32 = exp2(80);

/// The test.
#[derive(Clone, Copy, Debug)]
pub struct Baldwin;

/// A vector whose components are not too small.
#[inline(always)]
fn tidy(v: Vec3, floor: f32) -> Vec3 {
    Vec3::new(flush(v.x, floor), flush(v.y, floor), flush(v.z, floor))
}

/// A row of the transformation whose numbers do not underflow in products.
#[inline(always)]
fn row(x: f32, y: f32, one: f32, by: f32, floor: f32) -> Vec3 {
    let entry = move |a: f32, floor: f32| flush(div(flush(a, SUM_FLOOR), by), floor);
    Vec3::new(entry(x, floor), entry(y, floor), entry(one, FLOOR))
}

#[inline(always)]
fn is_large(row: Vec3) -> bool {
    abs(row.x) > COEFFICIENT_MOST || abs(row.y) > COEFFICIENT_MOST || abs(row.z) > COEFFICIENT_MOST
}

/// A row applied to a point that lies in its plane.
#[inline(always)]
fn apply(row: Vec4, x: f32, y: f32) -> f32 {
    flush(row.x * x + row.y * y + row.z, SUM_FLOOR)
}

impl Intersector for Baldwin {
    type Seen = ();

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    fn lay_out(a: Vec3, b: Vec3, c: Vec3) -> Corners {
        let (a, b, c) = (tidy(a, FLOOR), tidy(b, FLOOR), tidy(c, FLOOR));
        let (e, f) = (tidy(b - a, FLOOR), tidy(c - a, FLOOR));
        let normal = tidy(cross(e, f), SUM_FLOOR);
        let axis = largest(normal);
        let (a, b, c) = (cycle(a, axis), cycle(b, axis), cycle(c, axis));
        let (e, f, n) = (cycle(e, axis), cycle(f, axis), cycle(normal, axis));
        let by = n.z;
        let first = row(f.y, -f.x, c.x * a.y - c.y * a.x, by, FLOOR);
        let second = row(-e.y, e.x, b.y * a.x - b.x * a.y, by, FLOOR);
        // The last component of size 1 to 2.
        let n = tidy(n * exp2(-exponent(by)), FLOOR);
        let third = row(n.x, n.y, -dot(n, a), n.z, SLOPE_FLOOR);
        let none = by == 0.0 || is_large(first) || is_large(second) || is_large(third);
        // That one is below 0 everywhere.
        let first = if none { Vec3::new(0.0, 0.0, -1.0) } else { first };
        let second = if none { Vec3::ZERO } else { second };
        let third = if none { Vec3::ZERO } else { third };
        (first.extend(0.0), second.extend(f32::from_bits(axis | NORMAL)), third.extend(0.0))
    }

    #[inline(always)]
    fn look(self, _ray: &Frame, _corners: Corners) -> ((), bool) {
        ((), true)
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, (a, b, c): Corners, _seen: (), best: &mut Best) -> bool {
        let axis = b.w.to_bits() & 3;
        let (o, d) = (cycle(ray.origin, axis), cycle(ray.direction, axis));
        let from = flush(o.z + c.x * o.x + c.y * o.y + c.z, SUM_FLOOR);
        let along = d.z + c.x * d.x + c.y * d.y;
        if along != 0.0 {
            let t = flush(div(-from, along), FLOOR);
            // Eight times as far as the scene.
            if abs(t) < ray.pad * exp2(22) && best.may_take(ray, t) {
                let x = flush(o.x + d.x * t, FLOOR);
                let y = flush(o.y + d.y * t, FLOOR);
                let (u, v) = (apply(a, x, y), apply(b, x, y));
                if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                    best.offer(ray, Best { t, triangle: id, u, v, det: 1.0 });
                }
            }
        }
        true
    }
}

test!(BALDWIN, brute_baldwin::BRUTE_BALDWIN = Baldwin);
