//! Signs and quotients by numbers of more digits than a float, with bounds of their errors: the second and third stage
//! of the [exact test](super::exact).

use super::{bounds::NEAR, triple::Triple};
use crate::{
    glam::Vec3,
    math::{Digits, Number, cycle, exp2, exponent, is_small, least, most},
    pair::{Long, PAIR_FLOOR, Pair},
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

impl Turned<f32> {
    /// From here to a point, exactly.
    #[inline(always)]
    pub(super) fn to(&self, p: &Self) -> [Pair; 3] {
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
    z: Pair,
    /// The larger of `x` and `y`, in size.
    size: f32,
    /// Whether `x` and `y` are floats, and what they are.
    known: bool,
}

impl<L: Long> Seen<L> {
    /// Stands for a corner that is still to come.
    #[inline(always)]
    fn none() -> Self {
        let none = Pair::float(0.0);
        Self { x: L::of(none), y: L::of(none), z: none, size: 0.0, known: true }
    }

    #[inline(always)]
    fn new(line: &Line<f32>, p: &Turned<f32>) -> Self {
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
    pub(super) positive: bool,
    pub(super) negative: bool,
    pub(super) certain: bool,
    /// What the value may be off by.
    error: f32,
}

impl<L: Long> Edge<L> {
    /// Stands for one that is still to come.
    #[inline(always)]
    fn none() -> Self {
        let value = L::of(Pair::float(0.0));
        Self { value, positive: true, negative: true, certain: true, error: 0.0 }
    }

    /// Of two corners of a scene of size `far`.
    #[inline(always)]
    fn new(a: &Seen<L>, b: &Seen<L>, far: f32) -> Self {
        let (ax, ay, bx, by) = (a.x.hi(), a.y.hi(), b.x.hi(), b.y.hi());
        let products = (ax * by).abs() + (ay * bx).abs();
        let sizes = (ax.abs() + ay.abs()) + (bx.abs() + by.abs());
        let dust = L::EDGE_FAR * far;
        let error = L::EDGE * products + dust * (sizes + dust) + exp2(-98);
        let value = a.x.times(b.y).plus(a.y.times(b.x).negative());
        // Of floats the signs are exact; with a corner on the ray the edge function is 0.
        let small = is_small(ax, PAIR_FLOOR)
            | is_small(ay, PAIR_FLOOR)
            | is_small(bx, PAIR_FLOOR)
            | is_small(by, PAIR_FLOOR);
        let on_ray = (a.known & (a.size == 0.0)) | (b.known & (b.size == 0.0));
        let exact = on_ray | (a.known & b.known & !small);
        let certain = exact | (value.hi().abs() > error);
        let value = L::choose(on_ray, L::of(Pair::float(0.0)), value);
        let hi = value.hi();
        Self { value, positive: certain & (hi > 0.0), negative: certain & (hi < 0.0), certain, error }
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
    pub(super) missed: bool,
    /// Edge functions from `c` to `b`, `a` to `c` and `b` to `a`, in the frame of the ray's main axis.
    pub(super) edges: (Edge<L>, Edge<L>, Edge<L>),
    /// Corners along the main axis.
    depths: [Pair; 3],
    /// If all corners are as far away along an axis, how far, by 0 or more than [`NEAR`], and the direction along it;
    /// else that is 0.
    level: (Pair, f32),
}

/// The second stage, and the third. With `M` the scene's size as seen from the origin, pairs have coordinates `x`
/// within `2^-48 |x| + 2^-64 M`, and an edge function `x y' - y x'` therefore, see [`Long::times`] and [`Long::plus`],
/// within `2^-44.2 (|x y'| + |y x'|) + 2^-64 M (|x| + |y| + |x'| + |y'| + 2^-63 M)`. Triples have
/// `2^-62 |x| + 2^-79 M`, and `2^-59` and `2^-77` in the latter; doubles have `2^-53 |x| + 2^-50 M`, and `2^-51` and
/// `2^-50`. Weights and `t` follow from that.
#[inline(always)]
pub(super) fn look<L: Long>(line: &Line<f32>, corners: &[Turned<f32>; 3]) -> Looked<L> {
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
    let aside = L::CORNER * size + L::CORNER_FAR * far;
    let (x, y) = ((a.x.hi(), b.x.hi(), c.x.hi()), (a.y.hi(), b.y.hi(), c.y.hi()));
    let below = (most(x.0, x.1, x.2) < -aside) | (most(y.0, y.1, y.2) < -aside);
    let above = (least(x.0, x.1, x.2) > aside) | (least(y.0, y.1, y.2) > aside);
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
fn is_level(a: f32, b: f32, c: f32, from: f32) -> bool {
    // Equal bits: a device may take a small difference for none.
    (a == b) & (b == c) & ((a.to_bits() == from.to_bits()) | ((a - from).abs() > NEAR))
}

/// [`Looked::level`].
#[inline(always)]
fn level_of(line: &Line<f32>, [a, b, c]: &[Turned<f32>; 3]) -> (Pair, f32) {
    let (from, way) = (&line.from, &line.way);
    let x = is_level(a.x, b.x, c.x, from.x);
    let y = is_level(a.y, b.y, c.y, from.y);
    let z = is_level(a.z, b.z, c.z, from.z);
    let of = |p: &Turned<f32>| f32::choose(z, p.z, f32::choose(x, p.x, f32::choose(y, p.y, 0.0)));
    let (at, from, way) = (of(a), of(from), of(way));
    (Pair::sum(at, -from), way)
}

/// Where the ray meets a triangle's plane.
pub(super) struct Met<L: Long> {
    /// Whether the numbers are large enough to tell.
    pub(super) told: bool,
    /// Between which numbers `t` lies when rounded.
    pub(super) near: f32,
    pub(super) later: f32,
    /// Whether `t` is 0.
    zero: bool,
    /// Weights of the second and third corner, their sum with the first's, and its reciprocal.
    weights: (L, L),
    det: L,
    inverse: f32,
    /// The power of two by which edge functions were multiplied for that.
    unit: f32,
    /// How far weights may be off, as parts of their sum: the second, the third, and what `t`, `u` and `v` are times.
    off: (f32, f32, f32),
}

impl<L: Long> Looked<L> {
    /// Finds `t`, and weights that add up to 1 to 2.
    #[inline(always)]
    pub(super) fn meet(&self, line: &Line<f32>) -> Met<L> {
        let (u, v, w) = (self.edges.0.value, self.edges.1.value, self.edges.2.value);
        let det = u.plus(v).plus(w);
        let (eu, ev, ew) = (self.edges.0.error, self.edges.1.error, self.edges.2.error);
        let error = eu + ev + ew;
        let size = det.hi().abs();
        let told = !size.below(exp2(-70)) & !size.below(32.0 * error);
        // Without all the digits that are needed nothing is told.
        let told = if L::WHOLE { told & line.whole } else { told };
        let det = L::choose(told, det, L::of(Pair::float(1.0)));
        let unit = det.hi().unit();
        let (det, u, v, w) = (det.by_power(unit), u.by_power(unit), v.by_power(unit), w.by_power(unit));
        let inverse = det.hi().inverse();
        // The quotient of a weight and the sum, both off, the latter by a 32nd at most: 32 / 31, and room for rounding.
        let part = 1.25 * (unit * inverse).abs();
        let off = (part * ev, part * ew, part * error);
        let [a, b, c] = self.depths;
        let depth = u.times(L::of(a)).plus(v.times(L::of(b))).plus(w.times(L::of(c)));
        let t = depth.over(det, inverse).over(L::of(Pair::float(line.way.z)), line.along);
        let deep = most(a.hi.abs(), b.hi.abs(), c.hi.abs());
        // `t` hangs on weights by how far the corners' depths are apart.
        let spread = most(a.hi, b.hi, c.hi) - least(a.hi, b.hi, c.hi) + exp2(-22) * deep;
        let (mut near, mut later) = t.rounded(off.2 * spread + L::DEPTH * deep);
        // A triangle across an axis is met where that says.
        let (distance, way) = self.level;
        if way != 0.0 {
            let unit = way.unit();
            let t = L::of(distance).over(L::of(Pair::float(way)), (way * unit).inverse() * unit);
            (near, later) = t.rounded(t.hi().abs() * L::WEIGHT);
        }
        let at = (way != 0.0) & (distance.hi == 0.0);
        let (near, later) = (f32::choose(at, 0.0, near), f32::choose(at, 0.0, later));
        Met { told, near, later, zero: at, weights: (v, w), det, inverse, unit, off }
    }
}

/// Six times the volume of a triangle and the ray's origin, and the size of its products. It is the `sum` of three
/// terms: `term` makes `a * (b * c - d * e)` of five numbers.
#[inline(always)]
pub(super) fn volume<T>(
    (from, [a, b, c]): Place<'_>,
    term: impl Fn([Pair; 5]) -> T,
    sum: impl Fn(T, T) -> T,
) -> (T, f32) {
    let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (from.to(a), from.to(b), from.to(c));
    let (x, y, z) = ([ax, by, cz, bz, cy], [ay, bz, cx, bx, cz], [az, bx, cy, by, cx]);
    let size = |[a, b, c, d, e]: [Pair; 5]| a.hi.abs() * ((b.hi * c.hi).abs() + (d.hi * e.hi).abs());
    (sum(sum(term(x), term(y)), term(z)), size(x) + size(y) + size(z))
}

impl<L: Long> Met<L> {
    /// Finds those `t` that are not sure by the volume of the triangle and the ray's origin. Where that lies all but in
    /// the triangle's plane, the mean of depths has lost its digits, and the volume has enough of them.
    #[inline(always)]
    fn near_plane(&mut self, line: &Line<f32>, place: Place<'_>) {
        let term = |[a, b, c, d, e]: [Pair; 5]| Triple::product_difference(b, c, d, e).times_pair(a);
        let (six, size) = volume(place, term, Triple::plus);
        let error = exp2(-56) * size + exp2(-90);
        let along = six.long::<L>().by_power(self.unit).times(L::of(Pair::float(-line.way.z)));
        let t = along.over(self.det, self.inverse);
        // The direction along the main axis is less than 2, and there is room for rounding.
        let off =
            t.hi().abs() * (self.off.2 + 4.0 * L::WEIGHT) + 2.5 * error * (self.unit * self.inverse).abs();
        let (near, later) = t.rounded(off);
        let sure = self.sure();
        self.near = f32::choose(sure, self.near, near);
        self.later = f32::choose(sure, self.later, later);
    }

    /// Whether `t` is surely what it is rounded to.
    #[inline(always)]
    pub(super) fn sure(&self) -> bool {
        (self.near == self.later) & ((self.near.abs() > exp2(-60)) | self.zero)
    }
}

/// Origin and corners in any cyclic order of axes. A GPU gets them in another one than the line's: else its compiler
/// keeps differences in registers that are needed seldom.
pub(super) type Place<'a> = (&'a Turned<f32>, &'a [Turned<f32>; 3]);

/// The answer by doubles, pairs or triples, given the best `t` so far, and whether at the same `t` the triangle comes
/// after it. A page loads every byte of each copy, so there compilers choose.
#[cfg_attr(not(target_arch = "wasm32"), inline(always))]
pub(in crate::trace) fn by<L: Long>(
    line: &Line<f32>,
    corners: &[Turned<f32>; 3],
    place: Place<'_>,
    best: f32,
    after: bool,
) -> Verdict {
    let looked = look::<L>(line, corners);
    if looked.missed {
        return Verdict { certain: true, hit: false, t: 0.0, u: 0.0, v: 0.0 };
    }
    let mut met = looked.meet(line);
    if !met.told {
        return Verdict { certain: false, hit: false, t: 0.0, u: 0.0, v: 0.0 };
    }
    if L::VOLUME && !met.sure() {
        met.near_plane(line, place);
    }
    // Rounding keeps order, so this is certain too, and where the plane is met does not hang on signs of
    // weights.
    let (near, later) = (met.near, met.later);
    let behind = (near > best) | ((near == later) & (near == best) & after);
    if behind | (near > line.t_max) | (later < line.t_min) {
        return Verdict { certain: true, hit: false, t: 0.0, u: 0.0, v: 0.0 };
    }
    let (weight_v, weight_w) = met.weights;
    let u = weight_v.over(met.det, met.inverse);
    let v = weight_w.over(met.det, met.inverse);
    let rounding = met.off.2 + L::WEIGHT;
    let (u_near, u_later) = u.rounded(met.off.0 + rounding * u.hi());
    let (v_near, v_later) = v.rounded(met.off.1 + rounding * v.hi());
    // An exact 0 has no digits to be uncertain of.
    let (u_zero, v_zero) = (weight_v.hi() == 0.0, weight_w.hi() == 0.0);
    let (u_edge, v_edge, w_edge) = looked.edges;
    let certain = (u_edge.certain & v_edge.certain & w_edge.certain)
        & met.sure()
        & ((u_near == u_later) | u_zero)
        & ((v_near == v_later) | v_zero);
    let (u, v) = (f32::choose(u_zero, 0.0, u_near), f32::choose(v_zero, 0.0, v_near));
    Verdict { certain, hit: true, t: near, u, v }
}
