//! The second stage of the [exact test](super::exact) on a GPU that has doubles at much of the speed of floats, and of
//! eight rays side by side on a CPU. It asks what `filter.rs` asks, in a third of the instructions: one bound serves
//! all edges, conversions are few, and what it does not decide, one triangle of tens of thousands, is left to the next
//! stage at once.

use super::{
    filter::{Line, Place, Turned, Verdict, volume},
    wide::{self, Wide},
};
use crate::{
    math::{Digits, Number, exp2},
    pair::{Double, Long as _, Pair},
};

/// Answers of doubles.
type Mask<D> = <<D as Double>::One as Number>::Mask;

impl Double for f64 {
    type One = f32;

    #[inline(always)]
    fn of(x: f32) -> Self {
        Self::from(x)
    }
    #[inline(always)]
    fn all(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn float(self) -> f32 {
        self as f32
    }
    #[inline(always)]
    fn size(self) -> Self {
        if self < 0.0 { -self } else { self }
    }
    #[inline(always)]
    fn exceeds(self, other: Self) -> bool {
        self > other
    }
    #[inline(always)]
    fn product_difference(a: Self, b: Self, c: Self, d: Self) -> Self {
        wide::product_difference(a, b, c, d)
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        let near = self as f32;
        let unit = near.unit();
        let r = Self::from((near * unit).inverse() * unit);
        let r = r + r * (1.0 - r * self);
        r + r * (1.0 - r * self)
    }
}

/// A power of two.
#[inline(always)]
fn power<D: Double>(e: i32) -> D {
    D::all(exp2(e) as f64)
}

/// A corner seen along the ray, times the direction's main component, and its depth.
#[inline(always)]
fn seen<D: Double>(line: &Line<D::One>, p: &Turned<D::One>) -> (D, D, D) {
    let (from, way) = (&line.from, &line.way);
    let (x, y, z) = (D::of(p.x) - D::of(from.x), D::of(p.y) - D::of(from.y), D::of(p.z) - D::of(from.z));
    let main = D::of(way.z);
    (D::product_difference(x, main, z, D::of(way.x)), D::product_difference(y, main, z, D::of(way.y)), z)
}

/// Whether all coordinates are 0 or at least so large.
#[inline(always)]
fn fits<N: Digits>(p: &Turned<N>, least: N) -> N::Mask {
    let zero = N::all(0.0);
    (p.x.is(zero) | p.x.abs().exceeds(least))
        & (p.y.is(zero) | p.y.abs().exceeds(least))
        & (p.z.is(zero) | p.z.abs().exceeds(least))
}

/// The difference of two products, and the sum of their sizes.
#[inline(always)]
fn edge<D: Double>(p: D, q: D) -> (D, D) {
    (p - q, p.size() + q.size())
}

/// Between which floats a number lies when rounded, if it may be off by `error`, of which half is for rounding here.
#[inline(always)]
fn rounded<D: Double>(x: D, error: D) -> (D::One, D::One) {
    ((x - error).float(), (x + error).float())
}

/// The same of a weight, by the reciprocal of the weights' sum; `part` of that is what both are off by.
#[inline(always)]
fn weight<D: Double>(of: D, inverse: D, part: D) -> (D::One, D::One) {
    let x = of * inverse;
    rounded(x, part * (D::all(1.0) + D::all(3.0) * x.size()) + power::<D>(-48) * x.size() + power(-100))
}

/// Whether three corners are as far along an axis as the origin.
#[inline(always)]
fn level<N: Digits>(a: N, b: N, c: N, from: N) -> N::Mask {
    a.is(from) & b.is(from) & c.is(from)
}

/// Whether `t` is so far from 0 that it is rounded by its digits.
#[inline(always)]
fn far_from_0<N: Digits>(t: N) -> N::Mask {
    t.abs().exceeds(N::all(exp2(-60)))
}

/// What is told of a triangle's border.
struct Looked<D: Double> {
    /// Whether the ray surely passes it by.
    missed: Mask<D>,
    /// Whether it surely passes through.
    passes: Mask<D>,
    /// Whether the numbers are large enough to tell where, and it is not missed.
    told: Mask<D>,
    /// Edge functions, their sum, and what each may be off by.
    edges: (D, D, D),
    det: D,
    error: D,
    /// Depths of the corners, and what those may be off by.
    depths: (D, D, D),
    off: D,
}

/// With `e = 2^-53` and `M` the scene's size as seen from the origin, corners across the ray have coordinates `x`
/// within `3 e |x|` and `off`. That is `2^-100 M` where differences are exact and the direction has all its digits,
/// else at most `4 e M` and `2^-64 M`. So an edge function `x y' - y x'` is off by at most
/// `8 e (|x y'| + |y x'|) + off (|x| + |y| + |x'| + |y'| + 2 off)`.
#[inline(always)]
fn look<D: Double>(line: &Line<D::One>, corners: &[Turned<D::One>; 3]) -> Looked<D> {
    let (all, float) = (D::all, D::One::all);
    let [a, b, c] = corners;
    let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) =
        (seen::<D>(line, a), seen::<D>(line, b), seen::<D>(line, c));
    // Then differences are multiples of `2^-50 M`, and no larger than `M`.
    let least = line.far * float(exp2(-26));
    let whole = line.whole & fits(&line.from, least) & fits(a, least) & fits(b, least) & fits(c, least);
    let off = D::of(line.far * D::One::choose(whole, float(exp2(-100)), float(exp2(-50))));

