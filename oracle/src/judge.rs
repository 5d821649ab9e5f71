//! Whether an answer in `f32` is the exact one of a scene of which no corner moved by more than some distance.

use crate::{Crossing, Oracle, exact::Corners};
use raykd_shared::{Hit, Ray};

/// A ray and a triangle whose corners may be off by a distance.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// How far inside the triangle the ray passes, measured across its main axis; negative outside.
    pub margin: f64,
    /// The smallest and the largest `t` that the triangle may be hit at; the wrong way round if the ray passes by.
    pub t: [f64; 2],
}

/// Why an answer is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// A miss, or too far a hit, where the ray meets a triangle.
    Missed,
    /// A hit of a triangle that the ray passes by, or that is none.
    Invented,
    /// A hit of the right triangle at a wrong place.
    Misplaced,
    /// A hit outside `t_min` to `t_max`.
    OutOfRange,
}

impl Sight {
    /// The ray against the triangle, moved by up to `slack` along any axis. Errors of `f64` are too small to count
    /// beside a slack of some ULP of `f32`.
    pub fn new(ray: &Ray, corners: &Corners, slack: f64) -> Self {
        let d = ray.direction.map(f64::from);
        let main = (1..3).fold(0, |best, i| if d[i].abs() > d[best].abs() { i } else { best });
        let (i, j) = ((main + 1) % 3, (main + 2) % 3);
        let seen = corners.map(|p| {
            let p = [0, 1, 2].map(|k| f64::from(p[k]) - f64::from(ray.origin[k]));
            [p[i] - d[i] / d[main] * p[main], p[j] - d[j] / d[main] * p[main], p[main]]
        });
        let cross = |a: Seen, b: Seen| a[0] * b[1] - a[1] * b[0];
        let edges = [0, 1, 2].map(|k| cross(seen[k], seen[(k + 1) % 3]));
        let inside = edges.iter().all(|&e| e >= 0.0) || edges.iter().all(|&e| e <= 0.0);
        let to_edge = (0..3)
            .map(|k| {
                let (a, b) = (seen[k], seen[(k + 1) % 3]);
                let ab = [b[0] - a[0], b[1] - a[1]];
                let length = ab[0] * ab[0] + ab[1] * ab[1];
                let s = if length > 0.0 { -(a[0] * ab[0] + a[1] * ab[1]) / length } else { 0.0 };
                let s = s.clamp(0.0, 1.0);
                (a[0] + s * ab[0]).hypot(a[1] + s * ab[1])
            })
            .fold(f64::INFINITY, f64::min);
        // A mean of the moved corners lies on the ray; the same mean of the true ones is a point of the triangle within
        // `slack` of it, and their depths differ by at most that.
        let near = near_ray(seen.to_vec(), slack);
        let depths = near.iter().map(|p| p[2]);
        let nearest = depths.clone().fold(f64::INFINITY, f64::min) - slack;
        let farthest = depths.fold(f64::NEG_INFINITY, f64::max) + slack;
        let t = [nearest / d[main], farthest / d[main]];
        let t = if d[main] < 0.0 { [t[1], t[0]] } else { t };
        Self { margin: if inside && edges != [0.0; 3] { to_edge } else { -to_edge }, t }
    }
}

/// A point seen along the ray: across it, and how far along its main axis.
type Seen = [f64; 3];

/// The part of a convex polygon that is within a distance of the ray, on each axis across it (Sutherland & Hodgman
/// 1974).
fn near_ray(mut polygon: Vec<Seen>, distance: f64) -> Vec<Seen> {
    for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let out = |p: &Seen| sign * p[axis] - distance;
        let mut part = Vec::with_capacity(polygon.len() + 1);
        for (i, a) in polygon.iter().enumerate() {
            let b = &polygon[(i + 1) % polygon.len()];
            let (out_a, out_b) = (out(a), out(b));
            if out_a <= 0.0 {
                part.push(*a);
            }
            if (out_a < 0.0 && out_b > 0.0) || (out_a > 0.0 && out_b < 0.0) {
                let s = out_a / (out_a - out_b);
                part.push([0, 1, 2].map(|k| a[k] + s * (b[k] - a[k])));
            }
        }
        polygon = part;
    }
    polygon
}

impl Oracle {
    /// What is wrong with an answer to a ray, if anything; `crossings` are its exact hits.
    ///
    /// Right is what is exact for corners moved by up to `slack`; where that leaves a choice of hits that are closer
    /// together than the slack, any of them. The answer's `t` itself may be rounded by 2 ULP; where it is 0 or infinite
    /// for want of room, the hit is where its triangle is.
    pub fn judge(&self, ray: &Ray, crossings: &[Crossing], answer: &Hit, slack: f64) -> Option<Fault> {
        // Where the answer is, so far as `f32` can tell.
        let mut at = [f64::INFINITY; 2];
        if answer.is_hit() {
            if !(ray.t_min <= answer.t && answer.t <= ray.t_max) {
                return Some(Fault::OutOfRange);
            }
            let Some(corners) = self.triangles.get(answer.triangle as usize) else {
                return Some(Fault::Invented);
            };
            let sight = Sight::new(ray, corners, slack);
            if sight.margin < -slack {
                return Some(Fault::Invented);
            }
            let [least, most] = meant(answer.t);
            if most < sight.t[0] || least > sight.t[1] {
                return Some(Fault::Misplaced);
            }
            let nearest = sight.t[0] - sight.t[0].abs() * f64::from(f32::EPSILON);
            at = [least.max(nearest), most.min(sight.t[1])];
        }
        let (t_min, t_max) = (f64::from(ray.t_min), f64::from(ray.t_max));
        let missed = |crossing: &Crossing| {
            if crossing.t > at[1] {
                return false;
            }
            let sight = Sight::new(ray, self.corners(crossing.triangle), slack);
            let in_range = sight.t[0] > t_min && sight.t[1] < t_max;
            sight.margin > slack && in_range && sight.t[1] < at[0]
        };
        crossings.iter().any(missed).then_some(Fault::Missed)
    }
}

/// The least and the largest number that `t` may stand for.
fn meant(t: f32) -> [f64; 2] {
    let (wide, most) = (f64::from(t), f64::from(f32::MAX));
    if t == 0.0 {
        [-f64::from(f32::MIN_POSITIVE), f64::from(f32::MIN_POSITIVE)]
    } else {
        let rounding = wide.abs().min(most) * f64::from(f32::EPSILON);
        [wide.min(most) - rounding, wide.max(-most) + rounding]
    }
}

/// How far a `t` is from the exact one, in ULP of the exact one.
pub fn ulps(t: f32, exact: f64) -> f64 {
    let size = (exact as f32).abs().clamp(f32::MIN_POSITIVE, f32::MAX);
    let ulp = f64::from(f32::from_bits(size.to_bits() & 0x7F80_0000)) * f64::from(f32::EPSILON);
    (f64::from(t) - exact).abs() / ulp
}
