//! Eight numbers side by side, in a register of AVX2, with FMA.
//!
//! All of it must be inlined into a function compiled for these instructions, which is called only where the processor
//! has them: see [`packet`](crate::trace::side_by_side).

use crate::{
    glam::{UVec4, Vec3, Vec4},
    math::{Digits, Listed, Number, Row, Sides},
    mem::Buf,
    pair::Double,
};
use core::{
    arch::x86_64::*,
    ops::{Add, BitAnd, BitOr, Mul, Neg, Not, Sub},
};
use raykd_shared::limits::BINS;

/// How many numbers stand in a register, and so how many rays are answered at once.
pub(crate) const SIDE_BY_SIDE: u32 = 8;

/// Instructions of AVX2.
macro_rules! avx2 {
    ($instructions:expr) => {
        // SAFETY: an `Eight` is made only in functions that run where the processor has AVX2; what is read or written
        // lies in an array of eight, or in a buffer, which was checked.
        unsafe { $instructions }
    };
}

/// Eight numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eight(__m256);

/// Eight answers: all bits or none.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mask(__m256);

/// Eight counts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counts(__m256i);

macro_rules! operator {
    ($of:ident, $name:ident, $method:ident, $instruction:ident) => {
        impl $name for $of {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(avx2!($instruction(self.0, other.0)))
            }
        }
    };
}

operator!(Eight, Add, add, _mm256_add_ps);
operator!(Eight, Sub, sub, _mm256_sub_ps);
operator!(Eight, Mul, mul, _mm256_mul_ps);
operator!(Mask, BitAnd, bitand, _mm256_and_ps);
operator!(Mask, BitOr, bitor, _mm256_or_ps);

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(avx2!(_mm256_xor_ps(self.0, _mm256_castsi256_ps(_mm256_set1_epi32(-1)))))
    }
}

impl Neg for Eight {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(avx2!(_mm256_xor_ps(self.0, _mm256_set1_ps(-0.0))))
    }
}

impl Number for Eight {
    type Mask = Mask;
    #[inline(always)]
    fn all(x: f32) -> Self {
        Self(avx2!(_mm256_set1_ps(x)))
    }
    #[inline(always)]
    fn exceeds(self, other: Self) -> Mask {
        Mask(avx2!(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn is(self, other: Self) -> Mask {
        Mask(avx2!(_mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn choose(mask: Mask, a: Self, b: Self) -> Self {
        Self(avx2!(_mm256_blendv_ps(b.0, a.0, mask.0)))
    }
    #[inline(always)]
    fn every(mask: Mask) -> bool {
        <Self as Sides>::bits(mask) == 0xFF
    }
}

impl Listed for Eight {
    const WIDTH: u32 = 8;
    #[inline(always)]
    fn numbers(first: u32) -> Self {
        Self(avx2!(_mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0))) + Self::all(first as i32 as f32)
    }
    #[inline(always)]
    fn bits<const N: usize>(words: &[u32; N], i: u32) -> Self {
        let words = &words[i as usize..i as usize + 8];
        Self(avx2!(_mm256_loadu_ps(words.as_ptr().cast())))
    }
    #[inline(always)]
    fn counts<const N: usize>(words: &[u32; N], i: u32) -> Self {
        let words = &words[i as usize..i as usize + 8];
        Self(avx2!(_mm256_cvtepi32_ps(_mm256_loadu_si256(words.as_ptr().cast()))))
    }
    #[inline(always)]
    fn put<const N: usize>(self, words: &mut [u32; N], i: u32) {
        let words = &mut words[i as usize..i as usize + 8];
        avx2!(_mm256_storeu_ps(words.as_mut_ptr().cast(), self.0));
    }
}

impl Row for Eight {
    const BOXES: u32 = 4;
    #[inline(always)]
    fn of(lows: &[u32], highs: &[u32]) -> Self {
        let (lows, highs) = (&lows[..4], &highs[..4]);
        Self(avx2!(_mm256_set_m128(_mm_loadu_ps(highs.as_ptr().cast()), _mm_loadu_ps(lows.as_ptr().cast()))))
    }
    #[inline(always)]
    fn numbers(low: f32, high: f32) -> Self {
        let first = avx2!(_mm256_set_m128(_mm_set1_ps(high), _mm_set1_ps(low)));
        Self(avx2!(_mm256_add_ps(first, _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0))))
    }
    type Tally = Counts;
    #[inline(always)]
    fn never() -> Counts {
        Counts(avx2!(_mm256_setzero_si256()))
    }
    #[inline(always)]
    fn once_more(tally: Counts, mask: Mask) -> Counts {
        // All bits are -1. Integers are added in other units than numbers are compared in.
        Counts(avx2!(_mm256_sub_epi32(tally.0, _mm256_castps_si256(mask.0))))
    }
    #[inline(always)]
    fn times(tally: Counts) -> Self {
        Self(avx2!(_mm256_cvtepi32_ps(tally.0)))
    }
    #[inline(always)]
    fn smallest(self) -> f32 {
        avx2!({
            let four = _mm_min_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let two = _mm_min_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)))
        })
    }
}

impl Eight {
    /// Bits of which boxes with these low and high faces go below a plane, and which above.
    #[inline(always)]
    pub(crate) fn parted(lows: &[u32], highs: &[u32], plane: f32) -> (u32, u32) {
        let at = Self::all(plane);
        let (mut belows, mut aboves) = (0, 0);
        for (i, (low, high)) in lows.chunks_exact(4).zip(highs.chunks_exact(4)).enumerate() {
            let faces = <Self as Row>::of(low, high);
            let (less, more) = (at.exceeds(faces), faces.exceeds(at));
            let (less, more) = (<Self as Sides>::bits(less), <Self as Sides>::bits(more));
            // Low faces stand in the lower half. What ends in the plane or before goes below, too.
            belows |= ((less | !(more >> 4)) & 15) << (4 * i);
            aboves |= (more >> 4) << (4 * i);
        }
        (belows, aboves)
    }

