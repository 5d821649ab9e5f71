//! Which triangles a ray crosses, and from which side: each crossing of a surface counts once, also at an edge or a
//! vertex.
//!
//! The rule is a simulation of simplicity (Edelsbrunner & Mücke 1990): the ray is taken to start not at its origin `o` but
//! at `o + s`, `s = (e, e^2, e^3)`, for a positive `e` smaller than any that would change an answer. Seen from there:
//!
//! * A corner pair's volume `d . (p x q)` becomes `d . (p x q) + s . ((p - q) x d)`. Where it is 0, the first component of
//!   `(p - q) x d` that is not 0 has its sign. All are 0 only if the edge is parallel to the ray; then so is the
//!   triangle, and is not crossed.
//! * The volume `a . (b x c)`, which is 0 where the origin lies in the triangle's plane, becomes that less `s . n`, `n` being
//!   the normal. Where it is 0, the first component of `n` that is not 0 decides on which side of the origin the plane
//!   is met.
//!
//! Polynomials in `e` that are not 0 everywhere have no root in some `0 < e < e_0`. For all those `e` the ray from `o + s`
//! meets no edge and no vertex, and starts in no triangle's plane, so whether it crosses a triangle is the same for all
//! of them, and is what the signs say. A closed surface is then crossed as often as in general position, and the signed
//! crossings, leaving less entering, are the winding number of `o + s`: a number of the point, not of the
//! direction, since `s` does not depend on `d`. docs/inside.md has the proof.
//!
//! Signs and `t` are exact, by the stages of [`exact`](super::exact). Where `t` is 0, or rounds to it, it is
//! [`AT_ORIGIN`] or the negative of that, by the second rule.

use super::{
    Best, Intersector,
    exact::{self, Edge, Exact},
    integers,
};
use crate::{
    glam::{Vec3, Vec4},
    math::{component, exp2},
    trace::frame::Frame,
};

/// The `t` of crossings next to the origin: smaller in size than any other that is not 0.
pub const AT_ORIGIN: f32 = exp2(-126);

/// The test. Of a hit `det` is 1 if the ray leaves by the triangle, that is along its normal, and -1 if it enters; `u` and
/// `v` are not found.
#[derive(Clone, Copy, Debug)]
pub struct Perturbed;

/// 1, 0 or -1 as `a` is larger than `b`, equal or smaller.
#[inline(always)]
fn compared(a: f32, b: f32) -> i32 {
    (a > b) as i32 - (a < b) as i32
}

/// The sign of the first component of `(p - q) x d` that is not 0; 0 if comparisons do not tell, or all are.
#[inline(always)]
fn beside(p: Vec3, q: Vec3, d: Vec3) -> i32 {
    let mut sign = 0;
    let mut unknown = false;
    let mut axis = 0;
    while axis < 3 {
        let j = if axis == 2 { 0 } else { axis + 1 };
        let k = if axis == 0 { 2 } else { axis - 1 };
        let first = compared(component(p, j), component(q, j)) * compared(component(d, k), 0.0);
        let second = compared(component(p, k), component(q, k)) * compared(component(d, j), 0.0);
        let difference = first - second;
        unknown |= (sign == 0) & (first == second) & (first != 0);
        sign = if sign == 0 && !unknown { difference } else { sign };
        axis += 1;
    }
    (sign > 0) as i32 - (sign < 0) as i32
}

/// The sign of `d . (p x q)` from the perturbed origin, `edge` being that of `q` and `p`; 0 if that is not certain.
#[inline(always)]
fn sign(edge: Edge, turned: bool, p: Vec3, q: Vec3, d: Vec3) -> i32 {
    let zero = edge.certain & !(edge.positive | edge.negative);
    let plain = (edge.negative != turned) as i32 - (edge.positive != turned) as i32;
    if zero {
        beside(p, q, d)
    } else if edge.certain {
        plain
    } else {
        0
    }
}

/// What is known of a triangle.
struct Verdict {
    certain: bool,
    crossed: bool,
    leaving: bool,
    t: f32,
}

#[inline(always)]
fn by_pairs(ray: &Frame, id: u32, (a, b, c): (Vec3, Vec3, Vec3), best: &Best) -> Verdict {
    let nothing = Verdict { certain: true, crossed: false, leaving: false, t: 0.0 };
    let looked = exact::look(ray, (a, b, c));
    if looked.missed {
        return nothing;
    }
    let turned = looked.dz < 0.0;
    let (u, v, w) = looked.edges;
    let d = ray.heading;
    let (u, v, w) = (sign(u, turned, b, c, d), sign(v, turned, c, a, d), sign(w, turned, a, b, d));
    if u * v < 0 || v * w < 0 || w * u < 0 {
        return nothing;
    }
    let met = looked.meet(ray);
    if u * v * w == 0 || !met.told {
        return Verdict { certain: false, ..nothing };
    }
    let (near, later) = (met.near, met.later);
    let behind = near > best.t || (near == later && near == best.t && id > best.triangle);
    if behind || near > ray.t_max || later < ray.t_min {
        return nothing;
    }
    Verdict { certain: met.sure(), crossed: true, leaving: u > 0, t: near }
}

impl Intersector for Perturbed {
    const LOOPS: bool = true;
    const WHOLE: bool = true;

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    #[inline(always)]
    fn may_hit(self, ray: &Frame, a: Vec4, b: Vec4, c: Vec4) -> bool {
        Exact.may_hit(ray, a, b, c)
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, a: Vec4, b: Vec4, c: Vec4, best: &mut Best) -> bool {
        let (a, b, c) = (a.truncate(), b.truncate(), c.truncate());
        let mut found = by_pairs(ray, id, (a, b, c), best);
        let mut whole = true;
        if !found.certain {
            let passed = integers::pass(ray.origin, ray.heading, a, b, c);
            let near = if passed.ahead { AT_ORIGIN } else { -AT_ORIGIN };
            let t = if passed.t == 0.0 { near } else { passed.t };
            found = Verdict { certain: true, crossed: passed.crossed, leaving: passed.leaving, t };
            whole = passed.whole;
        }
        if found.crossed {
            let det = if found.leaving { 1.0 } else { -1.0 };
            best.offer(ray, Best { t: found.t, triangle: id, u: 0.0, v: 0.0, det });
        }
        whole
    }
}
