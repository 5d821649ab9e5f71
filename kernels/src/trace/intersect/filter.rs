//! Signs and quotients by numbers of more digits than a float, with bounds of their errors: the second and third stage
//! of the [exact test](super::exact), for one ray or several side by side.

use super::{bounds::NEAR, triple::Triple};
use crate::{
    glam::Vec3,
    math::{Digits, Number, cycle, exp2, exponent, least, most},
    pair::{Long, Mask, One, PAIR_FLOOR, Pair},
    trace::frame::{Frame, HEADING},
};

/// The numbers of the second stage: a GPU computes with floats.
#[cfg(target_arch = "spirv")]
pub(super) type First = Pair;
/// The numbers of the second stage.
#[cfg(not(target_arch = "spirv"))]
pub(super) type First = f64;

/// A point, or a direction, with a ray's main axis last.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct Turned<N> {
    pub x: N,
    pub y: N,
    pub z: N,
}

/// A ray for this.
pub(in crate::trace) struct Line<N: Digits> {
    pub from: Turned<N>,
    /// Its direction, the main component of size 1 to 2; those smaller than `2^-64` may be left out.
    pub way: Turned<N>,
    /// Whether none is.
    pub whole: N::Mask,
    /// The main component's reciprocal, within `2^-22`.
    pub along: N,
    /// The scene's size as seen from the origin.
    pub far: N,
    pub t_min: N,
    pub t_max: N,
}

impl Line<f32> {
    #[inline(always)]
    pub(super) fn of(ray: &Frame) -> Self {
        let long = cycle(ray.heading, ray.main);
        // What is left out here is below the bounds.
        let shorter = |x: f32| {
            let bits = x.to_bits().wrapping_sub((HEADING as u32) << 23);
            if exponent(x) < HEADING - 64 { 0.0 } else { f32::from_bits(bits) }
        };
        let way = Turned { x: shorter(long.x), y: shorter(long.y), z: shorter(long.z) };
        Self {
            from: turned(ray.origin, ray.main),
            way,
            whole: ((way.x != 0.0) | (long.x == 0.0)) & ((way.y != 0.0) | (long.y == 0.0)),
            along: way.z.inverse(),
            far: ray.pad * exp2(19),
            t_min: ray.t_min,
            t_max: ray.t_max,
        }
    }
}

impl<N: Digits> Turned<N> {
    /// From here to a point, exactly.
    #[inline(always)]
    pub(super) fn to(&self, p: &Self) -> [Pair<N>; 3] {
        [Pair::sum(p.x, -self.x), Pair::sum(p.y, -self.y), Pair::sum(p.z, -self.z)]
    }
}

#[inline(always)]
pub(super) fn turned(p: Vec3, main: u32) -> Turned<f32> {
    let p = cycle(p, main);
    Turned { x: p.x, y: p.y, z: p.z }
}

/// A triangle for a ray's main axis.
#[inline(always)]
pub(super) fn all_turned((a, b, c): (Vec3, Vec3, Vec3), main: u32) -> [Turned<f32>; 3] {
    [turned(a, main), turned(b, main), turned(c, main)]
}

/// A corner seen along the ray, times the direction's main component.
#[derive(Clone, Copy)]
struct Seen<L: Long> {
    x: L,
    y: L,
    /// Along the ray's main axis, exactly.
    z: Pair<One<L>>,
    /// The larger of `x` and `y`, in size.
    size: One<L>,
    /// Whether `x` and `y` are floats, and what they are.
    known: Mask<L>,
}

impl<L: Long> Seen<L> {
    /// Stands for a corner that is still to come.
    #[inline(always)]
    fn none() -> Self {
        let zero = One::<L>::all(0.0);
        let none = Pair::float(zero);
        Self { x: L::of(none), y: L::of(none), z: none, size: zero, known: zero.is(zero) }
    }

