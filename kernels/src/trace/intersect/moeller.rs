//! The test of Möller & Trumbore 1997, "Fast, minimum storage ray/triangle intersection", the one without
//! culling.
//!
//! Cramer's rule with the ray's direction and two edges. A shared edge is computed from other numbers in each
//! of its triangles, so rays pass between them. Determinants below `10^-6` count as parallel, in the mesh's
//! own units and for the direction's own length: small triangles vanish.
//!
//! The paper leaves as soon as `u` or `v` is out of range; here all is computed and looked at once, without a
//! division.

use super::{
    Best, Corners, Intersector,
    unit::{Unit, cross, dot},
    vertices,
};
use crate::{
    math::{abs, div, exp2, ldexp},
    trace::frame::{Frame, flush},
};

/// The paper's `EPSILON`.
const PARALLEL: f32 = 1.0e-6;
/// What the first look allows weights to be above 1, more than rounding can make of it.
const NEARLY: f32 = 1.0 + exp2(-12);
/// Weights below this are 0, and so is `t` below [`T_FLOOR`] in a [`Unit`].
const WEIGHT_FLOOR: f32 = exp2(-100);
const T_FLOOR: f32 = exp2(-40);
/// No scene is so far away, in a [`Unit`].
const BEYOND: f32 = exp2(60);

/// The test.
#[derive(Clone, Copy, Debug)]
pub struct Moeller {
    unit: Unit,
    /// [`PARALLEL`] for determinants of this ray.
    parallel: f32,
}

/// Cramer's numerators and denominator, with the sign that makes the denominator positive.
#[derive(Clone, Copy, Debug, Default)]
pub struct Solution {
    /// 0 for a parallel ray.
    det: f32,
    u: f32,
    v: f32,
    t: f32,
}

impl Moeller {
    #[inline(always)]
    fn solve(self, ray: &Frame, corners: Corners) -> Solution {
        let (a, b, c) = vertices(corners);
        let (ab, ac) = (self.unit.between(a, b), self.unit.between(a, c));
        let p = cross(ray.direction, ac);
        let det = dot(ab, p);
        let from = self.unit.between(a, ray.origin);
        let q = cross(from, ab);
        let sign = if det < 0.0 { -1.0 } else { 1.0 };
        let size = if abs(det) < self.parallel { 0.0 } else { abs(det) };
        Solution { det: size, u: sign * dot(from, p), v: sign * dot(ray.direction, q), t: sign * dot(ac, q) }
    }
}

impl Intersector for Moeller {
    type Seen = Solution;

    #[inline(always)]
    fn new(ray: &Frame) -> Self {
        let unit = Unit::new(ray);
        // A determinant is twice an area in scaled units, and as long as the direction.
        let parallel = ldexp(PARALLEL, 2 * unit.exponent + 3 * ray.scale - ray.stretch);
        Self { unit, parallel }
    }

    #[inline(always)]
    fn look(self, ray: &Frame, corners: Corners) -> (Solution, bool) {
        let s = self.solve(ray, corners);
        let most = s.det * NEARLY;
        (s, (s.u >= 0.0) & (s.v >= 0.0) & (s.u + s.v <= most) & (s.det > 0.0))
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, _corners: Corners, s: Solution, best: &mut Best) -> bool {
        if s.det > 0.0 && s.u >= 0.0 && s.v >= 0.0 {
            let inverse = div(1.0, s.det);
            let u = flush(s.u * inverse, WEIGHT_FLOOR);
            let v = flush(s.v * inverse, WEIGHT_FLOOR);
            let t = flush(s.t * inverse, T_FLOOR);
            if u <= 1.0 && u + v <= 1.0 && abs(t) < BEYOND {
                let t = self.unit.undone(t);
                best.offer(ray, Best { t, triangle: id, u, v, det: 1.0 });
            }
        }
        true
    }
}

test!(MOELLER, brute_moeller::BRUTE_MOELLER = Moeller);