    /// Enters a box, whose corners stand in the first three words of `lo` and `hi`, into the histogram of a node that
    /// begins at `from`. That begins at word `BEFORE`; its words stand in pairs, a count and a place, bin by bin: of
    /// low faces on each axis, then of high faces.
    #[inline(always)]
    pub(crate) fn enter<const BEFORE: usize, const WORDS: usize>(
        table: &mut [u32; WORDS],
        lo: UVec4,
        hi: UVec4,
        from: Vec3,
        rates: Vec3,
    ) {
        avx2!({
            let twice = |v: Vec3| _mm256_setr_ps(v.x, v.y, v.z, 0.0, v.x, v.y, v.z, 0.0);
            let four = |v: UVec4| _mm_loadu_ps((&raw const v).cast());
            let faces = _mm256_blend_ps::<0x88>(_mm256_set_m128(four(hi), four(lo)), _mm256_setzero_ps());
            let bin = _mm256_mul_ps(_mm256_sub_ps(faces, twice(from)), twice(rates));
            // As `whole` does: what is no number becomes 0.
            let bin = _mm256_max_ps(bin, _mm256_setzero_ps());
            let bin = _mm256_min_ps(_mm256_set1_ps((BINS - 1) as f32), bin);
            // No bin is out of range, which a compiler cannot know.
            let bin = _mm256_and_si256(_mm256_cvttps_epi32(bin), _mm256_set1_epi32((BINS - 1).cast_signed()));
            // As `ordered` does; low faces inverted, and all bits of those that lie in the high ones.
            let bits = _mm256_castps_si256(faces);
            let sign = _mm256_or_si256(_mm256_srai_epi32::<31>(bits), _mm256_set1_epi32(i32::MIN));
            let is_low = _mm256_setr_epi32(-1, -1, -1, -1, 0, 0, 0, 0);
            let order = _mm256_xor_si256(_mm256_xor_si256(bits, sign), is_low);
            let highs = _mm256_permute2f128_ps::<1>(faces, faces);
            let extends = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(faces, highs));
            let places = _mm256_or_si256(order, _mm256_andnot_si256(extends, is_low));
            // Each place behind a zero, to be compared with a pair.
            let x_and_z = _mm256_slli_epi64::<32>(places);
            let y = _mm256_blend_epi32::<0x55>(places, _mm256_setzero_si256());
            let mut tally = |face: usize, bin: i32, place: __m128i| {
                let at = BEFORE + 2 * (face * BINS as usize + bin as usize);
                let pair = &mut table[at..at + 2];
                let counted =
                    _mm_add_epi32(_mm_loadl_epi64(pair.as_ptr().cast()), _mm_setr_epi32(1, 0, 0, 0));
                _mm_storel_epi64(pair.as_mut_ptr().cast(), _mm_max_epu32(counted, place));
            };
            let (low, high) = (_mm256_castsi256_si128(bin), _mm256_extracti128_si256::<1>(bin));
            let (low_xz, high_xz) = (_mm256_castsi256_si128(x_and_z), _mm256_extracti128_si256::<1>(x_and_z));
            tally(0, _mm_extract_epi32::<0>(low), low_xz);
            tally(1, _mm_extract_epi32::<1>(low), _mm256_castsi256_si128(y));
            tally(2, _mm_extract_epi32::<2>(low), _mm_unpackhi_epi64(low_xz, low_xz));
            tally(3, _mm_extract_epi32::<0>(high), high_xz);
            tally(4, _mm_extract_epi32::<1>(high), _mm256_extracti128_si256::<1>(y));
            tally(5, _mm_extract_epi32::<2>(high), _mm_unpackhi_epi64(high_xz, high_xz));
        });
    }

