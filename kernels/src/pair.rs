//! Numbers as sums of two floats, about 48 bits (Dekker 1971; Knuth 1969).

use crate::math::{Digits, Number, exp2, is_small, two_product};
use core::ops::{Add, Mul, Neg, Sub};

/// Numbers of more digits than a float. What bounds the errors that `trace/intersect/filter.rs` makes stands with each
/// kind.
pub trait Long: Copy {
    /// Twice what corners across the ray may be off by: a part of their size, and one of the scene's.
    const CORNER: f32;
    /// See [`Long::CORNER`].
    const CORNER_FAR: f32;
    /// What edge functions may be off by: a part of the sum of their products, and one of the corners' coordinates
    /// times the scene's size.
    const EDGE: f32;
    /// See [`Long::EDGE`].
    const EDGE_FAR: f32;
    /// What rounding adds to the error of `t`, a part of the largest depth.
    const DEPTH: f32;
    /// What rounding adds to the errors of `u` and `v`, a part of them.
    const WEIGHT: f32;
    /// Whether directions must have all their digits.
    const WHOLE: bool;
    /// Whether a `t` next to 0 is found by the volume of triangle and origin.
    const VOLUME: bool;

    /// The same number.
    fn of(pair: Pair) -> Self;
    /// `a + b + c`, each far smaller than the one before: within `2^-47`, of triples exactly.
    #[inline(always)]
    fn of_sum(a: f32, b: f32, c: f32) -> Self {
        Self::of(Pair { hi: a, lo: b + c })
    }
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
    /// Between which numbers it lies when rounded, if it may be off by `error`.
    fn rounded(self, error: f32) -> (f32, f32);
    /// The quotient, by the divisor's reciprocal to within `2^-22`.
    fn over(self, divisor: Self, reciprocal: f32) -> Self;
    /// `x * main - side * z`, where the lower parts are far smaller than the others, which may cancel; and where it is
    /// surely a float, exactly.
    fn across(x: Pair, z: Pair, main: f32, side: f32) -> (Self, bool);
    /// `a` where the answer is yes, else `b`.
    fn choose(mask: bool, a: Self, b: Self) -> Self;
}

/// Doubles: one, or some side by side.
pub(crate) trait Double:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// Floats, as many.
    type One: Digits;
    /// These floats.
    fn of(x: Self::One) -> Self;
    /// The same number everywhere.
    fn all(x: f64) -> Self;
    /// Rounded to floats.
    fn float(self) -> Self::One;
    /// Without the sign.
    fn size(self) -> Self;
    /// Whether it is larger.
    fn exceeds(self, other: Self) -> <Self::One as Number>::Mask;
    /// `a * b - c * d` within three last bits of it and `2^-102` of its products.
    fn product_difference(a: Self, b: Self, c: Self, d: Self) -> Self;
    /// The reciprocal within `2^-51` of it, of a number that is normal as a float.
    fn inverse(self) -> Self;
}

/// `hi + lo`, `hi` being that rounded.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// The number, rounded.
    pub hi: f32,
    /// What rounding took.
    pub lo: f32,
}

impl Pair {
    /// A float.
    #[inline(always)]
    pub fn float(hi: f32) -> Self {
        Self { hi, lo: 0.0 }
    }

    /// `a + b`, exactly.
    #[inline(always)]
    pub fn sum(a: f32, b: f32) -> Self {
        let hi = a + b;
        let from_b = hi - a;
        Self { hi, lo: (a - (hi - from_b)) + (b - from_b) }
    }

    /// The same where `b` is no larger in size, or `a` is 0.
    #[inline(always)]
    pub fn quick_sum(a: f32, b: f32) -> Self {
        let hi = a + b;
        Self { hi, lo: b - (hi - a) }
    }

    /// `a * b`, exactly where [`two_product()`](crate::math::two_product) is.
    #[inline(always)]
    pub fn product(a: f32, b: f32) -> Self {
        let (hi, lo) = two_product(a, b);
        Self { hi, lo }
    }
}

/// Products of smaller numbers may lose digits below the range of `f32`.
pub(crate) const PAIR_FLOOR: f32 = exp2(-36);

/// `p - q + r - s` is `x * main - side * z`.
pub(crate) struct Across {
    pub p: Pair,
    pub q: Pair,
    pub r: Pair,
    pub s: Pair,
}

impl Across {
    /// And whether it is a float, exactly.
    #[inline(always)]
    pub(crate) fn new(x: Pair, z: Pair, main: f32, side: f32) -> (Self, bool) {
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
        (Self { p, q, r, s }, known)
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
    const VOLUME: bool = true;

    #[inline(always)]
    fn of(pair: Self) -> Self {
        pair
    }

    #[inline(always)]
    fn hi(self) -> f32 {
        self.hi
    }

    /// It may also be off by what a device that flushes subnormal numbers takes on the way.
    #[inline(always)]
    fn rounded(self, error: f32) -> (f32, f32) {
        let wide = error + self.lo.abs() * exp2(-20) + exp2(-100);
        (self.hi + (self.lo - wide), self.hi + (self.lo + wide))
    }

    #[inline(always)]
    fn by_power(self, power: f32) -> Self {
        Self { hi: self.hi * power, lo: self.lo * power }
    }

    /// Within `2^-48` of its size and `2^-65` of the largest product.
    #[inline(always)]
    fn across(x: Self, z: Self, main: f32, side: f32) -> (Self, bool) {
        let (Across { p, q, r, s }, known) = Across::new(x, z, main, side);
        let first = Self::sum(p.hi, -q.hi);
        let second = Self::sum(p.lo, -q.lo);
        let third = Self::sum(r.hi, -s.hi);
        let fourth = Self::sum(second.hi, third.hi);
        let fifth = Self::sum(first.lo, fourth.hi);
        let rest = ((second.lo + third.lo) + (r.lo - s.lo)) + (fourth.lo + fifth.lo);
        let whole = Self::sum(first.hi, fifth.hi);
        (Self::sum(whole.hi, whole.lo + rest), known)
    }

    #[inline(always)]
    fn negative(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }

    /// The sum, within `2^-46.4` of it (Joldes, Muller & Popescu 2017, "Tight and rigorous error bounds for basic
    /// building blocks of double-word arithmetic", algorithm 6).
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        let (s, t) = (Self::sum(self.hi, other.hi), Self::sum(self.lo, other.lo));
        let first = Self::quick_sum(s.hi, s.lo + t.hi);
        Self::quick_sum(first.hi, first.lo + t.lo)
    }

    /// The product, within `2^-44.9` of its size.
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        let p = Self::product(self.hi, other.hi);
        Self::quick_sum(p.hi, p.lo + (self.hi * other.lo + self.lo * other.hi))
    }

    /// Within `2^-42` of its size.
    #[inline(always)]
    fn over(self, divisor: Self, reciprocal: f32) -> Self {
        let first = self.hi * reciprocal;
        let taken = Self::product(first, divisor.hi);
        let left = ((self.hi - taken.hi) - taken.lo) + (self.lo - first * divisor.lo);
        Self::quick_sum(first, left * reciprocal)
    }

    #[inline(always)]
    fn choose(mask: bool, a: Self, b: Self) -> Self {
        Self { hi: f32::choose(mask, a.hi, b.hi), lo: f32::choose(mask, a.lo, b.lo) }
    }
}
