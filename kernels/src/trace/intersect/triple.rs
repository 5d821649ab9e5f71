//! Numbers as sums of three floats, about 70 digits (after Fabiano, Muller & Picot 2019, "Algorithms for triple-word
//! arithmetic", with simpler sums).

use super::pair::{Across, Long, Pair};
use crate::math::{Digits, exp2};

/// `a + b + c`, each far smaller than the one before.
#[derive(Clone, Copy, Debug)]
pub struct Triple<N = f32> {
    a: N,
    b: N,
    c: N,
}

/// `a + b + c` with its digits in order, exactly.
#[inline(always)]
fn sorted<N: Digits>(a: N, b: N, c: N) -> Triple<N> {
    let low = Pair::sum(b, c);
    let top = Pair::sum(a, low.hi);
    let low = Pair::sum(top.lo, low.lo);
    // What cancelled on top has left a gap.
    let top = Pair::sum(top.hi, low.hi);
    let low = Pair::sum(top.lo, low.lo);
    Triple { a: top.hi, b: low.hi, c: low.lo }
}

/// `a + b`, and what rounding took.
#[inline(always)]
fn two<N: Digits>(a: N, b: N) -> (N, N) {
    let sum = Pair::sum(a, b);
    (sum.hi, sum.lo)
}

/// The same sum with the larger part in front: each term takes what it can of the one behind it, exactly. Written out,
/// since llvmpipe counts the rounds of loops.
#[inline(always)]
fn settle7<N: Digits>([b, c, d, e, f, g, h]: [N; 7]) -> [N; 7] {
    let (g, h) = two(g, h);
    let (f, g) = two(f, g);
    let (e, f) = two(e, f);
    let (d, e) = two(d, e);
    let (c, d) = two(c, d);
    let (b, c) = two(b, c);
    [b, c, d, e, f, g, h]
}

/// The same of eight.
#[inline(always)]
fn settle8<N: Digits>([a, b, c, d, e, f, g, h]: [N; 8]) -> [N; 8] {
    let [b, c, d, e, f, g, h] = settle7([b, c, d, e, f, g, h]);
    let (a, b) = two(a, b);
    [a, b, c, d, e, f, g, h]
}

impl<N: Digits> Triple<N> {
    /// Less the product of another and a float, within `2^-67` of the larger of both.
    #[inline(always)]
    fn less(self, other: Self, by: N) -> Self {
        self.plus(other.times(Self::of(Pair::float(-by))))
    }
}

impl<N: Digits> Long for Triple<N> {
    type One = N;
    const CORNER: f32 = exp2(-60);
    const CORNER_FAR: f32 = exp2(-77);
    const EDGE: f32 = exp2(-59);
    const EDGE_FAR: f32 = exp2(-77);
    const DEPTH: f32 = exp2(-58);
    const WEIGHT: f32 = exp2(-60);
    const WHOLE: bool = true;
    const FIRST: bool = false;

    #[inline(always)]
    fn of(pair: Pair<N>) -> Self {
        Self { a: pair.hi, b: pair.lo, c: N::all(0.0) }
    }

    #[inline(always)]
    fn pair(self) -> Pair<N> {
        Pair { hi: self.a, lo: self.b + self.c }
    }

    #[inline(always)]
    fn hi(self) -> N {
        self.a
    }

    #[inline(always)]
    fn negative(self) -> Self {
        Self { a: -self.a, b: -self.b, c: -self.c }
    }

    #[inline(always)]
    fn by_power(self, power: N) -> Self {
        Self { a: self.a * power, b: self.b * power, c: self.c * power }
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        let (s, t) = (Pair::sum(self.a, other.a), Pair::sum(self.b, other.b));
        let middle = Pair::sum(t.hi, s.lo);
        sorted(s.hi, middle.hi, (self.c + other.c) + (t.lo + middle.lo))
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        let p = Pair::product(self.a, other.a);
        let (q, r) = (Pair::product(self.a, other.b), Pair::product(self.b, other.a));
        let both = Pair::sum(q.hi, r.hi);
        let middle = Pair::sum(p.lo, both.hi);
        let low = (self.a * other.c + self.c * other.a) + (self.b * other.b + (q.lo + r.lo));
        sorted(p.hi, middle.hi, low + (both.lo + middle.lo))
    }

    #[inline(always)]
    fn over(self, divisor: Self, reciprocal: N) -> Self {
        let first = self.a * reciprocal;
        let left = self.less(divisor, first);
        let second = left.a * reciprocal;
        let left = left.less(divisor, second);
        sorted(first, second, left.a * reciprocal)
    }

    /// Within `2^-62` of its size and `2^-79` of the largest product: passes over all terms leave the first float and,
    /// in the others, all that it lacks (Ogita, Rump & Oishi 2005, "Accurate sum and dot product", section 4).
    #[inline(always)]
    fn across(x: Pair<N>, z: Pair<N>, main: N, side: N) -> (Self, N::Mask) {
        let (Across { p, q, r, s }, known) = Across::new(x, z, main, side);
        let all = [p.hi, -q.hi, p.lo, -q.lo, r.hi, -s.hi, r.lo, -s.lo];
        let [first, b, c, d, e, f, g, h] = settle8(settle8(settle8(all)));
        let [second, c, d, e, f, g, h] = settle7(settle7([b, c, d, e, f, g, h]));
        (sorted(first, second, c + (d + (e + (f + (g + h))))), known)
    }

    #[inline(always)]
    fn choose(mask: N::Mask, a: Self, b: Self) -> Self {
        let each = |a, b| N::choose(mask, a, b);
        Self { a: each(a.a, b.a), b: each(a.b, b.b), c: each(a.c, b.c) }
    }
}
