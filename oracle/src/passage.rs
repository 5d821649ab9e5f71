//! Which triangles a ray crosses from an origin that is a little off: by moving it, and no other rule.

use crate::{Corners, exact::Exact, exact::integer};
use num_bigint::{BigInt, Sign};
use raykd_shared::Ray;

/// The origin moves by `(e, e^2, e^3)`, `e` being 2 to the power of minus this: less than any quotient of the volumes
/// that `f32` can span.
const SHIFT: u32 = 1000;

/// How a ray crosses a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passage {
    /// Whether it does along the triangle's normal.
    pub leaving: bool,
    /// Whether it does ahead of the origin.
    pub ahead: bool,
}

impl Passage {
    /// Of finite numbers. Nothing if the ray's line does not cross the triangle.
    pub fn new(ray: &Ray, corners: &Corners) -> Option<Self> {
        let fine = |x: f32| integer(x) << (3 * SHIFT);
        // In units in which `e^3` is the least.
        let moved =
            |axis: usize| fine(ray.origin[axis]) + (BigInt::from(1) << (149 + (2 - axis as u32) * SHIFT));
        let origin = [0, 1, 2].map(moved);
        let [a, b, c] = corners.map(|p| [0, 1, 2].map(|i| fine(p[i]) - &origin[i]));
        let d = ray.direction.map(integer);
        let volume = |x: &[BigInt; 3], y: &[BigInt; 3], z: &[BigInt; 3]| -> BigInt {
            [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
                .iter()
                .map(|&(i, j, k)| &x[i] * (&y[j] * &z[k] - &y[k] * &z[j]))
                .sum()
        };
        let weights = [volume(&d, &b, &c), volume(&d, &c, &a), volume(&d, &a, &b)];
        let is = |sign| weights.iter().all(|weight| weight.sign() == sign);
        let leaving = is(Sign::Plus);
        if !leaving && !is(Sign::Minus) {
            return None;
        }
        let along = volume(&a, &b, &c).sign();
        Some(Self { leaving, ahead: along == if leaving { Sign::Plus } else { Sign::Minus } })
    }

    /// Whether the crossing counts: by `t` as it is rounded, and on one side of 0 where that is 0.
    pub fn is_in_range(&self, ray: &Ray, corners: &Corners) -> bool {
        let t = Exact::new(ray, corners).rounded_t();
        let least = f64::from(f32::MIN_POSITIVE);
        let (from, to) = (f64::from(ray.t_min), f64::from(ray.t_max));
        if t.abs() >= least {
            from <= t && t <= to
        } else if self.ahead {
            from <= 0.0 && least <= to
        } else {
            from <= -least && 0.0 <= to
        }
    }
}
