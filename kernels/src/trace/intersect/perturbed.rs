//! Which triangles a ray crosses, and from which side: each crossing of a surface counts once, also at an edge or a
//! vertex.
//!
//! The rule is a simulation of simplicity (Edelsbrunner & Mücke 1990): the ray is taken to start not at its origin `o`
//! but at `o + s`, `s = (e, e^2, e^3)`, for a positive `e` smaller than any that would change an answer. Seen from
//! there:
//!
//! * A corner pair's volume `d . (p x q)` becomes `d . (p x q) + s . ((p - q) x d)`. Where it is 0, the first component
//!   of `(p - q) x d` that is not 0 has its sign. All are 0 only if the edge is parallel to the ray; then so is the
//!   triangle, and is not crossed.
//! * The volume `a . (b x c)`, which is 0 where the origin lies in the triangle's plane, becomes that less `s . n`, `n`
//!   being the normal. Where it is 0, the first component of `n` that is not 0 decides on which side of the origin the
//!   plane is met.
//!
//! Polynomials in `e` that are not 0 everywhere have no root in some `0 < e < e_0`. For all those `e` the ray from `o +
//! s` meets no edge and no vertex, and starts in no triangle's plane, so whether it crosses a triangle is the same for
//! all of them, and is what the signs say. A closed surface is then crossed as often as in general position, and the
//! signed crossings, leaving less entering, are the winding number of `o + s`: a number of the point, not of the
//! direction, since `s` does not depend on `d`.
//!
//! Signs are exact, and `t` is rounded correctly: by pairs of floats or doubles and, where those do not tell, by
//! integers, as in [`exact`](super::exact). Where `t` is 0, or rounds to it, it is [`AT_ORIGIN`] or the negative of
//! that, by the second rule.

use super::{
    Best, Corners, Intersector,
    exact::Exact,
    filter::{Edge, First, Line, all_turned, look},
    integers, vertices,
};
use crate::{
    glam::Vec3,
    math::{exp2, high, low, product_difference_wide},
    pair::Pair,
    trace::frame::Frame,
};

/// The `t` of crossings next to the origin: smaller in size than any other that is not 0.
pub const AT_ORIGIN: f32 = exp2(-126);

/// Whether the ray's range, scaled, reaches the side of 0 on which a crossing next to the origin is. To compare its
/// ends with [`AT_ORIGIN`] is not enough: what lies between that and 0 is scaled to the same number.
#[inline(always)]
fn counts_at_origin(ray: &Frame, ahead: bool) -> bool {
    if ahead { ray.t_min <= 0.0 } else { ray.t_max >= 0.0 }
}

/// The test. Of a hit `det` is 1 if the ray leaves by the triangle, that is along its normal, and -1 if it enters; `u`
/// and `v` are not found, and if not `ORDERED`, `t` neither: hits are then in the ray's range, in no order.
#[derive(Clone, Copy, Debug)]
pub struct Perturbed<const ORDERED: bool>;

/// `p - q`, and whether that is exact.
#[inline(always)]
fn difference(p: Vec3, q: Vec3) -> (Vec3, bool) {
    let (x, y, z) = (Pair::sum(p.x, -q.x), Pair::sum(p.y, -q.y), Pair::sum(p.z, -q.z));
    (Vec3::new(x.hi, y.hi, z.hi), (x.lo == 0.0) & (y.lo == 0.0) & (z.lo == 0.0))
}

/// The signs of the components of `v x w`.
#[inline(always)]
fn signs(v: Vec3, w: Vec3) -> (i32, i32, i32) {
    let sign = |a: f32, b: f32, c: f32, d: f32| {
        let (size, _) = product_difference_wide(a, b, c, d);
        (size > 0.0) as i32 - (size < 0.0) as i32
    };
    (sign(v.y, w.z, v.z, w.y), sign(v.z, w.x, v.x, w.z), sign(v.x, w.y, v.y, w.x))
}

/// The first that is not 0.
#[inline(always)]
fn first((x, y, z): (i32, i32, i32)) -> i32 {
    if x != 0 {
        x
    } else if y != 0 {
        y
    } else {
        z
    }
}

/// The sign of `d . (p x q)` from the perturbed origin, `edge` being that of `q` and `p`; 0 if that is not certain.
#[inline(always)]
fn sign(edge: Edge, turned: bool, p: Vec3, q: Vec3, d: Vec3) -> i32 {
    if !edge.certain {
        0
    } else if edge.positive | edge.negative {
        (edge.negative != turned) as i32 - (edge.positive != turned) as i32
    } else {
        let (v, exact) = difference(p, q);
        if exact { first(signs(v, d)) } else { 0 }
    }
}

