//! The quick way to what [`exact`] finds: floats with bounds of their errors tell which triangle a ray hits first, and only
//! that one is looked at more closely, once a ray's walk is over. Rays of which that leaves anything open, a few in a
//! thousand, are for [`exact`] itself.
//!
//! A hit between bounds is taken if it surely comes before the one at hand, and passed over if it surely comes behind.

use super::{
    Best,
    exact::{self, Exact},
    pair::Pair,
    strict::shear,
};
#[cfg(not(target_arch = "spirv"))]
use crate::trace::queries::Query;
use crate::{
    glam::{UVec4, Vec3, Vec4},
    math::{abs, component, div, exp2, exponent, high, low},
    mem::{Atomics, Buf, Slots, scratch},
    trace::{
        frame::Frame,
        intersect::Intersector,
        job::{JOB_ANY, JOB_RAYS, OUTCOME_STATUS, load, record},
        traverse::{
            Steps,
            leaf::{Choice, Every},
            stack::{ASIDE, walk},
        },
    },
};
use raykd_shared::{MISS, TreeHeader};

/// Behind what a walk lays aside: the lower bound of the hit at hand, whose upper one is its `t`;
const LEAST: u32 = ASIDE as u32;
/// and its triangle's corners.
const CORNERS: u32 = LEAST + 1;
/// Words of that.
const WORDS: usize = ASIDE + 10;

/// In a miss, in place of `t`: the ray is open. No hit has so small a number there.
const LEFT_OPEN: u32 = 1;

/// What is open is written as this.
const OPEN_HIT: UVec4 = UVec4::new(MISS, LEFT_OPEN, 0, 0);

/// Whether a ray is for [`exact`].
#[inline(always)]
fn is_open(hit: UVec4) -> bool {
    (hit.x == MISS) & (hit.y == LEFT_OPEN)
}

/// What floats tell of a triangle.
struct Bounds {
    /// Whether the ray's line surely passes through it.
    inside: bool,
    /// Between which numbers `t` lies; if neither is one, nothing is known.
    near: f32,
    later: f32,
}

/// Where the ray's origin lies, seen from the triangle's plane: 1 on its normal's side, -1 behind it, 0 if floats do not tell.
/// Six products of three differences each, off by at most `2^-21` of their sizes; far from 0, so that `t` is, too.
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

/// If all corners are as far away along an axis, how far, and the direction's reciprocal there; else that is 0.
#[inline(always)]
fn level(ray: &Frame, (a, b, c): (Vec3, Vec3, Vec3)) -> (f32, f32) {
    let mut found = (0.0, 0.0);
    let mut axis = 0;
    while axis < 3 {
        let (x, y, z) = (component(a, axis), component(b, axis), component(c, axis));
        let inverse = component(ray.inverse, axis);
        if (x == y) & (y == z) & (abs(inverse) < exp2(40)) {
            found = (x - component(ray.origin, axis), inverse);
        }
        axis += 1;
    }
    found
}

/// The bounds of edge functions are twice those of [`Exact::may_hit`]; `t` hangs on them by how far the corners' depths are
/// apart.
#[inline(always)]
fn bounds(ray: &Frame, (a, b, c): (Vec3, Vec3, Vec3)) -> Bounds {
    let s = shear(ray, a, b, c);
    let half = 0.5 * ray.pad;
    let (x, y, z) = (abs(s.ax) + abs(s.ay), abs(s.bx) + abs(s.by), abs(s.cx) + abs(s.cy));
    let (eu, ev, ew) = (ray.pad * (y + z + half), ray.pad * (z + x + half), ray.pad * (x + y + half));
    let (u, v, w) = (s.cx * s.by - s.cy * s.bx, s.ax * s.cy - s.ay * s.cx, s.bx * s.ay - s.by * s.ax);
    let positive = (u > eu) & (v > ev) & (w > ew);
    let negative = (u < -eu) & (v < -ev) & (w < -ew);
    let (error, det) = (eu + ev + ew, u + v + w);
    let unit = exp2(-exponent(det));
    let inverse = div(1.0, det * unit);
    let along = component(ray.inverse, ray.main);
    let t = s.depth(along, u * unit, v * unit, w * unit) * inverse;
    let spread = abs(along) * (high(s.az, high(s.bz, s.cz)) - low(s.az, low(s.bz, s.cz)));
    let off = 4.0 * error * unit * abs(inverse) * spread + 2.0 * ray.pad;
    // Where the ray is all but parallel to the plane, nothing is known.
    let known = abs(det) > 4.0 * error;
    let mut near = if known { t - off } else { f32::NEG_INFINITY };
    let mut later = if known { t + off } else { f32::INFINITY };
    // Across an axis it is met where that says, 0 included.
    let (distance, way) = level(ray, (a, b, c));
    if known & (abs(way) > 0.0) {
        let (t, wide) = (distance * way, abs(distance * way) * exp2(-20));
        (near, later) = (t - wide, t + wide);
    } else if known & (near < 0.0) & (later > 0.0) {
        // The direction's sign along the normal, and with it that of `t`.
        let forward = (det > 0.0) == (along < 0.0);
        let side = side(ray.origin, ray.pad * exp2(19), (a, b, c)) * if forward { -1 } else { 1 };
        near = if side > 0 { 0.0 } else { near };
        later = if side < 0 { -exp2(-126) } else { later };
    }
    Bounds { inside: positive | negative, near, later }
}

