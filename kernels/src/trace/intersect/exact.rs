//! The test without rounding: a triangle is hit if, and only if, the ray's line passes through it or its
//! border, on the numbers as they are; `t`, `u` and `v` are correctly rounded.
//!
//! Three stages, each for what the one before leaves open: floats turn away triangles that the ray passes at
//! more than they round; pairs of floats ([`pair`](super::pair)) find signs and quotients with bounds of
//! their errors; what those do not decide, one triangle of some hundreds, integers do ([`integers`]). The
//! filters follow Shewchuk 1997, the sheared edge functions Woop, Benthin & Wald 2013.
//!
//! Since answers are exact, neighbours need not agree about anything, and what was decided in which stage
//! does not show. Numbers of any size count, but origins' that would be subnormal in the scaled scene, and
//! distances `t` that would.

use super::{Best, Intersector, integers, pair::Pair, strict::shear};
use crate::{
    glam::{Vec3, Vec4},
    math::{abs, component, cycle, div, exp2, exponent, high, is_small, low},
    trace::frame::{Frame, HEADING},
};

/// The test.
#[derive(Clone, Copy, Debug)]
pub struct Exact;

/// A corner seen along the ray, times the direction's main component.
#[derive(Clone, Copy)]
struct Seen {
    x: Pair,
    y: Pair,
    /// Along the ray's main axis, exactly.
    z: Pair,
    /// The larger of `x` and `y`, in size.
    size: f32,
    /// Whether `x` and `y` are floats, and what they are.
    known: bool,
}

/// Products of smaller numbers may lose digits below the range of `f32`.
const PAIR_FLOOR: f32 = exp2(-36);

/// `x * main - side * z`, within `2^-46` of its size and `2^-63` of the scene's, and whether it is a float,
/// exactly.
#[inline(always)]
fn across(x: Pair, z: Pair, main: f32, side: f32) -> (Pair, bool) {
    let (p, q) = (Pair::product(x.hi, main), Pair::product(side, z.hi));
    let (r, s) = (Pair::product(x.lo, main), Pair::product(side, z.lo));
    let first = Pair::sum(p.hi, -q.hi);
    let second = Pair::sum(p.lo, -q.lo);
    let third = Pair::sum(r.hi, -s.hi);
    let fourth = Pair::sum(second.hi, third.hi);
    let fifth = Pair::sum(first.lo, fourth.hi);
    let rest = ((second.lo + third.lo) + (r.lo - s.lo)) + (fourth.lo + fifth.lo);
    let whole = Pair::sum(first.hi, fifth.hi);
    let found = Pair::sum(whole.hi, whole.lo + rest);
    let simple = (x.lo == 0.0)
        & (z.lo == 0.0)
        & !is_small(x.hi, PAIR_FLOOR)
        & !is_small(z.hi, PAIR_FLOOR)
        & !is_small(side, PAIR_FLOOR);
    let known = simple & (first.lo == 0.0) & (second.hi == 0.0) & (second.lo == 0.0);
    (found, known)
}

/// An edge function: how far apart its corners' directions are, whether its sign is certain, and which it is.
#[derive(Clone, Copy)]
pub(super) struct Edge {
    value: Pair,
    pub(super) positive: bool,
    pub(super) negative: bool,
    pub(super) certain: bool,
}

impl Edge {
    /// Of two corners; `error` bounds that of every edge function at hand.
    #[inline(always)]
    fn new(a: &Seen, b: &Seen, error: f32) -> Self {
        let value = a.x.times(b.y).plus(a.y.times(b.x).negative());
        // Of floats the signs are exact; with a corner on the ray the edge function is 0.
        let small = is_small(a.x.hi, PAIR_FLOOR)
            | is_small(a.y.hi, PAIR_FLOOR)
            | is_small(b.x.hi, PAIR_FLOOR)
            | is_small(b.y.hi, PAIR_FLOOR);
        let on_ray = (a.known & (a.size == 0.0)) | (b.known & (b.size == 0.0));
        let exact = on_ray | (a.known & b.known & !small);
        let certain = exact | (abs(value.hi) > error);
        let value = if on_ray { Pair::default() } else { value };
        Self { value, positive: certain & (value.hi > 0.0), negative: certain & (value.hi < 0.0), certain }
    }
}

/// What numbers with bounds of their errors tell.
struct Verdict {
    /// Whether that is all there is to know.
    certain: bool,
    /// Whether the triangle is hit, and not after the best hit so far.
    hit: bool,
    t: f32,
    u: f32,
    v: f32,
}

