//! Eight numbers side by side, in a register of AVX2.
//!
//! All of it must be inlined into a function compiled for these instructions, which is called only where the processor
//! has them: see [`packet`](crate::trace::packet).

use crate::{
    glam::{UVec4, Vec4},
    math::{Digits, Number, Sides},
    mem::Buf,
};
use core::{
    arch::x86_64::*,
    ops::{Add, BitAnd, BitOr, Mul, Not, Sub},
};

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
}

impl Eight {
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
    fn head(self) -> Self {
        self.only(0xFFFF_F000)
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
            assert!(_mm256_testc_si256(inside, some) != 0, "a node's children in a buffer of {length} pairs");
            let word = |from: *const i32, rest: Self| {
                let rest = _mm256_castps_si256(rest.0);
                let words = _mm256_mask_i32gather_epi32::<8>(rest, from, numbers, some);
                Self(_mm256_castsi256_ps(words))
            };
            let start = start.cast::<i32>();
            (word(start, rest.0), word(start.add(1), rest.1))
        })
    }
}
