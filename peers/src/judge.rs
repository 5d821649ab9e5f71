//! Who is right where two answers differ: the ray against the two triangles in question, in f64.

use crate::peers::Answer;
use raykd::{Mesh, Ray};

/// How far, relative to `t`, an answer may lie from the exact one: grazing rays reach 5e-3 in f32.
pub const NEAR: f32 = 5.0e-3;
/// Barycentric weights closer to 0 than this are left to f32's rounding.
const EDGE: f64 = 1.0e-4;

/// Counts of one peer's answers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Verdict {
    pub wrong: usize,
    pub unclear: usize,
}

/// Whether each of two answers is wrong beyond doubt.
pub fn judge(mesh: &Mesh, ray: &Ray, x: Answer, y: Answer) -> [bool; 2] {
    let near = f64::from(NEAR);
    if x.agrees(y) {
        return [false; 2];
    }
    let [sx, sy] = [x, y].map(|answer| answer.is_hit().then(|| sight(mesh, ray, answer.triangle)));
    let wrong = |one: Answer, own: Option<Sight>, other: Option<Sight>| {
        let invented = own.is_some_and(|s| {
            s.margin < -EDGE || (s.margin > EDGE && (s.t - f64::from(one.t)).abs() > near * s.t.abs())
        });
        let (t_min, t_max) = (f64::from(ray.t_min), f64::from(ray.t_max));
        let missed = other.is_some_and(|s| {
            let seen = s.margin > EDGE && s.t > t_min + near * s.t && s.t < t_max - near * s.t;
            seen && (!one.is_hit() || f64::from(one.t) > s.t * (1.0 + near))
        });
        invented || missed
    };
    [wrong(x, sx, sy), wrong(y, sy, sx)]
}

/// A ray and a triangle's plane: where they meet, and the smallest barycentric weight there.
#[derive(Clone, Copy)]
struct Sight {
    t: f64,
    margin: f64,
}

fn sight(mesh: &Mesh, ray: &Ray, triangle: u32) -> Sight {
    let [a, b, c] = mesh.triangles()[triangle as usize].map(|i| mesh.positions()[i as usize].map(f64::from));
    let (origin, d) = (ray.origin.map(f64::from), ray.direction.map(f64::from));
    let (ab, ac, ao) = (sub(b, a), sub(c, a), sub(origin, a));
    let normal = cross(ab, ac);
    let det = -dot(d, normal);
    let (u, v) = (dot(ac, cross(ao, d)) / det, -dot(ab, cross(ao, d)) / det);
    Sight { t: dot(ao, normal) / det, margin: u.min(v).min(1.0 - u - v) }
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
