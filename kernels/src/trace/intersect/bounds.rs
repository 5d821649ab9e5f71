//! Between which numbers floats put the place where a ray meets a triangle's plane: enough to pass over what lies
//! behind the ray, or behind a hit that it has.

use super::{Glance, strict::Sheared};
use crate::{
    glam::Vec3,
    math::{Digits, component, exp2, least, most},
    trace::frame::Frame,
};

/// Smaller distances may be rounded in other ways than by their digits.
pub(super) const NEAR: f32 = exp2(-60);

/// Where rays start, and the reciprocals of their directions, by axis.
pub(in crate::trace) struct Starts<N> {
    pub origin: [N; 3],
    pub inverse: [N; 3],
}

impl<N: Digits> Starts<N> {
    /// On which sides of a triangle's plane they lie: on its normal's, behind it, neither if floats do not tell. Six
    /// products of three differences each, off by at most `2^-21` of their sizes; far from 0, so that `t` is, too.
    #[inline(always)]
    fn sides(&self, pad: N, (a, b, c): (Vec3, Vec3, Vec3)) -> (N::Mask, N::Mask) {
        let all = N::all;
        let (p, q, r) = (self.to(a), self.to(b), self.to(c));
        let (x, y) = (q.1 * r.2, q.2 * r.1);
        let (z, w) = (q.2 * r.0, q.0 * r.2);
        let (s, t) = (q.0 * r.1, q.1 * r.0);
        let volume = p.0 * (x - y) + p.1 * (z - w) + p.2 * (s - t);
        let sizes = p.0.abs() * (x.abs() + y.abs())
            + p.1.abs() * (z.abs() + w.abs())
            + p.2.abs() * (s.abs() + t.abs());
        let enough = all(exp2(-20)) * sizes + all(exp2(-60));
        let told = volume.abs().exceeds(enough) & pad.below(all(exp2(11)));
        let zero = all(0.0);
        (told & volume.below(zero), told & volume.exceeds(zero))
    }

    #[inline(always)]
    fn to(&self, p: Vec3) -> (N, N, N) {
        let [x, y, z] = self.origin;
        (N::all(p.x) - x, N::all(p.y) - y, N::all(p.z) - z)
    }

    /// If all corners are the same on an axis, how far that is, and the direction's reciprocal; else that is 0.
    #[inline(always)]
    fn along(&self, a: f32, b: f32, c: f32, axis: usize) -> (N, N) {
        let all = N::all;
        let inverse = self.inverse[axis];
        let distance = all(a) - self.origin[axis];
        let is = all(a).is(all(b))
            & all(b).is(all(c))
            & inverse.abs().below(all(exp2(40)))
            & distance.abs().exceeds(all(NEAR));
        (distance, N::choose(is, inverse, all(0.0)))
    }

    /// If all corners are as far away along an axis, how far, and the direction's reciprocal there; else that is 0.
    #[inline(always)]
    fn level(&self, (a, b, c): (Vec3, Vec3, Vec3)) -> (N, N) {
        let zero = N::all(0.0);
        let x = self.along(a.x, b.x, c.x, 0);
        let y = self.along(a.y, b.y, c.y, 1);
        let z = self.along(a.z, b.z, c.z, 2);
        let (by_x, by_y) = (!x.1.is(zero), !y.1.is(zero));
        (N::choose(by_x, x.0, N::choose(by_y, y.0, z.0)), N::choose(by_x, x.1, N::choose(by_y, y.1, z.1)))
    }
}

/// Edge functions by rounded products, and how far they may be off.
pub(in crate::trace) struct Edges<N: Digits> {
    u: N,
    v: N,
    w: N,
    errors: (N, N, N),
    /// The coordinates of each corner, added up by size.
    sizes: (N, N, N),
}

impl<N: Digits> Edges<N> {
    /// With `e = 2^-24` and `M` the scene's size as seen from the origin, the pad is `32 e M`, and sheared corners are
    /// off by at most `8 e M`. Coordinates are at most `2 M`, so the rounding of their products is worth `2 e M` to
    /// each.
    #[inline(always)]
    pub(in crate::trace) fn new(s: &Sheared<N>, pad: N) -> Self {
        let sizes = (s.ax.abs() + s.ay.abs(), s.bx.abs() + s.by.abs(), s.cx.abs() + s.cy.abs());
        let u = s.cx * s.by - s.cy * s.bx;
        let v = s.ax * s.cy - s.ay * s.cx;
        let w = s.bx * s.ay - s.by * s.ax;
        Self { u, v, w, errors: Self::errors(sizes, N::all(11.0 * exp2(-5)) * pad), sizes }
    }

