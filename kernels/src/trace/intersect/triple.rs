//! Numbers as sums of three floats, about 72 bits (after Fabiano, Muller & Picot 2019, "Algorithms for triple-word
//! arithmetic", with simpler sums).

use crate::{
    math::{Digits, Number, exp2},
    pair::{Across, Long, Pair},
};

/// `a + b + c`, each far smaller than the one before.
#[derive(Clone, Copy, Debug)]
pub struct Triple {
    a: f32,
    b: f32,
    c: f32,
}

/// `a + b + c` with its digits in order, exactly.
#[inline(always)]
fn sorted(a: f32, b: f32, c: f32) -> Triple {
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
fn two(a: f32, b: f32) -> (f32, f32) {
    let sum = Pair::sum(a, b);
    (sum.hi, sum.lo)
}

/// The same sum with the larger part in front: each term takes what it can of the one behind it, exactly. Written out,
/// since llvmpipe counts the rounds of loops.
#[inline(always)]
fn settle7([b, c, d, e, f, g, h]: [f32; 7]) -> [f32; 7] {
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
fn settle8([a, b, c, d, e, f, g, h]: [f32; 8]) -> [f32; 8] {
    let [b, c, d, e, f, g, h] = settle7([b, c, d, e, f, g, h]);
    let (a, b) = two(a, b);
    [a, b, c, d, e, f, g, h]
}

impl Triple {
    /// `a * b - c * d`, within `2^-64` of its products.
    #[inline(always)]
    pub(super) fn product_difference(a: Pair, b: Pair, c: Pair, d: Pair) -> Self {
        let (p, q) = (Pair::product(a.hi, b.hi), Pair::product(c.hi, d.hi));
        let (r, s) = (Pair::product(a.hi, b.lo), Pair::product(a.lo, b.hi));
        let (t, u) = (Pair::product(c.hi, d.lo), Pair::product(c.lo, d.hi));
        let top = Pair::sum(p.hi, -q.hi);
        // All of the second float's size, and what is left of that.
        let one = Pair::sum(p.lo, -q.lo);
        let two = Pair::sum(r.hi, -t.hi);
        let three = Pair::sum(s.hi, -u.hi);
        let four = Pair::sum(two.hi, three.hi);
        let five = Pair::sum(one.hi, four.hi);
        let six = Pair::sum(top.lo, five.hi);
        let low = (a.lo * b.lo - c.lo * d.lo) + ((r.lo - t.lo) + (s.lo - u.lo));
        let rest = ((one.lo + two.lo) + (three.lo + four.lo)) + (five.lo + six.lo);
        sorted(top.hi, six.hi, low + rest)
    }

    /// As a number of any kind.
    #[inline(always)]
    pub(super) fn long<L: Long>(self) -> L {
        L::of_sum(self.a, self.b, self.c)
    }

    /// The product, within `2^-64` of its size.
    #[inline(always)]
    pub(super) fn times_pair(self, other: Pair) -> Self {
        self.product(other, self.c * other.hi)
    }

    /// The product with a number of which `low` is what the third floats add.
    #[inline(always)]
    fn product(self, other: Pair, low: f32) -> Self {
        let p = Pair::product(self.a, other.hi);
        let (q, r) = (Pair::product(self.a, other.lo), Pair::product(self.b, other.hi));
        let both = Pair::sum(q.hi, r.hi);
        let middle = Pair::sum(p.lo, both.hi);
        let low = low + (self.b * other.lo + (q.lo + r.lo));
        sorted(p.hi, middle.hi, low + (both.lo + middle.lo))
    }

    /// The sum with a small number, rounded. Where half of the last digit is left, what is smaller still decides; where
    /// nothing is, a little more to that side.
    #[inline(always)]
    fn beside(self, by: f32) -> f32 {
        let rest = Pair::sum(self.b, self.c + by);
        let sum = Pair::sum(self.a, rest.hi);
        let (left, half) = (sum.lo.abs(), sum.hi.unit().unit() * exp2(-24));
        // Below a power of two numbers are half as far apart.
        let tie = (left == half) | (left == half * 0.5);
        let side = f32::choose(rest.lo == 0.0, by, rest.lo);
        let more = (rest.hi.abs() * exp2(-20)).signed(side);
        f32::choose(tie, self.a + (rest.hi + more), sum.hi)
    }

    /// Less the product of another and a float, within `2^-67` of the larger of both.
    #[inline(always)]
    fn less(self, other: Self, by: f32) -> Self {
        self.plus(other.times(Self::of(Pair::float(-by))))
    }
}

impl Long for Triple {
    const CORNER: f32 = exp2(-60);
    const CORNER_FAR: f32 = exp2(-77);
    const EDGE: f32 = exp2(-59);
    const EDGE_FAR: f32 = exp2(-77);
    const DEPTH: f32 = exp2(-58);
    const WEIGHT: f32 = exp2(-60);
    const WHOLE: bool = true;
    const VOLUME: bool = true;

    #[inline(always)]
    fn of(pair: Pair) -> Self {
        Self { a: pair.hi, b: pair.lo, c: 0.0 }
    }

    #[inline(always)]
    fn of_sum(a: f32, b: f32, c: f32) -> Self {
        Self { a, b, c }
    }

    #[inline(always)]
    fn hi(self) -> f32 {
        self.a
    }

    /// All digits count: by pairs one in `2^20` would be too near the middle between two floats.
    #[inline(always)]
    fn rounded(self, error: f32) -> (f32, f32) {
        let wide = error + exp2(-100);
        (self.beside(-wide), self.beside(wide))
    }

    #[inline(always)]
    fn negative(self) -> Self {
        Self { a: -self.a, b: -self.b, c: -self.c }
    }

    #[inline(always)]
    fn by_power(self, power: f32) -> Self {
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
        self.product(Pair { hi: other.a, lo: other.b }, self.a * other.c + self.c * other.a)
    }

    #[inline(always)]
    fn over(self, divisor: Self, reciprocal: f32) -> Self {
        let first = self.a * reciprocal;
        let left = self.less(divisor, first);
        let second = left.a * reciprocal;
        let left = left.less(divisor, second);
        sorted(first, second, left.a * reciprocal)
    }

    /// Within `2^-62` of its size and `2^-79` of the largest product: passes over all terms leave the first float and,
    /// in the others, all that it lacks (Ogita, Rump & Oishi 2005, "Accurate sum and dot product", section 4).
    #[inline(always)]
    fn across(x: Pair, z: Pair, main: f32, side: f32) -> (Self, bool) {
        let (Across { p, q, r, s }, known) = Across::new(x, z, main, side);
        let all = [p.hi, -q.hi, p.lo, -q.lo, r.hi, -s.hi, r.lo, -s.lo];
        let [first, b, c, d, e, f, g, h] = settle8(settle8(settle8(all)));
        let [second, c, d, e, f, g, h] = settle7(settle7([b, c, d, e, f, g, h]));
        (sorted(first, second, c + (d + (e + (f + (g + h))))), known)
    }

    #[inline(always)]
    fn choose(mask: bool, a: Self, b: Self) -> Self {
        let each = |a, b| f32::choose(mask, a, b);
        Self { a: each(a.a, b.a), b: each(a.b, b.b), c: each(a.c, b.c) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the unit of the numbers below is: a power of two.
    const UNIT: i32 = -90;

    /// A whole number of units, rounded to nearest even.
    fn nearest(value: i128) -> f32 {
        let size = value.unsigned_abs();
        let shift = 128 - size.leading_zeros() - 24;
        let (kept, left, half) = (size >> shift, size & ((1 << shift) - 1), 1 << (shift - 1));
        let up = left > half || (left == half && kept & 1 == 1);
        let rounded = (kept as u32 + u32::from(up)) as f32 * exp2(shift as i32 + UNIT);
        if value < 0 { -rounded } else { rounded }
    }

    /// Numbers near the middle between two floats, and what lies between the ends that are found.
    #[test]
    fn ends_are_rounded_by_all_digits() {
        let mut bits = 0x5EED_u64;
        let mut below = |n: u64| {
            bits ^= bits << 13;
            bits ^= bits >> 7;
            bits ^= bits << 17;
            (bits >> 16) % n
        };
        let (mut sure, mut ties) = (0, 0);
        for _ in 0..200_000 {
            let a = 1 << 23 | if below(4) == 0 { 0 } else { below(1 << 23) };
            // Parts of the last digit, in units of `2^-49`: halves and quarters of it, and what is one beside those.
            let b = match below(4) {
                0 => below(1 << 24) << 24,
                1 => 1 << 48,
                2 => 1 << 47,
                _ => (1 << 48) - (1 << 24),
            };
            let (c, error) = (below(1 << 10), [0, 1, 2, below(1 << 10)][below(4) as usize]);
            let signed = |x: u64, bit: u64| if bit == 0 { x as i128 } else { -(x as i128) };
            let (b, c) = (signed(b, below(2)), signed(c, below(2)));
            let triple = Triple { a: a as f32, b: b as f32 * exp2(-49), c: c as f32 * exp2(-80) };
            let (near, later) = triple.rounded(error as f32 * exp2(-80));
            let (value, off) = ((a as i128) << 90, (error as i128) << 10);
            let value = value + (b << 41) + (c << 10);
            let (least, most) = (nearest(value - off), nearest(value + off));
            assert!(
                near <= least && most <= later,
                "{triple:?} {error}: {near} to {later}, {least} to {most}"
            );
            sure += u32::from(near == later);
            ties += u32::from(least == most && near != later);
        }
        assert!(sure > 190_000 && ties < 100, "{sure} {ties}");
    }
}