/// Between which numbers one lies when rounded, if it may be off by `error` and by what a device that flushes
/// subnormal numbers may take on the way.
#[inline(always)]
fn rounded(a: Pair, error: f32) -> (f32, f32) {
    let wide = error + abs(a.lo) * exp2(-20) + exp2(-100);
    (a.hi + (a.lo - wide), a.hi + (a.lo + wide))
}

/// What pairs of floats tell of a triangle's border.
pub(super) struct Looked {
    /// Whether the ray surely passes it by.
    pub(super) missed: bool,
    /// Edge functions from `c` to `b`, `a` to `c` and `b` to `a`, in the frame of the ray's main axis.
    pub(super) edges: (Edge, Edge, Edge),
    /// What bounds their errors.
    error: f32,
    /// Corners along the main axis.
    depths: (Pair, Pair, Pair),
    /// The direction along it.
    pub(super) dz: f32,
}

/// The second stage. With `M` the scene's size as seen from the origin and `S` that of the triangle across
/// the ray, `D` the sum of the weights: `x` and `y` of corners are within `2^-62 M + 2^-45 S`, edge functions
/// therefore within `2^-42 S^2 + 2^-59 M S`, twice what follows; weights and `t` follow from that.
#[inline(always)]
pub(super) fn look(ray: &Frame, (a, b, c): (Vec3, Vec3, Vec3)) -> Looked {
    let long = cycle(ray.heading, ray.main);
    // What is left out here is below the bounds.
    let shorter = |x: f32| {
        let bits = x.to_bits().wrapping_sub((HEADING as u32) << 23);
        if exponent(x) < HEADING - 64 { 0.0 } else { f32::from_bits(bits) }
    };
    let (dx, dy, dz) = (shorter(long.x), shorter(long.y), shorter(long.z));
    let whole = ((dx != 0.0) | (long.x == 0.0)) & ((dy != 0.0) | (long.y == 0.0));
    let from = cycle(ray.origin, ray.main);
    let seen = move |p: Vec3| {
        let p = cycle(p, ray.main);
        let (x, y, z) = (Pair::sum(p.x, -from.x), Pair::sum(p.y, -from.y), Pair::sum(p.z, -from.z));
        let (x, one) = across(x, z, dz, dx);
        let (y, two) = across(y, z, dz, dy);
        Seen { x, y, z, size: high(abs(x.hi), abs(y.hi)), known: one & two & whole }
    };
    let (a, b, c) = (seen(a), seen(b), seen(c));
    let far = ray.pad * exp2(19);
    let size = high(a.size, high(b.size, c.size));
    let error = exp2(-42) * size * size + exp2(-59) * far * size + exp2(-98);
    // All corners on one side: most triangles that the ray passes by.
    let aside = exp2(-44) * size + exp2(-61) * far;
    let below = high(a.x.hi, high(b.x.hi, c.x.hi)) < -aside || high(a.y.hi, high(b.y.hi, c.y.hi)) < -aside;
    let above = low(a.x.hi, low(b.x.hi, c.x.hi)) > aside || low(a.y.hi, low(b.y.hi, c.y.hi)) > aside;
    let (u, v, w) = (Edge::new(&c, &b, error), Edge::new(&a, &c, error), Edge::new(&b, &a, error));
    let negative = u.negative | v.negative | w.negative;
    let positive = u.positive | v.positive | w.positive;
    let sure = u.certain & v.certain & w.certain;
    // On both sides, or in the triangle's plane.
    let missed = below | above | (negative & positive) | (sure & !(negative | positive));
    Looked { missed, edges: (u, v, w), error, depths: (a.z, b.z, c.z), dz }
}

/// Where the ray meets a triangle's plane.
pub(super) struct Met {
    /// Whether the numbers are large enough to tell.
    pub(super) told: bool,
    /// Between which numbers `t` lies when rounded.
    pub(super) near: f32,
    pub(super) later: f32,
    /// Weights of the second and third corner, their sum with the first's, and its reciprocal.
    weights: (Pair, Pair),
    det: Pair,
    inverse: f32,
    /// How far weights may be off.
    off: f32,
}

