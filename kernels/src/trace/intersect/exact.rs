//! The test without rounding: a triangle is hit if, and only if, the ray's line passes through it or its
//! border, on the numbers as they are; `t`, `u` and `v` are correctly rounded.
//!
//! Stages, each for what the one before leaves open: floats turn away triangles that the ray passes at more than they
//! round, or that surely lie behind it or a hit that it has; pairs of floats ([`pair`](super::pair)) find signs and
//! quotients with bounds of their errors, but for a `t` next to 0, which the volume of triangle and origin gives; what
//! those do not decide, one triangle of some hundreds, triples do ([`triple`](super::triple)); and what is left after
//! those, hardly any, integers do ([`integers`]). The filters follow Shewchuk 1997, the sheared edge functions Woop,
//! Benthin & Wald 2013.
//!
//! Since answers are exact, neighbours need not agree about anything, and what was decided in which stage
//! does not show. Numbers of any size count, but origins' that would be subnormal in the scaled scene, and
//! distances `t` that would.

use super::{
    Best, Glance, Intersector,
    bounds::{Edges, NEAR, bounds},
    integers,
    pair::{Long, Pair},
    strict::shear,
    triple::Triple,
};
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
struct Seen<N> {
    x: N,
    y: N,
    /// Along the ray's main axis, exactly.
    z: Pair,
    /// The larger of `x` and `y`, in size.
    size: f32,
    /// Whether `x` and `y` are floats, and what they are.
    known: bool,
}

/// Products of smaller numbers may lose digits below the range of `f32`.
const PAIR_FLOOR: f32 = exp2(-36);

/// `x * main - side * z`, see [`Long::across`], and whether it is a float, exactly.
#[inline(always)]
fn across<N: Long>(x: Pair, z: Pair, main: f32, side: f32) -> (N, bool) {
    let (p, q) = (Pair::product(x.hi, main), Pair::product(side, z.hi));
    let (r, s) = (Pair::product(x.lo, main), Pair::product(side, z.lo));
    let first = Pair::sum(p.hi, -q.hi);
    let second = Pair::sum(p.lo, -q.lo);
    let simple = (x.lo == 0.0)
        & (z.lo == 0.0)
        & !is_small(x.hi, PAIR_FLOOR)
        & !is_small(z.hi, PAIR_FLOOR)
        & !is_small(side, PAIR_FLOOR);
    let known = simple & (first.lo == 0.0) & (second.hi == 0.0) & (second.lo == 0.0);
    (N::across(p, q, r, s), known)
}

/// An edge function: how far apart its corners' directions are, whether its sign is certain, and which it is.
#[derive(Clone, Copy)]
pub(super) struct Edge<N = Pair> {
    value: N,
    pub(super) positive: bool,
    pub(super) negative: bool,
    pub(super) certain: bool,
    /// What the value may be off by.
    error: f32,
}

