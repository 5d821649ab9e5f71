//! The watertight ray-triangle test (Woop, Benthin & Wald 2013), with signs that are exact.
//!
//! Vertices are translated to the ray's origin and sheared so that the ray runs along one axis; in the plane
//! across it, the origin is inside the triangle if the three edge functions have one sign. Each is a difference
//! of two products. Rounding is monotonic, so the rounded products compare as the exact ones do unless they are
//! equal, and then [`product_difference`] decides. The sheared vertices are the same numbers in every triangle
//! that shares them, so a closed mesh has no gaps, at edges and at vertices (the paper falls back to doubles here).

use super::frame::{CLAUSE, Frame, PAD, component, cycle, slab};
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

/// `a * b - c * d` with an exact sign, away from subnormals.
#[inline(always)]
fn edge(a: f32, b: f32, c: f32, d: f32) -> f32 {
    let (p, q) = (a * b, c * d);
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

/// A triangle's vertices seen from a ray: moved to its origin, sheared along it.
struct Sheared {
    ax: f32,
    ay: f32,
    bx: f32,
    by: f32,
    cx: f32,
    cy: f32,
    az: f32,
    bz: f32,
    cz: f32,
}

#[inline(always)]
fn shear(ray: &Frame, a: Vec3, b: Vec3, c: Vec3) -> Sheared {
    let ra = cycle(a - ray.origin, ray.main);
    let rb = cycle(b - ray.origin, ray.main);
    let rc = cycle(c - ray.origin, ray.main);
    Sheared {
        ax: ra.x - ray.shear_x * ra.z,
        ay: ra.y - ray.shear_y * ra.z,
        bx: rb.x - ray.shear_x * rb.z,
        by: rb.y - ray.shear_y * rb.z,
        cx: rc.x - ray.shear_x * rc.z,
        cy: rc.y - ray.shear_y * rc.z,
        az: ra.z,
        bz: rb.z,
        cz: rc.z,
    }
}

/// Whether the ray's line may pass through the triangle: no edge function contradicts another. The cheap part
/// of the test; few triangles get past it without being hit.
#[inline(always)]
pub fn may_hit(ray: &Frame, a: Vec3, b: Vec3, c: Vec3) -> bool {
    let s = shear(ray, a, b, c);
    let (up, uq) = (s.cx * s.by, s.cy * s.bx);
    let (vp, vq) = (s.ax * s.cy, s.ay * s.cx);
    let (wp, wq) = (s.bx * s.ay, s.by * s.ax);
    let negative = (up < uq) | (vp < vq) | (wp < wq);
    let positive = (up > uq) | (vp > vq) | (wp > wq);
    !(negative & positive)
}

/// The whole test of triangle `id`: keeps the better of it and `best`. Smaller `t` wins, then the smaller id.
#[inline(always)]
pub fn test(ray: &Frame, id: u32, a: Vec3, b: Vec3, c: Vec3, best: &mut Best) {
    let s = shear(ray, a, b, c);
    let u = edge(s.cx, s.by, s.cy, s.bx);
    let v = edge(s.ax, s.cy, s.ay, s.cx);
    let w = edge(s.bx, s.ay, s.by, s.ax);
    let negative = u < 0.0 || v < 0.0 || w < 0.0;
    let positive = u > 0.0 || v > 0.0 || w > 0.0;
    // Both: outside. Neither: the ray lies in the triangle's plane, a miss by contract.
    if negative != positive {
        let det = u + v + w;
        let along = component(ray.inverse, ray.main);
        let depth = u * flush(along * s.az) + v * flush(along * s.bz) + w * flush(along * s.cz);
        let t = div(depth, det);
        // The box clause; see frame.rs.
        let slack = ray.pad * const { CLAUSE / PAD };
        let (o, i) = (ray.origin, ray.inverse);
        let lo = Vec3::new(low(low(a.x, b.x), c.x), low(low(a.y, b.y), c.y), low(low(a.z, b.z), c.z));
        let hi = Vec3::new(high(high(a.x, b.x), c.x), high(high(a.y, b.y), c.y), high(high(a.z, b.z), c.z));
        let (enter, exit) = slab(lo.x, hi.x, o.x, i.x, slack, ray.t_min, ray.t_max);
        let (enter, exit) = slab(lo.y, hi.y, o.y, i.y, slack, enter, exit);
        let (enter, exit) = slab(lo.z, hi.z, o.z, i.z, slack, enter, exit);
        let inside = t >= ray.t_min && t <= ray.t_max && enter <= exit;
        let t = low(high(t, enter), exit);
        let better = t < best.t || (t == best.t && id < best.triangle);
        if inside && better {
            *best = Best { t, triangle: id, u: v, v: w, det };
        }
    }
}