    /// Those bits of each.
    #[inline(always)]
    fn only(self, bits: u32) -> Self {
        Self(avx2!(_mm256_and_ps(self.0, _mm256_castsi256_ps(_mm256_set1_epi32(bits.cast_signed())))))
    }
}

impl Digits for Eight {
    #[inline(always)]
    fn below(self, other: Self) -> Mask {
        Mask(avx2!(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.only(0x7FFF_FFFF)
    }
    #[inline(always)]
    fn two_product(self, other: Self) -> (Self, Self) {
        // A fused multiplication rounds once: the same two numbers.
        let product = self * other;
        (product, Self(avx2!(_mm256_fmsub_ps(self.0, other.0, product.0))))
    }
    #[inline(always)]
    fn is_small(self, floor: f32) -> Mask {
        let size = self.abs();
        size.below(Self::all(floor)) & size.exceeds(Self::all(0.0))
    }
    #[inline(always)]
    fn unit(self) -> Self {
        let exponents = self.only(0x7F80_0000);
        Self(avx2!(_mm256_castsi256_ps(_mm256_sub_epi32(
            _mm256_set1_epi32(254 << 23),
            _mm256_castps_si256(exponents.0)
        ))))
    }
    #[inline(always)]
    fn low(self, other: Self) -> Self {
        // The second one if they are equal, or one is none.
        Self(avx2!(_mm256_min_ps(other.0, self.0)))
    }
    #[inline(always)]
    fn high(self, other: Self) -> Self {
        Self(avx2!(_mm256_max_ps(other.0, self.0)))
    }
    #[inline(always)]
    fn signed(self, sign: Self) -> Self {
        Self(avx2!(_mm256_or_ps(sign.only(0x8000_0000).0, self.0)))
    }
    #[inline(always)]
    fn over(self, divisor: Self) -> Self {
        Self(avx2!(_mm256_div_ps(self.0, divisor.0)))
    }
    #[inline(always)]
    fn reciprocal(self) -> Self {
        Self::all(1.0).over(self)
    }
}

/// Eight doubles, four and four.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Doubles(__m256d, __m256d);

/// The same instruction of both halves.
macro_rules! both {
    ($instruction:ident($($of:expr),*)) => {
        Doubles(avx2!($instruction($($of.0),*)), avx2!($instruction($($of.1),*)))
    };
}

impl Add for Doubles {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        both!(_mm256_add_pd(self, other))
    }
}

impl Sub for Doubles {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        both!(_mm256_sub_pd(self, other))
    }
}

impl Mul for Doubles {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        both!(_mm256_mul_pd(self, other))
    }
}

impl Neg for Doubles {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let zero = Self::all(-0.0);
        both!(_mm256_xor_pd(self, zero))
    }
}

impl Double for Doubles {
    type One = Eight;

    #[inline(always)]
    fn of(Eight(floats): Eight) -> Self {
        avx2!(Self(
            _mm256_cvtps_pd(_mm256_castps256_ps128(floats)),
            _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(floats))
        ))
    }
    #[inline(always)]
    fn all(x: f64) -> Self {
        avx2!(Self(_mm256_set1_pd(x), _mm256_set1_pd(x)))
    }
    #[inline(always)]
    fn float(self) -> Eight {
        Eight(avx2!(_mm256_set_m128(_mm256_cvtpd_ps(self.1), _mm256_cvtpd_ps(self.0))))
    }
    #[inline(always)]
    fn size(self) -> Self {
        let zero = Self::all(-0.0);
        both!(_mm256_andnot_pd(zero, self))
    }
    #[inline(always)]
    fn exceeds(self, other: Self) -> Mask {
        Mask(avx2!({
            let one = _mm256_castpd_ps(_mm256_cmp_pd::<_CMP_GT_OQ>(self.0, other.0));
            let two = _mm256_castpd_ps(_mm256_cmp_pd::<_CMP_GT_OQ>(self.1, other.1));
            // Half of each answer, and these in order.
            let mixed = _mm256_castps_pd(_mm256_shuffle_ps::<0b10_00_10_00>(one, two));
            _mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(mixed))
        }))
    }
    #[inline(always)]
    fn product_difference(a: Self, b: Self, c: Self, d: Self) -> Self {
        let product = c * d;
        let (found, left) = (both!(_mm256_fmsub_pd(a, b, product)), both!(_mm256_fmsub_pd(c, d, product)));
        found - left
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        let one = Self::all(1.0);
        both!(_mm256_div_pd(one, self))
    }
}