/// Where the origin lies in the triangle's plane, seen by floats: the sign of the first component of the normal that is
/// not 0; else 0.
#[inline(always)]
fn in_plane(origin: Vec3, (a, b, c): (Vec3, Vec3, Vec3)) -> i32 {
    let ((v, one), (w, two)) = (difference(b, a), difference(c, a));
    let (x, y, z) = signs(v, w);
    // Every term of the volume is 0, for one corner or another.
    let level = |p: Vec3| {
        ((x == 0) | (p.x == origin.x)) & ((y == 0) | (p.y == origin.y)) & ((z == 0) | (p.z == origin.z))
    };
    if one & two & (level(a) | level(b) | level(c)) { first((x, y, z)) } else { 0 }
}

/// What is known of a triangle.
struct Verdict {
    certain: bool,
    crossed: bool,
    leaving: bool,
    t: f32,
}

/// What pairs tell.
#[inline(always)]
fn by_pairs<const ORDERED: bool>(
    ray: &Frame,
    id: u32,
    (a, b, c): (Vec3, Vec3, Vec3),
    best: &Best,
) -> Verdict {
    let nothing = Verdict { certain: true, crossed: false, leaving: false, t: 0.0 };
    let line = Line::of(ray);
    let looked = look::<First>(&line, &all_turned((a, b, c), ray.main));
    if looked.missed {
        return nothing;
    }
    let turned = line.way.z < 0.0;
    let (u, v, w) = looked.edges;
    let d = ray.heading;
    let (u, v, w) = (sign(u, turned, b, c, d), sign(v, turned, c, a, d), sign(w, turned, a, b, d));
    if u * v < 0 || v * w < 0 || w * u < 0 {
        return nothing;
    }
    let met = looked.meet(&line);
    if u * v * w == 0 || !met.told {
        return Verdict { certain: false, ..nothing };
    }
    let (mut near, mut later) = (met.near, met.later);
    // At 0 it is for the rule.
    let mut certain = met.sure() & !(near == 0.0);
    if !ORDERED {
        certain |= (near > ray.t_min) & (later < ray.t_max);
    }
    if !certain && near <= 0.0 && later >= 0.0 {
        // The perturbed volume has the other sign.
        let normal = in_plane(ray.origin, (a, b, c));
        certain = normal != 0;
        if certain {
            let ahead = (normal > 0) != (u > 0);
            if !counts_at_origin(ray, ahead) {
                return nothing;
            }
            near = if ahead { AT_ORIGIN } else { -AT_ORIGIN };
            later = near;
        } else {
            // Of which side of 0 it is nothing is known.
            (near, later) = (low(near, -AT_ORIGIN), high(later, AT_ORIGIN));
        }
    }
    let behind = near > best.t || (near == later && near == best.t && id > best.triangle);
    if behind || near > ray.t_max || later < ray.t_min {
        return nothing;
    }
    Verdict { certain, crossed: true, leaving: u > 0, t: near }
}

impl<const ORDERED: bool> Intersector for Perturbed<ORDERED> {
    type Seen = ();

    const LOOPS: bool = true;
    const WHOLE: bool = true;

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    #[inline(always)]
    fn look(self, ray: &Frame, corners: Corners) -> ((), bool) {
        ((), Exact.look(ray, corners).1)
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, corners: Corners, _seen: (), best: &mut Best) -> bool {
        let (a, b, c) = vertices(corners);
        let mut found = by_pairs::<ORDERED>(ray, id, (a, b, c), best);
        let mut whole = true;
        if !found.certain {
            let passed = integers::pass(ray.origin, ray.heading, a, b, c);
            let near = if passed.ahead { AT_ORIGIN } else { -AT_ORIGIN };
            let at_origin = passed.t == 0.0;
            let crossed = passed.crossed & (!at_origin | counts_at_origin(ray, passed.ahead));
            let t = if at_origin { near } else { passed.t };
            found = Verdict { certain: true, crossed, leaving: passed.leaving, t };
            whole = passed.whole;
        }
        if found.crossed {
            let det = if found.leaving { 1.0 } else { -1.0 };
            best.offer(ray, Best { t: found.t, triangle: id, u: 0.0, v: 0.0, det });
        }
        whole
    }
}
