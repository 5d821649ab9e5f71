//! The watertight ray-triangle test (Woop, Benthin & Wald 2013), with signs that are exact.
//!
//! Vertices are translated to the ray's origin and sheared so that the ray runs along one axis; in the plane
//! across it, the origin is inside the triangle if the three edge functions have one sign. Each is a difference
//! of two products. Rounding is monotonic, so the rounded products compare as the exact ones do unless they are
//! equal, and then [`product_difference`] decides. The sheared vertices are the same numbers in every triangle
//! that shares them, so a closed mesh has no gaps, at edges and at vertices (the paper falls back to doubles here).

use super::frame::{CLAUSE, Frame, PAD, cycle, slab};
use crate::{
    glam::Vec3,
    math::{abs, div, exp2, high, low, product_difference},
};

/// Edge functions are kept at least this large when they are not zero, far from subnormals.
const EDGE_FLOOR: f32 = exp2(-80);
/// Depths smaller than this count as zero, so that an edge function times a depth is a normal number.
const DEPTH_FLOOR: f32 = exp2(-46);

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

/// `p - q` with an exact sign, away from subnormals; `p` and `q` are the rounded `a * b` and `c * d`.
#[inline(always)]
fn edge(p: f32, q: f32, a: f32, b: f32, c: f32, d: f32) -> f32 {
    let rough = p - q;
    if p == q {
        product_difference(a, b, c, d, EDGE_FLOOR)
    } else if abs(rough) < EDGE_FLOOR {
        if p < q { -EDGE_FLOOR } else { EDGE_FLOOR }
    } else {
        rough
    }
}

#[inline(always)]
fn flush(depth: f32) -> f32 {
    if abs(depth) < DEPTH_FLOOR { 0.0 } else { depth }
}

/// Tests triangle `id` with vertices `a`, `b`, `c` and keeps the better of it and `best`: smaller `t` wins,
/// then the smaller id.
#[inline(always)]
pub fn test(ray: &Frame, id: u32, a: Vec3, b: Vec3, c: Vec3, best: &mut Best) {
    let ra = cycle(a - ray.origin, ray.main);
    let rb = cycle(b - ray.origin, ray.main);
    let rc = cycle(c - ray.origin, ray.main);
    let (ax, ay) = (ra.x - ray.shear_x * ra.z, ra.y - ray.shear_y * ra.z);
    let (bx, by) = (rb.x - ray.shear_x * rb.z, rb.y - ray.shear_y * rb.z);
    let (cx, cy) = (rc.x - ray.shear_x * rc.z, rc.y - ray.shear_y * rc.z);
    let (up, uq) = (cx * by, cy * bx);
    let (vp, vq) = (ax * cy, ay * cx);
    let (wp, wq) = (bx * ay, by * ax);
    let negative = up < uq || vp < vq || wp < wq;
    let positive = up > uq || vp > vq || wp > wq;
    if !(negative && positive) {
        accept(ray, id, (a, b, c), (ra.z, rb.z, rc.z), [up, uq, vp, vq, wp, wq], [ax, ay, bx, by, cx, cy], best);
    }
}

/// The rare rest of [`test`]: the ray seems to pass through the triangle.
#[inline]
fn accept(
    ray: &Frame,
    id: u32,
    (a, b, c): (Vec3, Vec3, Vec3),
    (az, bz, cz): (f32, f32, f32),
    [up, uq, vp, vq, wp, wq]: [f32; 6],
    [ax, ay, bx, by, cx, cy]: [f32; 6],
    best: &mut Best,
) {
    let u = edge(up, uq, cx, by, cy, bx);
    let v = edge(vp, vq, ax, cy, ay, cx);
    let w = edge(wp, wq, bx, ay, by, ax);
    let negative = u < 0.0 || v < 0.0 || w < 0.0;
    let positive = u > 0.0 || v > 0.0 || w > 0.0;
    // Both: outside. Neither: the ray lies in the triangle's plane, a miss by contract.
    if negative != positive {
        let det = u + v + w;
        let along = super::frame::component(ray.inverse, ray.main);
        let depth = u * flush(along * az) + v * flush(along * bz) + w * flush(along * cz);
        let mut t = div(depth, det);
        // The box clause; see frame.rs.
        let slack = ray.pad * const { CLAUSE / PAD };
        let (o, i) = (ray.origin, ray.inverse);
        let (mut enter, mut exit) = (ray.t_min, ray.t_max);
        let lo = Vec3::new(low(low(a.x, b.x), c.x), low(low(a.y, b.y), c.y), low(low(a.z, b.z), c.z));
        let hi = Vec3::new(high(high(a.x, b.x), c.x), high(high(a.y, b.y), c.y), high(high(a.z, b.z), c.z));
        let inside = t >= enter && t <= exit;
        (enter, exit) = slab(lo.x, hi.x, o.x, i.x, slack, enter, exit);
        (enter, exit) = slab(lo.y, hi.y, o.y, i.y, slack, enter, exit);
        (enter, exit) = slab(lo.z, hi.z, o.z, i.z, slack, enter, exit);
        t = low(high(t, enter), exit);
        let better = t < best.t || (t == best.t && id < best.triangle);
        if inside && enter <= exit && better {
            *best = Best { t, triangle: id, u: v, v: w, det };
        }
    }
}
