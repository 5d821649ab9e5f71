//! The second stage of the [exact test](super::exact) on a GPU that has doubles at much of the speed of floats, and of
//! eight rays side by side on a CPU. It asks what `filter.rs` asks, in a third of the instructions: one bound serves
//! all edges, conversions are few, and what it does not decide, one triangle of tens of thousands, is left to the next
//! stage at once.

use super::{
    filter::{Line, Place, Turned, Verdict},
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
    const VOLUME: bool = true;

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
    #[inline(always)]
    fn volume([[ax, ay, az], [bx, by, bz], [cx, cy, cz]]: [[Pair; 3]; 3]) -> (Self, f32) {
        let x = part([ax, by, cz, bz, cy]);
        let y = part([ay, bz, cx, bx, cz]);
        let z = part([az, bx, cy, by, cx]);
        let six = x.0.plus_about(y.0).plus_about(z.0);
        (six.short(), exp2(-94) * (x.1 + y.1 + z.1) + exp2(-100))
    }
}

/// `a * (b * c - d * e)`, and the size of its products.
#[inline(always)]
fn part([a, b, c, d, e]: [Pair; 5]) -> (Wide, f32) {
    let size = a.hi.abs() * ((b.hi * c.hi).abs() + (d.hi * e.hi).abs());
    let (bc, de) = (Wide::of(b).times(Wide::of(c)), Wide::of(d).times(Wide::of(e)));
    (bc.plus_about(de.negative()).times(Wide::of(a)), size)
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

/// The answer, given the best `t` so far, and whether at the same `t` the triangle comes after it.
///
/// With `e = 2^-53` and `M` the scene's size as seen from the origin, corners across the ray have coordinates `x`
/// within `3 e |x|` and `off`. That is `2^-100 M` where differences are exact and the direction has all its digits,
/// else at most `4 e M` and `2^-64 M`. So an edge function `x y' - y x'` is off by at most
/// `8 e (|x y'| + |y x'|) + off (|x| + |y| + |x'| + |y'| + 2 off)`.
#[inline(always)]
pub(in crate::trace) fn by_doubles<D: Double>(
    line: &Line<D::One>,
    corners: &[Turned<D::One>; 3],
    (from, own): Place<'_, D::One>,
    best: D::One,
    after: Mask<D>,
) -> Verdict<D::One> {
    let (all, every, float) = (D::all, D::One::every, D::One::all);
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
    let zero = float(0.0);
    if every(!told) {
        return Verdict { certain: missed, hit: told, t: zero, u: zero, v: zero };
    }

    let main = D::of(line.way.z);
    let along = (det * main).inverse();
    let inverse = along * main;
    // A weight and the sum, both off, the latter by a 40th at most: 40 / 39, and room for rounding.
    let part = all(1.25) * error * inverse.size();
    let deep = (az.size() + bz.size()) + cz.size();
    // `t` hangs on weights by how far the corners' depths are apart.
    let spread = (bz - az).size() + (cz - az).size();
    let t = ((u * az + v * bz) + w * cz) * along;
    let (near, later) = rounded(t, all(3.0) * part * spread + power::<D>(-49) * deep + off + power(-100));
    // Where origin and corners are in one plane across an axis.
    let from_line = &line.from;
    let on = level(a.x, b.x, c.x, from_line.x)
        | level(a.y, b.y, c.y, from_line.y)
        | level(a.z, b.z, c.z, from_line.z);
    let (mut near, mut later) = (D::One::choose(on, zero, near), D::One::choose(on, zero, later));
    let mut sure = near.is(later) & (on | far_from_0(near));
    if D::VOLUME && !every(sure | !told) {
        // The mean of depths has lost its digits near the triangle's plane.
        let (six, by) = D::volume([from.to(&own[0]), from.to(&own[1]), from.to(&own[2])]);
        let t = -(six * main) * inverse;
        let off =
            t.size() * (all(3.0) * part + power(-48)) + all(2.5) * D::of(by) * inverse.size() + power(-100);
        let closer = rounded(t, off);
        near = D::One::choose(sure, near, closer.0);
        later = D::One::choose(sure, later, closer.1);
        sure = near.is(later) & (on | far_from_0(near));
    }
    let behind = near.exceeds(best) | (near.is(later) & near.is(best) & after);
    let outside = behind | near.exceeds(line.t_max) | later.below(line.t_min);
    let (passed, hit) = (missed | (told & outside), told & !outside);
    if every(!hit) {
        return Verdict { certain: passed, hit, t: zero, u: zero, v: zero };
    }
    let (u, v) = (weight(v, inverse, part), weight(w, inverse, part));
    let certain = passed | (hit & passes & sure & u.0.is(u.1) & v.0.is(v.1));
    Verdict { certain, hit, t: near, u: u.0, v: v.0 }
}