/// Keeps the hit that surely comes first. Says that a loop was left early where floats and pairs do not tell.
#[derive(Clone, Copy, Debug)]
struct First;

#[inline(always)]
fn put_corner(aside: &mut impl Slots<u32>, at: u32, p: Vec3) {
    aside.put(at, p.x.to_bits());
    aside.put(at + 1, p.y.to_bits());
    aside.put(at + 2, p.z.to_bits());
}

#[inline(always)]
fn corner(aside: &impl Slots<u32>, at: u32) -> Vec3 {
    let f = |i: u32| f32::from_bits(aside.at(at + i));
    Vec3::new(f(0), f(1), f(2))
}

impl Choice for First {
    #[inline(always)]
    fn test<I: Intersector>(
        self,
        _by: I,
        ray: &Frame,
        id: u32,
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        aside: &mut impl Slots<u32>,
    ) -> bool {
        let corners = (a.truncate(), b.truncate(), c.truncate());
        let Bounds { mut inside, mut near, mut later } = bounds(ray, corners);
        let none = best.triangle == MISS;
        let least = if none { best.t } else { f32::from_bits(aside.at(LEAST)) };
        let before = |later: f32| (later < least) | (none & (later <= least));
        let passed = |near: f32, later: f32| (later < ray.t_min) | (near > best.t) | (id == best.triangle);
        let mut told = true;
        if !passed(near, later) && !(inside & (near >= ray.t_min) & before(later)) {
            let limit = Best { t: best.t, ..Best::NOTHING };
            let found = exact::by::<Pair>(ray, id, corners, &limit);
            inside = found.hit;
            // Without a hit it is passed over.
            (near, later) = if found.hit { (found.t, found.t) } else { (f32::INFINITY, f32::INFINITY) };
            let settled = passed(near, later) | before(later);
            told = found.certain & (settled | !found.hit);
        }
        if told & inside & !passed(near, later) {
            *best = Best { t: later, triangle: id, ..Best::NOTHING };
            aside.put(LEAST, near.to_bits());
            put_corner(aside, CORNERS, corners.0);
            put_corner(aside, CORNERS + 3, corners.1);
            put_corner(aside, CORNERS + 6, corners.2);
        }
        told
    }
}

/// Answers ray `i`, or leaves it open.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn answer(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) {
    if i < job.at(JOB_RAYS) {
        let mut ray = load(i, rays, &header.at(0), outcome);
        let mut steps = Steps::default();
        let mut aside = scratch::<u32, WORDS>();
        let any = job.at(JOB_ANY) != 0;
        let first = walk::<Exact, First, false>(&mut ray, pairs, corners, First, any, &mut aside, &mut steps);
        let mut open = steps.status != 0;
        let mut best = first;
        if !open && first.triangle != MISS {
            let at = |k: u32| corner(&aside, CORNERS + 3 * k);
            let found = exact::by::<Pair>(&ray, first.triangle, (at(0), at(1), at(2)), &Best::NOTHING);
            open = !(found.certain & found.hit);
            best = Best { t: found.t, triangle: first.triangle, u: found.u, v: found.v, det: 1.0 };
        }
        hits.put(i, if open { OPEN_HIT } else { record(&ray, &best) });
    }
}

/// Answers ray `i` if it is open.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn close(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) {
    if i < job.at(JOB_RAYS) && is_open(hits.at(i)) {
        let mut ray = load(i, rays, &header.at(0), outcome);
        let mut steps = Steps::default();
        let mut aside = scratch::<u32, ASIDE>();
        let any = job.at(JOB_ANY) != 0;
        let best = walk::<Exact, Every, false>(&mut ray, pairs, corners, Every, any, &mut aside, &mut steps);
        hits.put(i, record(&ray, &best));
        if steps.status != 0 {
            outcome.or(OUTCOME_STATUS, steps.status);
        }
    }
}

/// The rays that [`BOUNDED`] leaves open.
pub mod open {
    #[cfg(not(target_arch = "spirv"))]
    use super::Query;
    use super::close;

    of_query! {
        kernel {
            /// [`close`] over all rays.
            map OPEN = close, threads 64, query:
        } { , {} }
    }
}

of_query! {
    kernel {
        /// [`answer`] over all rays.
        map BOUNDED = answer, threads 64, query:
    } { , {} }
}