    #[inline(always)]
    fn new(line: &Line<One<L>>, p: &Turned<One<L>>) -> Self {
        let [x, y, z] = line.from.to(p);
        let (x, one) = L::across(x, z, line.way.z, line.way.x);
        let (y, two) = L::across(y, z, line.way.z, line.way.y);
        Self { x, y, z, size: x.hi().abs().high(y.hi().abs()), known: one & two & line.whole }
    }
}

/// An edge function: how far apart its corners' directions are, whether its sign is certain, and which it is.
#[derive(Clone, Copy)]
pub(super) struct Edge<L: Long = First> {
    value: L,
    pub(super) positive: Mask<L>,
    pub(super) negative: Mask<L>,
    pub(super) certain: Mask<L>,
    /// What the value may be off by.
    error: One<L>,
}

impl<L: Long> Edge<L> {
    /// Stands for one that is still to come.
    #[inline(always)]
    fn none() -> Self {
        let zero = One::<L>::all(0.0);
        let yes = zero.is(zero);
        Self { value: L::of(Pair::float(zero)), positive: yes, negative: yes, certain: yes, error: zero }
    }

    /// Of two corners of a scene of size `far`.
    #[inline(always)]
    fn new(a: &Seen<L>, b: &Seen<L>, far: One<L>) -> Self {
        let all = One::<L>::all;
        let zero = all(0.0);
        let (ax, ay, bx, by) = (a.x.hi(), a.y.hi(), b.x.hi(), b.y.hi());
        let products = (ax * by).abs() + (ay * bx).abs();
        let sizes = (ax.abs() + ay.abs()) + (bx.abs() + by.abs());
        let dust = all(L::EDGE_FAR) * far;
        let error = all(L::EDGE) * products + dust * (sizes + dust) + all(exp2(-98));
        let value = a.x.times(b.y).plus(a.y.times(b.x).negative());
        // Of floats the signs are exact; with a corner on the ray the edge function is 0.
        let small = ax.is_small(PAIR_FLOOR)
            | ay.is_small(PAIR_FLOOR)
            | bx.is_small(PAIR_FLOOR)
            | by.is_small(PAIR_FLOOR);
        let on_ray = (a.known & a.size.is(zero)) | (b.known & b.size.is(zero));
        let exact = on_ray | (a.known & b.known & !small);
        let certain = exact | value.hi().abs().exceeds(error);
        let value = L::choose(on_ray, L::of(Pair::float(zero)), value);
        let hi = value.hi();
        Self {
            value,
            positive: certain & hi.exceeds(zero),
            negative: certain & hi.below(zero),
            certain,
            error,
        }
    }
}

/// What numbers with bounds of their errors tell.
pub(in crate::trace) struct Verdict<N: Digits = f32> {
    /// Whether that is all there is to know.
    pub certain: N::Mask,
    /// Whether the triangle is hit, and not after the best hit so far.
    pub hit: N::Mask,
    pub t: N,
    pub u: N,
    pub v: N,
}

/// What is told of a triangle's border.
pub(super) struct Looked<L: Long> {
    /// Whether the ray surely passes it by.
    pub(super) missed: Mask<L>,
    /// Edge functions from `c` to `b`, `a` to `c` and `b` to `a`, in the frame of the ray's main axis.
    pub(super) edges: (Edge<L>, Edge<L>, Edge<L>),
    /// Corners along the main axis.
    depths: [Pair<One<L>>; 3],
    /// If all corners are as far away along an axis, how far, by 0 or more than [`NEAR`], and the direction along it;
    /// else that is 0.
    level: (Pair<One<L>>, One<L>),
}