impl Looked {
    /// Finds `t`, and weights that add up to 1 to 2.
    #[inline(always)]
    pub(super) fn meet(&self, ray: &Frame) -> Met {
        let (u, v, w) = (self.edges.0.value, self.edges.1.value, self.edges.2.value);
        let det = u.plus(v).plus(w);
        let told = exponent(det.hi) >= -70 && abs(det.hi) >= 64.0 * self.error;
        let det = if told { det } else { Pair { hi: 1.0, lo: 0.0 } };
        let unit = exp2(-exponent(det.hi));
        let by = Pair { hi: unit, lo: 0.0 };
        let (det, u, v, w) = (det.times(by), u.times(by), v.times(by), w.times(by));
        let inverse = div(1.0, det.hi);
        let off = abs(self.error * unit);
        let (a, b, c) = self.depths;
        let depth = u.times(a).plus(v.times(b)).plus(w.times(c));
        let along = component(ray.inverse, ray.main);
        let t = depth.over(det, inverse).over(Pair { hi: self.dz, lo: 0.0 }, along);
        let deep = high(abs(a.hi), high(abs(b.hi), abs(c.hi)));
        let (near, later) = rounded(t, deep * (16.0 * off + exp2(-39)));
        Met { told, near, later, weights: (v, w), det, inverse, off }
    }
}

impl Met {
    /// Whether `t` is surely what it is rounded to, and not 0.
    #[inline(always)]
    pub(super) fn sure(&self) -> bool {
        (self.near == self.later) & (abs(self.near) > exp2(-60))
    }
}

/// The answer by pairs.
#[inline(always)]
fn by_pairs(ray: &Frame, id: u32, corners: (Vec3, Vec3, Vec3), best: &Best) -> Verdict {
    let nothing = Verdict { certain: true, hit: false, t: 0.0, u: 0.0, v: 0.0 };
    let looked = look(ray, corners);
    if looked.missed {
        return nothing;
    }
    let met = looked.meet(ray);
    if !met.told {
        return Verdict { certain: false, ..nothing };
    }
    // Rounding keeps order, so this is certain too, and where the plane is met does not hang on signs of
    // weights.
    let (near, later) = (met.near, met.later);
    let behind = near > best.t || (near == later && near == best.t && id > best.triangle);
    if behind || near > ray.t_max || later < ray.t_min {
        return nothing;
    }
    let (weight_v, weight_w) = met.weights;
    let (u, v) = (weight_v.over(met.det, met.inverse), weight_w.over(met.det, met.inverse));
    let (u_near, u_later) = rounded(u, 8.0 * met.off + exp2(-41) * u.hi);
    let (v_near, v_later) = rounded(v, 8.0 * met.off + exp2(-41) * v.hi);
    // An exact 0 has no digits to be uncertain of.
    let (u_zero, v_zero) = (weight_v.hi == 0.0, weight_w.hi == 0.0);
    let (u_edge, v_edge, w_edge) = looked.edges;
    let certain = (u_edge.certain & v_edge.certain & w_edge.certain)
        & met.sure()
        & ((u_near == u_later) | u_zero)
        & ((v_near == v_later) | v_zero);
    Verdict {
        certain,
        hit: true,
        t: near,
        u: if u_zero { 0.0 } else { u_near },
        v: if v_zero { 0.0 } else { v_near },
    }
}

impl Intersector for Exact {
    const LOOPS: bool = true;
    const WHOLE: bool = true;

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    /// Sheared corners are off by at most a quarter of the pad, rounded products by `2^-24` of themselves: edge
    /// functions by less than `pad / 2` times the coordinates in them.
    #[inline(always)]
    fn may_hit(self, ray: &Frame, a: Vec4, b: Vec4, c: Vec4) -> bool {
        let s = shear(ray, a.truncate(), b.truncate(), c.truncate());
        let half = 0.5 * ray.pad;
        let (a, b, c) = (abs(s.ax) + abs(s.ay), abs(s.bx) + abs(s.by), abs(s.cx) + abs(s.cy));
        let u = s.cx * s.by - s.cy * s.bx;
        let v = s.ax * s.cy - s.ay * s.cx;
        let w = s.bx * s.ay - s.by * s.ax;
        let (eu, ev, ew) = (half * (b + c + half), half * (c + a + half), half * (a + b + half));
        let negative = (u < -eu) | (v < -ev) | (w < -ew);
        let positive = (u > eu) | (v > ev) | (w > ew);
        !(negative & positive)
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, a: Vec4, b: Vec4, c: Vec4, best: &mut Best) -> bool {
        let (a, b, c) = (a.truncate(), b.truncate(), c.truncate());
        let mut found = by_pairs(ray, id, (a, b, c), best);
        let mut whole = true;
        if !found.certain {
            let answer = integers::cross(ray.origin, ray.heading, a, b, c);
            found = Verdict { certain: true, hit: answer.hit, t: answer.t, u: answer.u, v: answer.v };
            whole = answer.whole;
        }
        if found.hit {
            best.offer(ray, Best { t: found.t, triangle: id, u: found.u, v: found.v, det: 1.0 });
        }
        whole
    }
}

test!(EXACT, brute_exact::BRUTE_EXACT = Exact);