    let (u, of_u) = edge(cx * by, cy * bx);
    let (v, of_v) = edge(ax * cy, ay * cx);
    let (w, of_w) = edge(bx * ay, by * ax);
    let sizes = ((ax.size() + ay.size()) + (bx.size() + by.size())) + (cx.size() + cy.size());
    // Larger than what has too few digits, so that `det` is, too.
    let error = power::<D>(-49) * ((of_u + of_v) + of_w) + off * (sizes + all(2.0) * off) + power(-77);
    let positive = (u.exceeds(error), v.exceeds(error), w.exceeds(error));
    let minus = -error;
    let negative = (minus.exceeds(u), minus.exceeds(v), minus.exceeds(w));
    let missed = (positive.0 | positive.1 | positive.2) & (negative.0 | negative.1 | negative.2);
    let passes = (positive.0 & positive.1 & positive.2) | (negative.0 & negative.1 & negative.2);
    let det = (u + v) + w;
    let told = det.size().exceeds(all(128.0) * error) & !missed;
    Looked { missed, passes, told, edges: (u, v, w), det, error, depths: (az, bz, cz), off }
}

/// Where the ray meets a triangle's plane.
struct Met<D: Double> {
    /// Between which numbers `t` lies when rounded.
    near: D::One,
    later: D::One,
    /// Whether `t` is surely what it is rounded to.
    sure: Mask<D>,
    /// The reciprocal of the weights' sum, and of that what a weight and the sum may be off by.
    inverse: D,
    part: D,
}

impl<D: Double> Looked<D> {
    #[inline(always)]
    fn meet(&self, line: &Line<D::One>, [a, b, c]: &[Turned<D::One>; 3]) -> Met<D> {
        let (all, zero) = (D::all, D::One::all(0.0));
        let ((u, v, w), (az, bz, cz)) = (self.edges, self.depths);
        let main = D::of(line.way.z);
        let along = (self.det * main).inverse();
        let inverse = along * main;
        // A weight and the sum, both off, the latter by a 40th at most: 40 / 39, and room for rounding.
        let part = all(1.25) * self.error * inverse.size();
        let deep = (az.size() + bz.size()) + cz.size();
        // `t` hangs on weights by how far the corners' depths are apart.
        let spread = (bz - az).size() + (cz - az).size();
        let t = ((u * az + v * bz) + w * cz) * along;
        let error = all(3.0) * part * spread + power::<D>(-49) * deep + self.off + power(-100);
        let (near, later) = rounded(t, error);
        // Where origin and corners are in one plane across an axis.
        let from = &line.from;
        let on = level(a.x, b.x, c.x, from.x) | level(a.y, b.y, c.y, from.y) | level(a.z, b.z, c.z, from.z);
        let (near, later) = (D::One::choose(on, zero, near), D::One::choose(on, zero, later));
        Met { near, later, sure: near.is(later) & (on | far_from_0(near)), inverse, part }
    }