impl Sides for Eight {
    type Turn = __m256i;
    #[inline(always)]
    fn columns(rows: &[Vec4; 8]) -> [Self; 4] {
        avx2!({
            let row = |i: usize| _mm_loadu_ps(rows[i].as_ref().as_ptr());
            let two = |i: usize| _mm256_set_m128(row(i + 4), row(i));
            let (a, b, c, d) = (two(0), two(1), two(2), two(3));
            let (xy0, zw0) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let (xy1, zw1) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            [
                Self(_mm256_shuffle_ps::<0x44>(xy0, xy1)),
                Self(_mm256_shuffle_ps::<0xEE>(xy0, xy1)),
                Self(_mm256_shuffle_ps::<0x44>(zw0, zw1)),
                Self(_mm256_shuffle_ps::<0xEE>(zw0, zw1)),
            ]
        })
    }
    #[inline(always)]
    fn numbers(self) -> [f32; 8] {
        let mut numbers = [0.0; 8];
        avx2!(_mm256_storeu_ps(numbers.as_mut_ptr(), self.0));
        numbers
    }
    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        avx2!(_mm256_movemask_ps(mask.0)).cast_unsigned()
    }
    #[inline(always)]
    fn mask(bits: u32) -> Mask {
        Mask(avx2!({
            let own = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(
                _mm256_and_si256(_mm256_set1_epi32(bits.cast_signed()), own),
                own,
            ))
        }))
    }
    #[inline(always)]
    fn turn(numbers: Self) -> __m256i {
        avx2!(_mm256_cvtps_epi32(numbers.0))
    }
    #[inline(always)]
    fn turned(v: Vec4, turn: __m256i) -> Self {
        Self(avx2!({
            let v = _mm_loadu_ps(v.as_ref().as_ptr());
            _mm256_permutevar_ps(_mm256_set_m128(v, v), turn)
        }))
    }
    #[inline(always)]
    fn of(numbers: &[f32; 8]) -> Self {
        Self(avx2!(_mm256_loadu_ps(numbers.as_ptr())))
    }
    #[inline(always)]
    fn leaves(tags: Self) -> Mask {
        Mask(avx2!({
            let leaf = _mm256_set1_epi32(3);
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(_mm256_castps_si256(tags.0), leaf), leaf))
        }))
    }
    #[inline(always)]
    fn on_axis(tags: Self, numbers: &[Self; 3]) -> Self {
        let [x, y, z] = *numbers;
        // A choice is by the highest bit.
        let (is_y, is_z) = avx2!({
            let tags = _mm256_castps_si256(tags.0);
            (
                _mm256_castsi256_ps(_mm256_slli_epi32::<31>(tags)),
                _mm256_castsi256_ps(_mm256_slli_epi32::<30>(tags)),
            )
        });
        Self::choose(Mask(is_z), z, Self::choose(Mask(is_y), y, x))
    }
    #[inline(always)]
    fn child(tags: Self, above: Mask) -> Self {
        Self(avx2!({
            let below = _mm256_srli_epi32::<2>(_mm256_castps_si256(tags.0));
            let one = _mm256_srli_epi32::<31>(_mm256_castps_si256(above.0));
            _mm256_castsi256_ps(_mm256_or_si256(below, one))
        }))
    }
    #[inline(always)]
    fn nodes(pairs: &Buf<UVec4>, numbers: Self, some: Mask, rest: (Self, Self)) -> (Self, Self) {
        let (start, length) = pairs.place();
        avx2!({
            let (numbers, some) = (_mm256_castps_si256(numbers.0), _mm256_castps_si256(some.0));
            // As numbers with a sign: two words a node and indices of four bytes leave no more.
            let most = _mm256_set1_epi32((2 * length).min(1 << 30) as i32);
            let inside = _mm256_cmpgt_epi32(most, numbers);
            let found = length > 0 && _mm256_testc_si256(inside, some) != 0;
            assert!(found, "a node's children in a buffer of {length} pairs");
            // Both words of four nodes at a time, 0, 1, 4 and 5 first: so each word's shuffle puts them in order.
            let numbers = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_and_si256(numbers, some));
            let start = start.cast::<i64>();
            let first = _mm256_i32gather_epi64::<8>(start, _mm256_castsi256_si128(numbers));
            let second = _mm256_i32gather_epi64::<8>(start, _mm256_extracti128_si256::<1>(numbers));
            let (first, second) = (_mm256_castsi256_ps(first), _mm256_castsi256_ps(second));
            let some = Mask(_mm256_castsi256_ps(some));
            let word0 = Self(_mm256_shuffle_ps::<0b10_00_10_00>(first, second));
            let word1 = Self(_mm256_shuffle_ps::<0b11_01_11_01>(first, second));
            (Self::choose(some, word0, rest.0), Self::choose(some, word1, rest.1))
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    extern crate std;
    use super::*;
    use crate::math::exp2;

    /// Whether this processor has the instructions; says so if not.
    pub(crate) fn has_usual() -> bool {
        let has = std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma");
        if !has {
            std::eprintln!("not tested: this processor has no AVX2 or no FMA");
        }
        has
    }

    /// Numbers of many sizes, by Marsaglia's xorshift.
    fn numbers(seed: &mut u64) -> [f32; 8] {
        [(); 8].map(|()| {
            *seed ^= *seed << 13;
            *seed ^= *seed >> 7;
            *seed ^= *seed << 17;
            let size = exp2((*seed >> 40) as i32 % 30 - 15);
            ((*seed >> 8) as i32 as f32) * exp2(-31) * size
        })
    }

    #[test]
    fn eight_doubles_are_what_each_is() {
        if !has_usual() {
            return;
        }
        let mut seed = 0x5EED;
        for _ in 0..1000 {
            let [a, b, c, d] = [(); 4].map(|()| numbers(&mut seed));
            // Numbers of more digits than floats, and what a double rounds from them.
            let each = |of: fn([f64; 4]) -> f64| {
                core::array::from_fn::<_, 8, _>(|i| {
                    let found = of([a[i], b[i], c[i], d[i]].map(f64::from));
                    [found as f32, (found - f64::from(found as f32)) as f32].map(f32::to_bits)
                })
            };
            let eight = |of: fn([Doubles; 4]) -> Doubles| {
                let found = of([&a, &b, &c, &d].map(|x| Doubles::of(<Eight as Sides>::of(x))));
                let hi = found.float();
                let (hi, lo) = (hi.numbers(), (found - Doubles::of(hi)).float().numbers());
                core::array::from_fn::<_, 8, _>(|i| [hi[i], lo[i]].map(f32::to_bits))
            };
            assert_eq!(eight(|[a, b, c, _]| a * b + c), each(|[a, b, c, _]| a * b + c));
            assert_eq!(eight(|[a, b, c, _]| -(a * b - c)), each(|[a, b, c, _]| -(a * b - c)));
            assert_eq!(eight(|[a, b, ..]| (a * b).size()), each(|[a, b, ..]| (a * b).abs()));
            assert_eq!(eight(|[a, ..]| a.inverse()), each(|[a, ..]| 1.0 / a));
            // Of products that are exact, a difference is rounded once.
            assert_eq!(
                eight(|[a, b, c, d]| Doubles::product_difference(a, b, c, d)),
                each(|[a, b, c, d]| a * b - c * d)
            );
            // Of others that cancel it keeps its digits.
            let cancelled = |[a, b, c, d]: [Doubles; 4]| {
                let (p, q) = (a * b, c * d);
                let r = q * Doubles::all(1.0 + f64::from(exp2(-30)));
                let right = p * (q - r);
                (Doubles::product_difference(p, q, r, p) - right, right * Doubles::all(f64::from(exp2(-51))))
            };
            let (off, most) = cancelled([&a, &b, &c, &d].map(|x| Doubles::of(<Eight as Sides>::of(x))));
            assert_eq!(<Eight as Sides>::bits(off.size().exceeds(most.size())), 0);
            let [x, y] = [[&a, &b], [&c, &d]]
                .map(|[a, b]| Doubles::of(<Eight as Sides>::of(a)) * Doubles::of(<Eight as Sides>::of(b)));
            let more = |i: usize| f64::from(a[i]) * f64::from(b[i]) > f64::from(c[i]) * f64::from(d[i]);
            let right = (0..8).fold(0, |bits, i| bits | u32::from(more(i)) << i);
            assert_eq!(<Eight as Sides>::bits(x.exceeds(y)), right);
        }
    }
}
