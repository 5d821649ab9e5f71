//! Numbers as sums of two floats, about 48 digits (Dekker 1971; Knuth 1969).

use crate::math::two_product;

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

    /// With another sign.
    #[inline(always)]
    pub fn negative(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }

    /// The sum, within `2^-45` of the larger number.
    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        let (s, t) = (Self::sum(self.hi, other.hi), Self::sum(self.lo, other.lo));
        let first = Self::sum(s.hi, s.lo + t.hi);
        Self::sum(first.hi, first.lo + t.lo)
    }

    /// The product, within `2^-44` of its size.
    #[inline(always)]
    pub fn times(self, other: Self) -> Self {
        let p = Self::product(self.hi, other.hi);
        Self::sum(p.hi, p.lo + (self.hi * other.lo + self.lo * other.hi))
    }

    /// The quotient, within `2^-42` of its size, by the divisor's reciprocal to within some ULP.
    #[inline(always)]
    pub fn over(self, divisor: Self, reciprocal: f32) -> Self {
        let first = self.hi * reciprocal;
        let taken = Self::product(first, divisor.hi);
        let left = ((self.hi - taken.hi) - taken.lo) + (self.lo - first * divisor.lo);
        Self::sum(first, left * reciprocal)
    }
}