    /// The answer, given the best `t` so far, and whether at the same `t` the triangle comes after it.
    #[inline(always)]
    fn answer(&self, line: &Line<D::One>, met: &Met<D>, best: D::One, after: Mask<D>) -> Verdict<D::One> {
        let zero = D::One::all(0.0);
        let Met { near, later, sure, inverse, part } = *met;
        let behind = near.exceeds(best) | (near.is(later) & near.is(best) & after);
        let outside = behind | near.exceeds(line.t_max) | later.below(line.t_min);
        let (passed, hit) = (self.missed | (self.told & outside), self.told & !outside);
        if D::One::every(!hit) {
            return Verdict { certain: passed, hit, t: zero, u: zero, v: zero };
        }
        let (u, v) = (weight(self.edges.1, inverse, part), weight(self.edges.2, inverse, part));
        let certain = passed | (hit & self.passes & sure & u.0.is(u.1) & v.0.is(v.1));
        Verdict { certain, hit, t: near, u: u.0, v: v.0 }
    }

    /// If nothing is told of any ray but that it misses.
    #[inline(always)]
    fn nothing(&self) -> Verdict<D::One> {
        let zero = D::One::all(0.0);
        Verdict { certain: self.missed, hit: self.told, t: zero, u: zero, v: zero }
    }
}

impl Met<f64> {
    /// Finds a `t` that is not sure by the volume of the triangle and the ray's origin: near the triangle's plane the
    /// mean of depths has lost its digits.
    #[inline(always)]
    fn near_plane(&mut self, line: &Line<f32>, place: Place<'_>) {
        let term = |[a, b, c, d, e]: [Pair; 5]| Wide::product_difference(b, c, d, e).times(Wide::of(a));
        let (six, size) = volume(place, term, Wide::plus_about);
        let by = exp2(-94) * size + exp2(-100);
        let t = -(six.short() * f64::from(line.way.z)) * self.inverse;
        let off = t.size() * (3.0 * self.part + power::<f64>(-48))
            + 2.5 * f64::from(by) * self.inverse.size()
            + power::<f64>(-100);
        (self.near, self.later) = rounded(t, off);
        self.sure = (self.near == self.later) & far_from_0(self.near);
    }
}

/// The answer for one ray, given the best `t` so far, and whether at the same `t` the triangle comes after it.
#[inline(always)]
pub(super) fn by_doubles(
    line: &Line<f32>,
    corners: &[Turned<f32>; 3],
    place: Place<'_>,
    best: f32,
    after: bool,
) -> Verdict {
    let looked = look::<f64>(line, corners);
    if !looked.told {
        return looked.nothing();
    }
    let mut met = looked.meet(line, corners);
    if !met.sure {
        met.near_plane(line, place);
    }
    looked.answer(line, &met, best, after)
}

/// The same for rays side by side, without a best hit. Of a `t` next to 0 nothing is certain.
#[inline(always)]
pub(in crate::trace) fn side_by_side<D: Double>(
    line: &Line<D::One>,
    corners: &[Turned<D::One>; 3],
) -> Verdict<D::One> {
    let looked = look::<D>(line, corners);
    if D::One::every(!looked.told) {
        return looked.nothing();
    }
    let none = D::One::all(f32::INFINITY);
    looked.answer(line, &looked.meet(line, corners), none, none.below(none))
}