/// The second stage, and the third. With `M` the scene's size as seen from the origin, pairs have coordinates `x`
/// within `2^-48 |x| + 2^-64 M`, and an edge function `x y' - y x'` therefore, see [`Long::times`] and [`Long::plus`],
/// within `2^-44.2 (|x y'| + |y x'|) + 2^-64 M (|x| + |y| + |x'| + |y'| + 2^-63 M)`. Triples have
/// `2^-62 |x| + 2^-79 M`, and `2^-59` and `2^-77` in the latter; doubles have `2^-53 |x| + 2^-50 M`, and `2^-51` and
/// `2^-50`. Weights and `t` follow from that.
#[inline(always)]
pub(super) fn look<L: Long>(line: &Line<One<L>>, corners: &[Turned<One<L>>; 3]) -> Looked<L> {
    let all = One::<L>::all;
    let [a, b, c] = corners;
    let level = level_of(line, corners);
    let far = line.far;
    // Loops, so that a GPU has less code: a warp that needs triples waits until it is fetched.
    let (mut seen, mut corners) = ((Seen::<L>::none(), Seen::none(), Seen::none()), (*a, *b, *c));
    let mut i = 0;
    while i < 3 {
        seen = (seen.1, seen.2, Seen::new(line, &corners.0));
        corners = (corners.1, corners.2, corners.0);
        i += 1;
    }
    let (a, b, c) = seen;
    let size = most(a.size, b.size, c.size);
    // All corners on one side: most triangles that the ray passes by.
    let aside = all(L::CORNER) * size + all(L::CORNER_FAR) * far;
    let (x, y) = ((a.x.hi(), b.x.hi(), c.x.hi()), (a.y.hi(), b.y.hi(), c.y.hi()));
    let below = most(x.0, x.1, x.2).below(-aside) | most(y.0, y.1, y.2).below(-aside);
    let above = least(x.0, x.1, x.2).exceeds(aside) | least(y.0, y.1, y.2).exceeds(aside);
    let mut edges = (Edge::none(), Edge::none(), Edge::none());
    let mut i = 0;
    while i < 3 {
        edges = (edges.1, edges.2, Edge::new(&seen.2, &seen.1, far));
        seen = (seen.1, seen.2, seen.0);
        i += 1;
    }
    let (u, v, w) = edges;
    let negative = u.negative | v.negative | w.negative;
    let positive = u.positive | v.positive | w.positive;
    let sure = u.certain & v.certain & w.certain;
    // On both sides, or in the triangle's plane.
    let missed = below | above | (negative & positive) | (sure & !(negative | positive));
    let missed = if L::WHOLE { missed & line.whole } else { missed };
    Looked { missed, edges: (u, v, w), depths: [a.z, b.z, c.z], level }
}

/// Whether corners are all as far away along an axis, by 0 or more than [`NEAR`].
#[inline(always)]
fn is_level<N: Digits>(a: N, b: N, c: N, from: N) -> N::Mask {
    // Equal bits: a device may take a small difference for none.
    a.is(b) & b.is(c) & (a.same(from) | (a - from).abs().exceeds(N::all(NEAR)))
}

/// [`Looked::level`].
#[inline(always)]
fn level_of<N: Digits>(line: &Line<N>, [a, b, c]: &[Turned<N>; 3]) -> (Pair<N>, N) {
    let (from, way, zero) = (&line.from, &line.way, N::all(0.0));
    let x = is_level(a.x, b.x, c.x, from.x);
    let y = is_level(a.y, b.y, c.y, from.y);
    let z = is_level(a.z, b.z, c.z, from.z);
    let at = N::choose(z, a.z, N::choose(x, a.x, N::choose(y, a.y, zero)));
    let from = N::choose(z, from.z, N::choose(x, from.x, N::choose(y, from.y, zero)));
    let way = N::choose(z, way.z, N::choose(x, way.x, N::choose(y, way.y, zero)));
    (Pair::sum(at, -from), way)
}

/// Where the ray meets a triangle's plane.
pub(super) struct Met<L: Long> {
    /// Whether the numbers are large enough to tell.
    pub(super) told: Mask<L>,
    /// Between which numbers `t` lies when rounded.
    pub(super) near: One<L>,
    pub(super) later: One<L>,
    /// Whether `t` is 0.
    zero: Mask<L>,
    /// Weights of the second and third corner, their sum with the first's, and its reciprocal.
    weights: (L, L),
    det: L,
    inverse: One<L>,
    /// The power of two by which edge functions were multiplied for that.
    unit: One<L>,
    /// How far weights may be off, as parts of their sum: the second, the third, and what `t`, `u` and `v` are times.
    off: (One<L>, One<L>, One<L>),
}

