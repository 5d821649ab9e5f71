//! Numbers of 53 bits, as a CPU has them: instead of [pairs](super::pair), and sooner.
//!
//! Coordinates across the ray are differences of products of size `2 M` at most, whose factors and results are rounded:
//! within `8 * 2^-53 M`. A pair's are closer where they are small. So beside small triangles far away doubles leave
//! more to triples, but one operation does the work of a pair's ten to twenty.

use crate::{
    math::exp2,
    pair::{Long, Pair},
};

impl Long for f64 {
    const CORNER: f32 = exp2(-50);
    const CORNER_FAR: f32 = exp2(-49);
    const EDGE: f32 = exp2(-50);
    const EDGE_FAR: f32 = exp2(-49);
    const DEPTH: f32 = exp2(-47);
    const WEIGHT: f32 = exp2(-48);
    const WHOLE: bool = false;
    const VOLUME: bool = true;

    #[inline(always)]
    fn of(pair: Pair) -> Self {
        Self::from(pair.hi) + Self::from(pair.lo)
    }

    #[inline(always)]
    fn rounded(self, error: f32) -> (f32, f32) {
        let hi = self as f32;
        Pair { hi, lo: (self - Self::from(hi)) as f32 }.rounded(error)
    }

    #[inline(always)]
    fn hi(self) -> f32 {
        self as f32
    }

    #[inline(always)]
    fn negative(self) -> Self {
        -self
    }

    #[inline(always)]
    fn by_power(self, power: f32) -> Self {
        self * Self::from(power)
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self * other
    }

    #[inline(always)]
    fn over(self, divisor: Self, _reciprocal: f32) -> Self {
        self / divisor
    }

    #[inline(always)]
    fn across(x: Pair, z: Pair, main: f32, side: f32) -> (Self, bool) {
        // Of floats products are exact, so this is if nothing is rounded here.
        let (p, q) = (Self::of(x) * Self::from(main), Self::from(side) * Self::of(z));
        let found = p - q;
        let taken = found - p;
        let lost = (p - (found - taken)) - (q + taken);
        let floats = (x.lo == 0.0) & (z.lo == 0.0) & (lost == 0.0);
        (found, floats & (Self::from(found as f32) == found))
    }

    #[inline(always)]
    fn choose(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
}
