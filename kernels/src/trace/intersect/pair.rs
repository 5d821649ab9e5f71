//! Numbers as sums of two floats, about 48 digits (Dekker 1971; Knuth 1969).

use crate::math::{exp2, two_product};

/// Numbers of more digits than a float. What bounds the errors that [`exact`](super::exact) makes stands with each
/// kind.
pub trait Long: Copy + Default {
    /// Twice what corners across the ray may be off by: a part of their size, and one of the scene's.
    const CORNER: f32;
    /// See [`Long::CORNER`].
    const CORNER_FAR: f32;
    /// What edge functions may be off by: a part of the sum of their products, and one of the corners' coordinates times
    /// the scene's size.
    const EDGE: f32;
    /// See [`Long::EDGE`].
    const EDGE_FAR: f32;
    /// What rounding adds to the error of `t`, a part of the largest depth.
    const DEPTH: f32;
    /// What rounding adds to the errors of `u` and `v`, a part of them.
    const WEIGHT: f32;
    /// Whether directions must have all their digits.
    const WHOLE: bool;
    /// Whether there are others to turn to where these do not tell.
    const FIRST: bool;

    /// The same number.
    fn of(pair: Pair) -> Self;
    /// Rounded to a pair, within `2^-24` of its lower part.
    fn pair(self) -> Pair;
    /// Rounded to a float, nearly: 0 only if the number is.
    fn hi(self) -> f32;
    /// With another sign.
    fn negative(self) -> Self;
    /// Times a power of two.
    fn by_power(self, power: f32) -> Self;
    /// The sum.
    fn plus(self, other: Self) -> Self;
    /// The product.
    fn times(self, other: Self) -> Self;
    /// The quotient, by the divisor's reciprocal to within some ULP.
    fn over(self, divisor: Self, reciprocal: f32) -> Self;
    /// `p - q + r - s`, where the first two are larger than the others and may cancel.
    fn across(p: Pair, q: Pair, r: Pair, s: Pair) -> Self;
}

/// `hi + lo`, `hi` being that rounded.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pair {
    /// The number, rounded.
    pub hi: f32,
    /// What rounding took.
    pub lo: f32,
}

impl Pair {
    /// `a + b`, exactly.
    #[inline(always)]
    pub fn sum(a: f32, b: f32) -> Self {
        let hi = a + b;
        let from_b = hi - a;
        Self { hi, lo: (a - (hi - from_b)) + (b - from_b) }
    }

    /// `a * b`, exactly where [`two_product`] is.
    #[inline(always)]
    pub fn product(a: f32, b: f32) -> Self {
        let (hi, lo) = two_product(a, b);
        Self { hi, lo }
    }
}

impl Long for Pair {
    const CORNER: f32 = exp2(-44);
    const CORNER_FAR: f32 = exp2(-61);
    const EDGE: f32 = exp2(-44);
    const EDGE_FAR: f32 = exp2(-63);
    const DEPTH: f32 = exp2(-39);
    const WEIGHT: f32 = exp2(-41);
    const WHOLE: bool = false;
    const FIRST: bool = true;

    #[inline(always)]
    fn of(pair: Pair) -> Self {
        pair
    }

    #[inline(always)]
    fn pair(self) -> Pair {
        self
    }

    #[inline(always)]
    fn hi(self) -> f32 {
        self.hi
    }

    #[inline(always)]
    fn by_power(self, power: f32) -> Self {
        Self { hi: self.hi * power, lo: self.lo * power }
    }

    /// Within `2^-48` of its size and `2^-65` of the largest product.
    #[inline(always)]
    fn across(p: Pair, q: Pair, r: Pair, s: Pair) -> Self {
        let first = Pair::sum(p.hi, -q.hi);
        let second = Pair::sum(p.lo, -q.lo);
        let third = Pair::sum(r.hi, -s.hi);
        let fourth = Pair::sum(second.hi, third.hi);
        let fifth = Pair::sum(first.lo, fourth.hi);
        let rest = ((second.lo + third.lo) + (r.lo - s.lo)) + (fourth.lo + fifth.lo);
        let whole = Pair::sum(first.hi, fifth.hi);
        Pair::sum(whole.hi, whole.lo + rest)
    }

    #[inline(always)]
    fn negative(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }

    /// The sum, within `2^-46.4` of both numbers' sizes.
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        let (s, t) = (Self::sum(self.hi, other.hi), Self::sum(self.lo, other.lo));
        let first = Self::sum(s.hi, s.lo + t.hi);
        Self::sum(first.hi, first.lo + t.lo)
    }

    /// The product, within `2^-44.9` of its size.
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        let p = Self::product(self.hi, other.hi);
        Self::sum(p.hi, p.lo + (self.hi * other.lo + self.lo * other.hi))
    }

    /// The quotient, within `2^-42` of its size, by the divisor's reciprocal to within some ULP.
    #[inline(always)]
    fn over(self, divisor: Self, reciprocal: f32) -> Self {
        let first = self.hi * reciprocal;
        let taken = Self::product(first, divisor.hi);
        let left = ((self.hi - taken.hi) - taken.lo) + (self.lo - first * divisor.lo);
        Self::sum(first, left * reciprocal)
    }
}
