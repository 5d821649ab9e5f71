//! Numbers as sums of two doubles, about 106 bits: pairs as in `pair.rs`, for devices that have doubles.

use crate::{
    math::{exp2, left_of},
    pair::{Long, Pair},
};

/// `hi + lo`, `hi` being that rounded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wide {
    hi: f64,
    lo: f64,
}

/// `a + b`, exactly.
#[inline(always)]
fn sum(a: f64, b: f64) -> Wide {
    let hi = a + b;
    let from_b = hi - a;
    Wide { hi, lo: (a - (hi - from_b)) + (b - from_b) }
}

/// The same where `b` is no larger in size, or `a` is 0.
#[inline(always)]
fn quick_sum(a: f64, b: f64) -> Wide {
    let hi = a + b;
    Wide { hi, lo: b - (hi - a) }
}

/// The upper half of a number's 53 digits, rounded (Dekker 1971).
#[inline(always)]
fn head(a: f64) -> f64 {
    let raised = a * 134_217_729.0;
    raised - (raised - a)
}

/// `a * b`, exactly: a double, and what rounding took from it.
#[inline(always)]
pub(crate) fn product(a: f64, b: f64) -> (f64, f64) {
    let all = a * b;
    let (ah, bh) = (head(a), head(b));
    let (al, bl) = (a - ah, b - bh);
    let rest = (((ah * bh - all) + al * bh) + ah * bl) + al * bl;
    (all, left_of(a, b, all, rest))
}

/// `a * b - c * d` within three last bits of it and `2^-102` of its products; where a device rounds once, by Kahan's
/// algorithm (Jeannerod, Louvet & Muller 2013).
#[inline(always)]
pub(super) fn product_difference(a: f64, b: f64, c: f64, d: f64) -> f64 {
    let ((p, left_of_p), (q, left_of_q)) = (product(a, b), product(c, d));
    left_of(a, b, q, (p - q) + left_of_p) - left_of_q
}

/// The float next to `hi + lo`, of which `lo` is at most half of the last digit of `hi`.
#[inline(always)]
fn nearest(hi: f64, lo: f64) -> f32 {
    let near = hi as f32;
    let left = hi - f64::from(near);
    // The float on the other side of `hi`, if that is the middle between two.
    let twice = f64::from(near) + (left + left);
    let other = twice as f32;
    let tie = (f64::from(other) == twice) & (left != 0.0);
    let away = (lo > 0.0) == (left > 0.0);
    if tie & (lo != 0.0) & away { other } else { near }
}

impl Wide {
    /// As a double.
    #[inline(always)]
    pub(super) fn short(self) -> f64 {
        self.hi + self.lo
    }

    /// `a * b - c * d`, within `2^-100` of its products.
    #[inline(always)]
    pub(super) fn product_difference(a: Pair, b: Pair, c: Pair, d: Pair) -> Self {
        let (p, q) = (Self::of(a).times(Self::of(b)), Self::of(c).times(Self::of(d)));
        p.plus_about(q.negative())
    }

    /// The sum, within `2^-102` of the larger number.
    #[inline(always)]
    pub(super) fn plus_about(self, other: Self) -> Self {
        let top = sum(self.hi, other.hi);
        quick_sum(top.hi, top.lo + (self.lo + other.lo))
    }
}

impl Long for Wide {
    const CORNER: f32 = exp2(-96);
    const CORNER_FAR: f32 = exp2(-110);
    const EDGE: f32 = exp2(-94);
    const EDGE_FAR: f32 = exp2(-108);
    const DEPTH: f32 = exp2(-90);
    const WEIGHT: f32 = exp2(-92);
    const WHOLE: bool = true;
    // Near the triangle's plane it has digits enough.
    const VOLUME: bool = false;

    #[inline(always)]
    fn of(pair: Pair) -> Self {
        quick_sum(f64::from(pair.hi), f64::from(pair.lo))
    }

    #[inline(always)]
    fn hi(self) -> f32 {
        self.hi as f32
    }

