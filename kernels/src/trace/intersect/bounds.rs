//! Between which numbers floats put the place where a ray meets a triangle's plane: enough to pass over what lies
//! behind the ray, or behind a hit that it has.

use super::{
    Glance,
    strict::{Sheared, shear},
};
use crate::{
    glam::Vec3,
    math::{Digits, abs, component, exp2},
    trace::frame::Frame,
};

/// Where the ray's origin lies, seen from the triangle's plane: 1 on its normal's side, -1 behind it, 0 if floats do
/// not tell. Six products of three differences each, off by at most `2^-21` of their sizes; far from 0, so that `t` is,
/// too.
#[inline(always)]
fn side(origin: Vec3, far: f32, (a, b, c): (Vec3, Vec3, Vec3)) -> i32 {
    let (p, q, r) = (a - origin, b - origin, c - origin);
    let (x, y) = (q.y * r.z, q.z * r.y);
    let (z, w) = (q.z * r.x, q.x * r.z);
    let (s, t) = (q.x * r.y, q.y * r.x);
    let volume = p.x * (x - y) + p.y * (z - w) + p.z * (s - t);
    let sizes = abs(p.x) * (abs(x) + abs(y)) + abs(p.y) * (abs(z) + abs(w)) + abs(p.z) * (abs(s) + abs(t));
    let told = (abs(volume) > exp2(-20) * sizes + exp2(-60)) & (far < exp2(30));
    told as i32 * ((volume < 0.0) as i32 - (volume > 0.0) as i32)
}

/// Smaller distances may be rounded in other ways than by their digits.
pub(super) const NEAR: f32 = exp2(-60);

/// If all corners are as far away along an axis, how far, and the direction's reciprocal there; else that is 0.
#[inline(always)]
fn level(ray: &Frame, (a, b, c): (Vec3, Vec3, Vec3)) -> (f32, f32) {
    let along = |x: f32, y: f32, z: f32, from: f32, inverse: f32| {
        let distance = x - from;
        let is = (x == y) & (y == z) & (abs(inverse) < exp2(40)) & (abs(distance) > NEAR);
        (distance, if is { inverse } else { 0.0 })
    };
    let (from, inverse) = (ray.origin, ray.inverse);
    let x = along(a.x, b.x, c.x, from.x, inverse.x);
    let y = along(a.y, b.y, c.y, from.y, inverse.y);
    let z = along(a.z, b.z, c.z, from.z, inverse.z);
    let found = if abs(y.1) > 0.0 { y } else { z };
    if abs(x.1) > 0.0 { x } else { found }
}

/// Edge functions by rounded products, and how far they may be off. Sheared corners are off by at most a quarter of the
/// pad, rounded products by `2^-24` of themselves: an edge function by less than `pad / 2` times the coordinates in it.
pub(in crate::trace) struct Edges<N: Digits> {
    u: N,
    v: N,
    w: N,
    errors: (N, N, N),
    /// The sum of all coordinates, by size.
    size: N,
}

impl<N: Digits> Edges<N> {
    #[inline(always)]
    pub(in crate::trace) fn new(s: &Sheared<N>, pad: N) -> Self {
        let half = N::all(0.5) * pad;
        let (a, b, c) = (s.ax.abs() + s.ay.abs(), s.bx.abs() + s.by.abs(), s.cx.abs() + s.cy.abs());
        let u = s.cx * s.by - s.cy * s.bx;
        let v = s.ax * s.cy - s.ay * s.cx;
        let w = s.bx * s.ay - s.by * s.ax;
        let errors = (half * (b + c + half), half * (c + a + half), half * (a + b + half));
        Self { u, v, w, errors, size: a + b + c }
    }

    /// Which are surely negative, and which positive: u, v and w.
    #[inline(always)]
    fn signs(&self) -> ([N::Mask; 3], [N::Mask; 3]) {
        let (eu, ev, ew) = self.errors;
        (
            [self.u.below(-eu), self.v.below(-ev), self.w.below(-ew)],
            [self.u.exceeds(eu), self.v.exceeds(ev), self.w.exceeds(ew)],
        )
    }

