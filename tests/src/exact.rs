//! Geometry without rounding: the oracle for clipping.

use num_rational::BigRational;
use num_traits::{ToPrimitive as _, Zero as _};

/// A point with rational coordinates.
pub type Point = [BigRational; 3];

/// The number a finite `f32` is.
///
/// # Panics
/// It is not finite.
pub fn rational(x: f32) -> BigRational {
    BigRational::from_float(x).expect("a finite number")
}

/// The number's nearest `f64`, or about.
pub fn rough(x: &BigRational) -> f64 {
    x.to_f64().unwrap_or(f64::NAN)
}

/// The corners of `triangle ∩ cell`, both closed, some of them perhaps twice; none if they do not meet
/// (Sutherland & Hodgman 1974).
pub fn clip(triangle: [[f32; 3]; 3], lo: [f32; 3], hi: [f32; 3]) -> Vec<Point> {
    let mut polygon: Vec<Point> = triangle.iter().map(|p| p.map(rational)).collect();
    for axis in 0..3 {
        polygon = half(&polygon, axis, &rational(lo[axis]), false);
        polygon = half(&polygon, axis, &rational(hi[axis]), true);
    }
    polygon
}

/// The part of a convex polygon on one side of a plane, the plane included.
pub fn half(polygon: &[Point], axis: usize, at: &BigRational, below: bool) -> Vec<Point> {
    // How far outside.
    let out = |p: &Point| if below { &p[axis] - at } else { at - &p[axis] };
    let zero = BigRational::zero();
    let mut part = Vec::with_capacity(polygon.len() + 1);
    for (i, a) in polygon.iter().enumerate() {
        let b = &polygon[(i + 1) % polygon.len()];
        let (out_a, out_b) = (out(a), out(b));
        if out_a <= zero {
            part.push(a.clone());
        }
        if (out_a < zero && out_b > zero) || (out_a > zero && out_b < zero) {
            let t = &out_a / (&out_a - &out_b);
            part.push([0, 1, 2].map(|i| &a[i] + &t * (&b[i] - &a[i])));
        }
    }
    part
}