impl<L: Long> Looked<L> {
    /// Finds `t`, and weights that add up to 1 to 2.
    #[inline(always)]
    pub(super) fn meet(&self, line: &Line<One<L>>) -> Met<L> {
        let all = One::<L>::all;
        let (zero, one) = (all(0.0), all(1.0));
        let (u, v, w) = (self.edges.0.value, self.edges.1.value, self.edges.2.value);
        let det = u.plus(v).plus(w);
        let (eu, ev, ew) = (self.edges.0.error, self.edges.1.error, self.edges.2.error);
        let error = eu + ev + ew;
        let size = det.hi().abs();
        let told = !size.below(all(exp2(-70))) & !size.below(all(32.0) * error);
        // Without all the digits that are needed nothing is told.
        let told = if L::WHOLE { told & line.whole } else { told };
        let det = L::choose(told, det, L::of(Pair::float(one)));
        let unit = det.hi().unit();
        let (det, u, v, w) = (det.by_power(unit), u.by_power(unit), v.by_power(unit), w.by_power(unit));
        let inverse = det.hi().inverse();
        // The quotient of a weight and the sum, both off, the latter by a 32nd at most: 32 / 31, and room for rounding.
        let part = all(1.25) * (unit * inverse).abs();
        let off = (part * ev, part * ew, part * error);
        let [a, b, c] = self.depths;
        let depth = u.times(L::of(a)).plus(v.times(L::of(b))).plus(w.times(L::of(c)));
        let t = depth.over(det, inverse).over(L::of(Pair::float(line.way.z)), line.along);
        let deep = most(a.hi.abs(), b.hi.abs(), c.hi.abs());
        // `t` hangs on weights by how far the corners' depths are apart.
        let spread = most(a.hi, b.hi, c.hi) - least(a.hi, b.hi, c.hi) + all(exp2(-22)) * deep;
        let (mut near, mut later) = t.rounded(off.2 * spread + all(L::DEPTH) * deep);
        // A triangle across an axis is met where that says.
        let (distance, way) = self.level;
        let none = way.is(zero);
        if !One::<L>::every(none) {
            let unit = way.unit();
            let t = L::of(distance).over(L::of(Pair::float(way)), (way * unit).inverse() * unit);
            let (one, two) = t.rounded(t.hi().abs() * all(L::WEIGHT));
            near = One::<L>::choose(none, near, one);
            later = One::<L>::choose(none, later, two);
        }
        let at = !none & distance.hi.is(zero);
        let (near, later) = (One::<L>::choose(at, zero, near), One::<L>::choose(at, zero, later));
        Met { told, near, later, zero: at, weights: (v, w), det, inverse, unit, off }
    }
}

/// `a * (b * c - d * e)`, and the size of its products.
#[inline(always)]
fn part<N: Digits>(a: Pair<N>, b: Pair<N>, c: Pair<N>, d: Pair<N>, e: Pair<N>) -> (Triple<N>, N) {
    let size = a.hi.abs() * ((b.hi * c.hi).abs() + (d.hi * e.hi).abs());
    (Triple::product_difference(b, c, d, e).times_pair(a), size)
}

/// Six times the volume of a triangle and the ray's origin, and what it may be off by.
#[inline(always)]
fn volume<N: Digits>(from: &Turned<N>, [a, b, c]: &[Turned<N>; 3]) -> (Triple<N>, N) {
    let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (from.to(a), from.to(b), from.to(c));
    let (x, y, z) = (part(ax, by, cz, bz, cy), part(ay, bz, cx, bx, cz), part(az, bx, cy, by, cx));
    (x.0.plus(y.0).plus(z.0), N::all(exp2(-56)) * (x.1 + y.1 + z.1) + N::all(exp2(-90)))
}