impl<N: Long> Edge<N> {
    /// Of two corners of a scene of size `far`.
    #[inline(always)]
    fn new(a: &Seen<N>, b: &Seen<N>, far: f32) -> Self {
        let products = abs(a.x.hi() * b.y.hi()) + abs(a.y.hi() * b.x.hi());
        let sizes = (abs(a.x.hi()) + abs(a.y.hi())) + (abs(b.x.hi()) + abs(b.y.hi()));
        let error = N::EDGE * products + N::EDGE_FAR * far * sizes + exp2(-98);
        let value = a.x.times(b.y).plus(a.y.times(b.x).negative());
        // Of floats the signs are exact; with a corner on the ray the edge function is 0.
        let small = is_small(a.x.hi(), PAIR_FLOOR)
            | is_small(a.y.hi(), PAIR_FLOOR)
            | is_small(b.x.hi(), PAIR_FLOOR)
            | is_small(b.y.hi(), PAIR_FLOOR);
        let on_ray = (a.known & (a.size == 0.0)) | (b.known & (b.size == 0.0));
        let exact = on_ray | (a.known & b.known & !small);
        let certain = exact | (abs(value.hi()) > error);
        let value = if on_ray { N::default() } else { value };
        let hi = value.hi();
        Self { value, positive: certain & (hi > 0.0), negative: certain & (hi < 0.0), certain, error }
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

/// What is told of a triangle's border.
pub(super) struct Looked<N = Pair> {
    /// Whether the numbers had all the digits they need: else nothing is told.
    whole: bool,
    /// Whether the ray surely passes it by.
    pub(super) missed: bool,
    /// Edge functions from `c` to `b`, `a` to `c` and `b` to `a`, in the frame of the ray's main axis.
    pub(super) edges: (Edge<N>, Edge<N>, Edge<N>),
    /// Corners along the main axis.
    depths: (Pair, Pair, Pair),
    /// The direction along it.
    pub(super) dz: f32,
    /// If all corners are as far away along an axis, how far, by 0 or more than [`NEAR`], and the direction along it;
    /// else that is 0.
    level: (Pair, f32),
}

/// The second stage, and the third. With `M` the scene's size as seen from the origin, pairs have coordinates `x` within
/// `2^-48 |x| + 2^-64 M`, and an edge function `x y' - y x'` therefore, see [`Long::times`] and [`Long::plus`], within
/// `2^-44.2 (|x y'| + |y x'|) + 2^-64 M (|x| + |y| + |x'| + |y'|)`. Triples have `2^-62 |x| + 2^-79 M`, and `2^-59` and
/// `2^-77` in the latter. Weights and `t` follow from that.
#[inline(always)]
pub(super) fn look<N: Long>(ray: &Frame, (a, b, c): (Vec3, Vec3, Vec3)) -> Looked<N> {
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
        let (x, one): (N, bool) = across(x, z, dz, dx);
        let (y, two): (N, bool) = across(y, z, dz, dy);
        Seen { x, y, z, size: high(abs(x.hi()), abs(y.hi())), known: one & two & whole }
    };
    let level = level_of(cycle(a, ray.main), cycle(b, ray.main), cycle(c, ray.main), from, (dx, dy, dz));
    let (a, b, c) = (seen(a), seen(b), seen(c));
    let far = ray.pad * exp2(19);
    let size = high(a.size, high(b.size, c.size));
    // All corners on one side: most triangles that the ray passes by.
    let aside = N::CORNER * size + N::CORNER_FAR * far;
    let (x, y) = ((a.x.hi(), b.x.hi(), c.x.hi()), (a.y.hi(), b.y.hi(), c.y.hi()));
    let below = high(x.0, high(x.1, x.2)) < -aside || high(y.0, high(y.1, y.2)) < -aside;
    let above = low(x.0, low(x.1, x.2)) > aside || low(y.0, low(y.1, y.2)) > aside;
    let (u, v, w) = (Edge::new(&c, &b, far), Edge::new(&a, &c, far), Edge::new(&b, &a, far));
    let negative = u.negative | v.negative | w.negative;
    let positive = u.positive | v.positive | w.positive;
    let sure = u.certain & v.certain & w.certain;
    // On both sides, or in the triangle's plane.
    let missed = below | above | (negative & positive) | (sure & !(negative | positive));
    let whole = whole | !N::WHOLE;
    Looked { whole, missed: missed & whole, edges: (u, v, w), depths: (a.z, b.z, c.z), dz, level }
}

/// [`Looked::level`], of corners, an origin and a direction with the main axis last.
#[inline(always)]
fn level_of(a: Vec3, b: Vec3, c: Vec3, from: Vec3, (dx, dy, dz): (f32, f32, f32)) -> (Pair, f32) {
    // Equal bits: a device may take a small difference for none.
    let is = |a: f32, b: f32, c: f32, from: f32| {
        (a == b) & (b == c) & ((a.to_bits() == from.to_bits()) | (abs(a - from) > NEAR))
    };
    if is(a.z, b.z, c.z, from.z) {
        (Pair::sum(a.z, -from.z), dz)
    } else if is(a.x, b.x, c.x, from.x) {
        (Pair::sum(a.x, -from.x), dx)
    } else if is(a.y, b.y, c.y, from.y) {
        (Pair::sum(a.y, -from.y), dy)
    } else {
        (Pair::default(), 0.0)
    }
}

/// Where the ray meets a triangle's plane.
pub(super) struct Met<N = Pair> {
    /// Whether the numbers are large enough to tell.
    pub(super) told: bool,
    /// Between which numbers `t` lies when rounded.
    pub(super) near: f32,
    pub(super) later: f32,
    /// Whether `t` is 0.
    zero: bool,
    /// Weights of the second and third corner, their sum with the first's, and its reciprocal.
    weights: (N, N),
    det: N,
    inverse: f32,
    /// The power of two by which edge functions were multiplied for that.
    unit: f32,
    /// How far weights may be off, as parts of their sum: the second, the third, and what `t`, `u` and `v` are times.
    off: (f32, f32, f32),
}

impl<N: Long> Looked<N> {
    /// Finds `t`, and weights that add up to 1 to 2.
    #[inline(always)]
    pub(super) fn meet(&self, ray: &Frame) -> Met<N> {
        let (u, v, w) = (self.edges.0.value, self.edges.1.value, self.edges.2.value);
        let det = u.plus(v).plus(w);
        let (eu, ev, ew) = (self.edges.0.error, self.edges.1.error, self.edges.2.error);
        let error = eu + ev + ew;
        let told = self.whole && exponent(det.hi()) >= -70 && abs(det.hi()) >= 32.0 * error;
        let det = if told { det } else { N::of(Pair { hi: 1.0, lo: 0.0 }) };
        let unit = exp2(-exponent(det.hi()));
        let (det, u, v, w) = (det.by_power(unit), u.by_power(unit), v.by_power(unit), w.by_power(unit));
        let inverse = div(1.0, det.hi());
        // The quotient of a weight and the sum, both off, the latter by a 32nd at most: 32 / 31, and room for rounding.
        let part = 1.25 * abs(unit * inverse);
        let off = (part * ev, part * ew, part * error);
        let (a, b, c) = self.depths;
        let depth = u.times(N::of(a)).plus(v.times(N::of(b))).plus(w.times(N::of(c)));
        let along = component(ray.inverse, ray.main);
        let t = depth.over(det, inverse).over(N::of(Pair { hi: self.dz, lo: 0.0 }), along).pair();
        let deep = high(abs(a.hi), high(abs(b.hi), abs(c.hi)));
        // `t` hangs on weights by how far the corners' depths are apart.
        let spread = high(a.hi, high(b.hi, c.hi)) - low(a.hi, low(b.hi, c.hi)) + exp2(-22) * deep;
        let (mut near, mut later) = rounded(t, off.2 * spread + N::DEPTH * deep);
        // A triangle across an axis is met where that says.
        let (distance, way) = self.level;
        if way != 0.0 {
            let t = distance.over(Pair { hi: way, lo: 0.0 }, div(1.0, way));
            (near, later) = rounded(t, abs(t.hi) * exp2(-40));
        }
        let zero = (way != 0.0) & (distance.hi == 0.0);
        if zero {
            (near, later) = (0.0, 0.0);
        }
        Met { told, near, later, zero, weights: (v, w), det, inverse, unit, off }
    }
}

/// Six times the volume of three points and a fourth, and what it may be off by.
#[inline(always)]
fn volume(from: Vec3, (a, b, c): (Vec3, Vec3, Vec3)) -> (Triple, f32) {
    let seen = move |at: f32, from: f32| Pair::sum(at, -from);
    let part = move |(a, b, c, d, e): (Pair, Pair, Pair, Pair, Pair)| {
        let (p, q) = (Triple::of(b).times(Triple::of(c)), Triple::of(d).times(Triple::of(e)));
        (p.plus(q.negative()).times(Triple::of(a)), abs(a.hi) * (abs(b.hi * c.hi) + abs(d.hi * e.hi)))
    };
    let (ax, ay, az) = (seen(a.x, from.x), seen(a.y, from.y), seen(a.z, from.z));
    let (bx, by, bz) = (seen(b.x, from.x), seen(b.y, from.y), seen(b.z, from.z));
    let (cx, cy, cz) = (seen(c.x, from.x), seen(c.y, from.y), seen(c.z, from.z));
    let (x, y, z) = (part((ax, by, cz, bz, cy)), part((ay, bz, cx, bx, cz)), part((az, bx, cy, by, cx)));
    (x.0.plus(y.0).plus(z.0), exp2(-56) * (x.1 + y.1 + z.1) + exp2(-90))
}

impl<N: Long> Met<N> {
    /// Finds `t` by the volume of the triangle and the ray's origin. Where that lies all but in the triangle's plane, the
    /// mean of depths has lost its digits, and the volume has enough of them.
    #[inline(always)]
    fn near_plane(&mut self, ray: &Frame, corners: (Vec3, Vec3, Vec3), dz: f32) {
        let (six, error) = volume(ray.origin, corners);
        let along = six.by_power(self.unit).pair().times(Pair { hi: -dz, lo: 0.0 });
        let t = along.over(self.det.pair(), self.inverse);
        // The direction along the main axis is less than 2, and there is room for rounding.
        let off = abs(t.hi) * (self.off.2 + exp2(-38)) + 2.5 * error * abs(self.unit * self.inverse);
        (self.near, self.later) = rounded(t, off);
    }
}

impl<N> Met<N> {
    /// Whether `t` is surely what it is rounded to.
    #[inline(always)]
    pub(super) fn sure(&self) -> bool {
        (self.near == self.later) & ((abs(self.near) > exp2(-60)) | self.zero)
    }
}

/// The answer by pairs or triples. A page loads every byte of each copy, so there it has one.
#[cfg_attr(target_arch = "wasm32", inline(never))]
#[cfg_attr(not(target_arch = "wasm32"), inline(always))]
fn by<N: Long>(ray: &Frame, id: u32, corners: (Vec3, Vec3, Vec3), best: &Best) -> Verdict {
    let nothing = Verdict { certain: true, hit: false, t: 0.0, u: 0.0, v: 0.0 };
    let looked = look::<N>(ray, corners);
    if looked.missed {
        return nothing;
    }
    let mut met = looked.meet(ray);
    if !met.told {
        return Verdict { certain: false, ..nothing };
    }
    if N::FIRST && !met.sure() {
        met.near_plane(ray, corners, looked.dz);
    }
    // Rounding keeps order, so this is certain too, and where the plane is met does not hang on signs of
    // weights.
    let (near, later) = (met.near, met.later);
    let behind = near > best.t || (near == later && near == best.t && id > best.triangle);
    if behind || near > ray.t_max || later < ray.t_min {
        return nothing;
    }
    let (weight_v, weight_w) = met.weights;
    let u = weight_v.over(met.det, met.inverse).pair();
    let v = weight_w.over(met.det, met.inverse).pair();
    let (u_near, u_later) = rounded(u, met.off.0 + (met.off.2 + N::WEIGHT) * u.hi);
    let (v_near, v_later) = rounded(v, met.off.1 + (met.off.2 + N::WEIGHT) * v.hi);
    // An exact 0 has no digits to be uncertain of.
    let (u_zero, v_zero) = (weight_v.hi() == 0.0, weight_w.hi() == 0.0);
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

impl Exact {
    /// What floats tell.
    #[inline(always)]
    pub fn glance(self, ray: &Frame, (a, b, c): (Vec4, Vec4, Vec4)) -> Glance {
        bounds(ray, (a.truncate(), b.truncate(), c.truncate()))
    }

    /// [`Exact::test`] without that look.
    #[inline(always)]
    pub fn settle(self, ray: &Frame, id: u32, (a, b, c): (Vec4, Vec4, Vec4), best: &mut Best) -> bool {
        let (a, b, c) = (a.truncate(), b.truncate(), c.truncate());
        let mut found = by::<Pair>(ray, id, (a, b, c), best);
        let mut whole = true;
        if !found.certain {
            found = by::<Triple>(ray, id, (a, b, c), best);
        }
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

impl Intersector for Exact {
    const LOOPS: bool = true;
    const WHOLE: bool = true;

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    #[inline(always)]
    fn may_hit(self, ray: &Frame, a: Vec4, b: Vec4, c: Vec4) -> bool {
        Edges::new(&shear(ray, a.truncate(), b.truncate(), c.truncate()), ray.pad).may_hit()
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, a: Vec4, b: Vec4, c: Vec4, best: &mut Best) -> bool {
        // The triangle that a ray starts on, most of all, and one that it has met in another leaf.
        let Glance { near, later, .. } = self.glance(ray, (a, b, c));
        let passed = later < ray.t_min || near > best.t || near > ray.t_max || id == best.triangle;
        passed || self.settle(ray, id, (a, b, c), best)
    }
}

test!(EXACT, brute_exact::BRUTE_EXACT = Exact);

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;
    use raykd_shared::{Ray, TreeHeader};

    /// Random bits of a seed, Marsaglia's xorshift.
    struct Bits(u64);

    impl Bits {
        fn below(&mut self, n: u64) -> u64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 16) % n
        }

        /// From -1 to 1.
        fn unit(&mut self) -> f32 {
            self.below(1 << 24) as f32 / (1 << 23) as f32 - 1.0
        }
    }

    /// A triangle that a ray meets: of any size from the scene's to a millionth of it, blunt or thin, square to the ray
    /// or grazed, near the ray's origin or far off, some at an edge.
    fn met(bits: &mut Bits) -> (Ray, [Vec3; 3]) {
        let mut vector = || Vec3::new(bits.unit(), bits.unit(), bits.unit());
        let (origin, at, one, two) = (vector(), vector(), vector(), vector());
        let mut power = |most: u64| exp2(-(bits.below(most) as i32));
        let (size, thin, near, graze) = (power(20), power(14), power(24), power(14));
        let at = origin + (at - origin) * near;
        let way = at - origin;
        let two = if bits.below(2) == 0 { two } else { way * (1.0 / size) + two * graze };
        let (u, v) = (bits.unit().abs(), bits.unit().abs());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let u = if bits.below(8) == 0 { 0.0 } else { u };
        let (one, two) = (one * size, two * (size * thin));
        let a = at - one * u - two * v;
        (Ray::new(origin.to_array(), way.to_array()), [a, a + one, a + two])
    }

    /// What is certain by floats, pairs or triples is what integers find.
    fn compare(seed: u64, count: u32) -> [u32; 4] {
        let header = TreeHeader { lo: [-2.0; 3], hi: [2.0; 3], scale: 1.0, ..TreeHeader::zeroed() };
        let mut bits = Bits(seed);
        let mut told = [0; 4];
        for _ in 0..count {
            let (ray, [a, b, c]) = met(&mut bits);
            let frame = Frame::of(&ray, &header).whole();
            if !frame.valid {
                continue;
            }
            let right = integers::cross(frame.origin, frame.heading, a, b, c);
            let in_range = right.hit && right.t >= frame.t_min;
            let seen = bounds(&frame, (a, b, c));
            if right.hit {
                assert!(seen.near <= right.t && right.t <= seen.later, "{ray:?} {a} {b} {c}");
            }
            if seen.sure {
                assert!(right.hit, "{ray:?} {a} {b} {c}");
                told[0] += 1;
            }
            for (i, found) in [
                by::<Pair>(&frame, 0, (a, b, c), &Best::NOTHING),
                by::<Triple>(&frame, 0, (a, b, c), &Best::NOTHING),
            ]
            .iter()
            .enumerate()
            {
                if found.certain {
                    told[1 + i] += 1;
                    assert_eq!(found.hit, in_range, "{ray:?} {a} {b} {c}");
                    if found.hit {
                        told[3] += u32::from(i == 0);
                        assert_eq!(
                            [found.t, found.u, found.v],
                            [right.t, right.u, right.v],
                            "{ray:?} {a} {b} {c}"
                        );
                    }
                }
            }
        }
        told
    }

    #[test]
    fn what_is_certain_is_what_integers_find() {
        let [sure, pairs, triples, hits] = compare(0x5EED, 200_000);
        assert!(
            sure > 30_000 && pairs > 100_000 && triples > 150_000 && hits > 80_000,
            "{sure} {pairs} {triples} {hits}"
        );
    }
}