    #[inline(always)]
    fn negative(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }

    #[inline(always)]
    fn by_power(self, power: f32) -> Self {
        Self { hi: self.hi * f64::from(power), lo: self.lo * f64::from(power) }
    }

    /// Within `2^-104` of it, as for pairs.
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        let (s, t) = (sum(self.hi, other.hi), sum(self.lo, other.lo));
        let first = quick_sum(s.hi, s.lo + t.hi);
        quick_sum(first.hi, first.lo + t.lo)
    }

    /// Within `2^-102` of it.
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        let (hi, lo) = product(self.hi, other.hi);
        quick_sum(hi, lo + (self.hi * other.lo + self.lo * other.hi))
    }

    #[inline(always)]
    fn rounded(self, error: f32) -> (f32, f32) {
        let wide = f64::from(error + exp2(-100));
        let (near, later) = (sum(self.hi, self.lo - wide), sum(self.hi, self.lo + wide));
        (nearest(near.hi, near.lo), nearest(later.hi, later.lo))
    }

    /// Within `2^-98` of it: two digits of 50 bits.
    #[inline(always)]
    fn over(self, divisor: Self, reciprocal: f32) -> Self {
        let r = f64::from(reciprocal);
        let r = r + r * (1.0 - r * divisor.hi);
        let r = r + r * (1.0 - r * divisor.hi);
        let first = self.hi * r;
        let left = self.plus(divisor.times(Self { hi: -first, lo: 0.0 }));
        quick_sum(first, left.hi * r)
    }

    /// All four products are exact. Within `2^-105` of its size and `2^-125` of the largest product.
    #[inline(always)]
    fn across(x: Pair, z: Pair, main: f32, side: f32) -> (Self, bool) {
        let all = f64::from;
        let (p, q) = (all(x.hi) * all(main), all(side) * all(z.hi));
        let (r, s) = (all(x.lo) * all(main), all(side) * all(z.lo));
        let (one, two) = (sum(p, -q), sum(r, -s));
        let three = sum(one.lo, two.hi);
        let four = sum(one.hi, three.hi);
        let found = quick_sum(four.hi, four.lo + (three.lo + two.lo));
        let simple = (x.lo == 0.0) & (z.lo == 0.0) & (one.lo == 0.0);
        (found, simple & (all(found.hi as f32) == found.hi))
    }

    #[inline(always)]
    fn choose(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in the middle between two floats, beside it, and elsewhere, and what lies beside those.
    #[test]
    fn sums_are_rounded_by_all_digits() {
        let mut bits = 0x5EED_u64;
        let mut below = |n: u64| {
            bits ^= bits << 13;
            bits ^= bits >> 7;
            bits ^= bits << 17;
            (bits >> 16) % n
        };
        let mut ties = 0;
        for _ in 0..200_000 {
            // A float's 24 digits, 29 more of a double, and some of which a double has none.
            let top = (1 << 23 | if below(4) == 0 { 0 } else { below(1 << 23) }) << 29;
            let rest = match below(4) {
                0 => below(1 << 29),
                1 => 1 << 28,
                2 => 1 << 27,
                _ => (1 << 28) - 1,
            };
            let hi = if below(2) == 0 { top + rest } else { top - rest };
            let low = if below(4) == 0 { 0 } else { below(1 << 11) as i64 - (1 << 10) };
            let value = (i128::from(hi) << 12) + i128::from(low);
            let size = 127 - value.leading_zeros();
            let unit = 1_i128 << (size - 23);
            let (kept, left) = (value / unit, value % unit);
            let up = left > unit / 2 || (left == unit / 2 && kept & 1 == 1);
            let right = ((kept + i128::from(up)) * unit) as f32;
            ties += u32::from(left == unit / 2);
            for sign in [1.0, -1.0] {
                let found = nearest(sign * hi as f64 * 4096.0, sign * low as f64);
                assert_eq!(found, sign as f32 * right, "{hi} {low}");
            }
        }
        assert!(ties > 10_000, "{ties}");
    }
}