    /// Whether the ray's line may pass through the triangle.
    #[inline(always)]
    pub(in crate::trace) fn may_hit(&self) -> N::Mask {
        let (negative, positive) = self.signs();
        let negative = negative[0] | negative[1] | negative[2];
        let positive = positive[0] | positive[1] | positive[2];
        !(negative & positive)
    }
}

/// How a ray's line passes through a triangle's border.
pub(in crate::trace) struct Through<N: Digits> {
    edges: Edges<N>,
    det: N,
    error: N,
    /// Whether anything is known: not where the ray is all but parallel to the plane.
    pub known: N::Mask,
    /// Whether it surely passes through.
    pub sure: N::Mask,
}

impl<N: Digits> Through<N> {
    /// Edge functions are off by an eighth of what their sum is compared with.
    #[inline(always)]
    pub(in crate::trace) fn new(edges: Edges<N>, pad: N) -> Self {
        let all = N::all;
        let error = all(2.0) * pad * (edges.size + all(0.75) * pad);
        let det = edges.u + edges.v + edges.w;
        let known = det.abs().exceeds(all(4.0) * error);
        let (negative, positive) = edges.signs();
        let sure = (positive[0] & positive[1] & positive[2]) | (negative[0] & negative[1] & negative[2]);
        Self { edges, det, error, known, sure }
    }

    /// Whether along the triangle's normal, on a ray whose main component has the reciprocal `along`.
    #[inline(always)]
    pub(in crate::trace) fn leaves(&self, along: N) -> N::Mask {
        let zero = N::all(0.0);
        let (up, back) = (self.det.exceeds(zero), along.below(zero));
        (up & back) | !(up | back)
    }

    /// Between which numbers `t` lies, as it is rounded: it hangs on edge functions by how far the corners' depths are
    /// apart.
    #[inline(always)]
    pub(in crate::trace) fn range(&self, s: &Sheared<N>, along: N, pad: N) -> (N, N) {
        let Edges { u, v, w, .. } = self.edges;
        let unit = self.det.unit();
        let inverse = N::all(1.0).over(self.det * unit);
        let t = s.depth(along, u * unit, v * unit, w * unit) * inverse;
        let spread = along.abs() * (s.az.high(s.bz.high(s.cz)) - s.az.low(s.bz.low(s.cz)));
        let off = N::all(4.0) * self.error * unit * inverse.abs() * spread + N::all(2.0) * pad;
        (t - off, t + off)
    }
}

/// What floats tell of `t`, as it is rounded, if the ray's line may pass through the triangle.
#[inline(always)]
pub(super) fn bounds(ray: &Frame, (a, b, c): (Vec3, Vec3, Vec3)) -> Glance {
    let s = shear(ray, a, b, c);
    let through = Through::new(Edges::new(&s, ray.pad), ray.pad);
    if !through.known {
        return Glance { near: f32::NEG_INFINITY, later: f32::INFINITY, sure: false, leaving: false };
    }
    let sure = through.sure;
    let along = component(ray.inverse, ray.main);
    let leaving = through.leaves(along);
    // Across an axis it is met where that says.
    let (distance, way) = level(ray, (a, b, c));
    if abs(way) > 0.0 {
        let (t, wide) = (distance * way, abs(distance * way) * exp2(-20));
        return Glance { near: t - wide, later: t + wide, sure, leaving };
    }
    let (near, later) = through.range(&s, along, ray.pad);
    if (near < 0.0) & (later > 0.0) {
        // The direction's sign along the normal, and with it that of `t`.
        let ahead = side(ray.origin, ray.pad * exp2(19), (a, b, c)) * if leaving { -1 } else { 1 };
        let least = exp2(-126);
        let (near, later) = (if ahead > 0 { least } else { near }, if ahead < 0 { -least } else { later });
        return Glance { near, later, sure, leaving };
    }
    Glance { near, later, sure, leaving }
}