    /// What edge functions are off by, if corners and the rounding of products are worth `off` to a coordinate.
    #[inline(always)]
    fn errors((a, b, c): (N, N, N), off: N) -> (N, N, N) {
        (off * (b + c + off), off * (c + a + off), off * (a + b + off))
    }

    /// The same with closer bounds, by where the triangle is. A corner at depth `z`, off by `e z`, is sheared by `S z`.
    /// `S` is off by `2 e`, the product by `e`, what it is taken from and the result by `e` of themselves. So the
    /// result `x` is off by `5 e z + 2 e x`, and the rounding of products is worth `2 e` of the largest `x`.
    #[inline(always)]
    pub(in crate::trace) fn closer(self, s: &Sheared<N>, pad: N) -> Self {
        let all = N::all;
        let (a, b, c) = self.sizes;
        let depth = most(s.az.abs(), s.bz.abs(), s.cz.abs());
        // Far more than what is too small for a float.
        let dust = all(exp2(-12)) * pad;
        let off = all(6.0 * exp2(-24)) * (depth + most(a, b, c)) + dust;
        Self { errors: Self::errors((a, b, c), off), ..self }
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
    pub(in crate::trace) fn new(edges: Edges<N>) -> Self {
        let all = N::all;
        let (eu, ev, ew) = edges.errors;
        let error = all(2.0) * (eu + ev + ew);
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
    /// apart. What rounding and the reciprocal add is less than half of the pad.
    #[inline(always)]
    pub(in crate::trace) fn range(&self, s: &Sheared<N>, along: N, pad: N) -> (N, N) {
        let Edges { u, v, w, .. } = self.edges;
        let unit = self.det.unit();
        let inverse = (self.det * unit).inverse();
        let t = s.depth(along, u * unit, v * unit, w * unit) * inverse;
        let spread = along.abs() * (most(s.az, s.bz, s.cz) - least(s.az, s.bz, s.cz));
        let off = N::all(4.0) * self.error * unit * inverse.abs() * spread + N::all(2.0) * pad;
        (t - off, t + off)
    }
}

/// What floats tell of `t`, as it is rounded, if the ray's line may pass through the triangle.
#[inline(always)]
pub(super) fn bounds(ray: &Frame, s: &Sheared, corners: (Vec3, Vec3, Vec3)) -> Glance {
    let starts = Starts {
        origin: [ray.origin.x, ray.origin.y, ray.origin.z],
        inverse: [ray.inverse.x, ray.inverse.y, ray.inverse.z],
    };
    let edges = Edges::new(s, ray.pad).closer(s, ray.pad);
    if !edges.may_hit() {
        // Met nowhere.
        return Glance { near: f32::INFINITY, later: f32::NEG_INFINITY, sure: false, leaving: false };
    }
    glance(s, edges, &starts, component(ray.inverse, ray.main), ray.pad, corners)
}

/// The same for one ray or several side by side.
#[inline(always)]
pub(in crate::trace) fn glance<N: Digits>(
    s: &Sheared<N>,
    edges: Edges<N>,
    starts: &Starts<N>,
    along: N,
    pad: N,
    corners: (Vec3, Vec3, Vec3),
) -> Glance<N> {
    let all = N::all;
    let zero = all(0.0);
    let through = Through::new(edges);
    let (known, sure) = (through.known, through.known & through.sure);
    let (none, any) = (all(f32::NEG_INFINITY), all(f32::INFINITY));
    if N::every(!known) {
        return Glance { near: none, later: any, sure, leaving: sure };
    }
    let leaving = through.leaves(along);
    // Across an axis it is met where that says.
    let (distance, way) = starts.level(corners);
    let is_level = known & !way.is(zero);
    let t = distance * way;
    let wide = t.abs() * all(exp2(-20));
    let (mut near, mut later) = (t - wide, t + wide);
    if N::every(is_level) {
        return Glance { near, later, sure, leaving };
    }
    let (from, to) = through.range(s, along, pad);
    near = N::choose(is_level, near, from);
    later = N::choose(is_level, later, to);
    let close = known & !is_level & near.below(zero) & later.exceeds(zero);
    if !N::every(!close) {
        // The direction's sign along the normal, and with it that of `t`.
        let (front, back) = starts.sides(pad, corners);
        let ahead = close & ((front & !leaving) | (back & leaving));
        let behind = close & ((front & leaving) | (back & !leaving));
        near = N::choose(ahead, all(exp2(-126)), near);
        later = N::choose(behind, all(-exp2(-126)), later);
    }
    Glance { near: N::choose(known, near, none), later: N::choose(known, later, any), sure, leaving }
}