impl<L: Long> Met<L> {
    /// Finds those `t` that are not sure by the volume of the triangle and the ray's origin. Where that lies all but in
    /// the triangle's plane, the mean of depths has lost its digits, and the volume has enough of them.
    #[inline(always)]
    fn near_plane(&mut self, line: &Line<One<L>>, (from, corners): Place<'_, One<L>>) {
        let all = One::<L>::all;
        let (six, error) = volume(from, corners);
        let along = six.long::<L>().by_power(self.unit).times(L::of(Pair::float(-line.way.z)));
        let t = along.over(self.det, self.inverse);
        // The direction along the main axis is less than 2, and there is room for rounding.
        let off = t.hi().abs() * (self.off.2 + all(4.0 * L::WEIGHT))
            + all(2.5) * error * (self.unit * self.inverse).abs();
        let (near, later) = t.rounded(off);
        let sure = self.sure();
        self.near = One::<L>::choose(sure, self.near, near);
        self.later = One::<L>::choose(sure, self.later, later);
    }

    /// Whether `t` is surely what it is rounded to.
    #[inline(always)]
    pub(super) fn sure(&self) -> Mask<L> {
        self.near.is(self.later) & (self.near.abs().exceeds(One::<L>::all(exp2(-60))) | self.zero)
    }
}

/// Origin and corners in any cyclic order of axes. A GPU gets them in another one than the line's: else its compiler
/// keeps differences in registers that are needed seldom.
pub(in crate::trace) type Place<'a, N> = (&'a Turned<N>, &'a [Turned<N>; 3]);

/// The answer by doubles, pairs or triples, given the best `t` so far, and whether at the same `t` the triangle comes
/// after it. A page loads every byte of each copy, so there compilers choose.
#[cfg_attr(not(target_arch = "wasm32"), inline(always))]
pub(in crate::trace) fn by<L: Long>(
    line: &Line<One<L>>,
    corners: &[Turned<One<L>>; 3],
    place: Place<'_, One<L>>,
    best: One<L>,
    after: Mask<L>,
) -> Verdict<One<L>> {
    let (all, every) = (One::<L>::all, One::<L>::every);
    let zero = all(0.0);
    let looked = look::<L>(line, corners);
    let missed = looked.missed;
    if every(missed) {
        return Verdict { certain: missed, hit: !missed, t: zero, u: zero, v: zero };
    }
    let mut met = looked.meet(line);
    let told = met.told & !missed;
    if every(!told) {
        return Verdict { certain: missed, hit: told, t: zero, u: zero, v: zero };
    }
    if L::VOLUME && !every(met.sure() | !told) {
        met.near_plane(line, place);
    }
    // Rounding keeps order, so this is certain too, and where the plane is met does not hang on signs of
    // weights.
    let (near, later) = (met.near, met.later);
    let behind = near.exceeds(best) | (near.is(later) & near.is(best) & after);
    let outside = behind | near.exceeds(line.t_max) | later.below(line.t_min);
    let passed = missed | (told & outside);
    let hit = told & !outside;
    if every(!hit) {
        return Verdict { certain: passed, hit, t: zero, u: zero, v: zero };
    }
    let (weight_v, weight_w) = met.weights;
    let u = weight_v.over(met.det, met.inverse);
    let v = weight_w.over(met.det, met.inverse);
    let rounding = met.off.2 + all(L::WEIGHT);
    let (u_near, u_later) = u.rounded(met.off.0 + rounding * u.hi());
    let (v_near, v_later) = v.rounded(met.off.1 + rounding * v.hi());
    // An exact 0 has no digits to be uncertain of.
    let (u_zero, v_zero) = (weight_v.hi().is(zero), weight_w.hi().is(zero));
    let (u_edge, v_edge, w_edge) = looked.edges;
    let sure = (u_edge.certain & v_edge.certain & w_edge.certain)
        & met.sure()
        & (u_near.is(u_later) | u_zero)
        & (v_near.is(v_later) | v_zero);
    Verdict {
        certain: passed | (hit & sure),
        hit,
        t: near,
        u: One::<L>::choose(u_zero, zero, u_near),
        v: One::<L>::choose(v_zero, zero, v_near),
    }
}
