//! Exact building blocks: what `+ - *` and comparisons do not give.

use crate::{
    ON_GPU,
    glam::{BVec4A, Vec3, Vec4},
    mem::Slots,
};
#[cfg(target_arch = "x86_64")]
use crate::{glam::UVec4, mem::Buf};
use core::ops::{Add, BitAnd, BitOr, Mul, Neg, Not, Sub};

/// One number, or on a CPU several side by side.
pub trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// An answer to each.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask> + Not<Output = Self::Mask>;
    /// The same number everywhere.
    fn all(x: f32) -> Self;
    /// Whether it is larger.
    fn exceeds(self, other: Self) -> Self::Mask;
    /// Whether it is equal.
    fn is(self, other: Self) -> Self::Mask;
    /// `a` where the answer is yes, else `b`.
    fn choose(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Whether all answers are yes.
    fn every(mask: Self::Mask) -> bool;
}

/// Numbers that stand in tables of words.
pub trait Listed: Number {
    /// How many they are.
    const WIDTH: u32;
    /// `first`, `first + 1` and so on.
    fn numbers(first: u32) -> Self;
    /// Those whose bits stand at `i` and behind.
    fn bits<const N: usize>(words: &[u32; N], i: u32) -> Self;
    /// The counts, less than `2^31`, that stand there.
    fn counts<const N: usize>(words: &[u32; N], i: u32) -> Self;
    /// Puts their bits there.
    fn put<const N: usize>(self, words: &mut [u32; N], i: u32);
}

/// Numbers of which more than the order is known: what tracing needs.
pub trait Digits: Number + Neg<Output = Self> {
    /// Whether it is smaller.
    fn below(self, other: Self) -> Self::Mask;
    /// [`abs()`].
    fn abs(self) -> Self;
    /// [`two_product()`].
    fn two_product(self, other: Self) -> (Self, Self);
    /// [`is_small()`].
    fn is_small(self, floor: f32) -> Self::Mask;
    /// Two to the negative [`exponent()`].
    fn unit(self) -> Self;
    /// [`low()`].
    fn low(self, other: Self) -> Self;
    /// [`high()`].
    fn high(self, other: Self) -> Self;
    /// This size with the sign of another number.
    fn signed(self, sign: Self) -> Self;
    /// [`div()`], of several numbers only where operands and result are 0 or normal.
    fn over(self, divisor: Self) -> Self;
    /// [`div()`] of 1 by this, where both it and the result are normal.
    fn reciprocal(self) -> Self;
    /// The reciprocal of a number of size 1 to 2, within `2^-22`: for quotients that have bounds of their errors. Which
    /// of the numbers it is depends on the machine.
    #[inline(always)]
    fn inverse(self) -> Self {
        self.reciprocal()
    }
}

/// Eight numbers, one of each of eight rays.
#[cfg(target_arch = "x86_64")]
pub trait Sides: Digits {
    /// Which component of a vector each takes.
    type Turn: Copy;
    /// These.
    fn of(numbers: &[f32; 8]) -> Self;
    /// The components of eight vectors.
    fn columns(rows: &[Vec4; 8]) -> [Self; 4];
    /// One by one.
    fn numbers(self) -> [f32; 8];
    /// A bit an answer, the first lowest.
    fn bits(mask: Self::Mask) -> u32;
    /// The answers with these bits.
    fn mask(bits: u32) -> Self::Mask;
    /// The components with these numbers.
    fn turn(numbers: Self) -> Self::Turn;
    /// Of one vector, the component that each takes.
    fn turned(v: Vec4, turn: Self::Turn) -> Self;
    /// Whether nodes with these second words are leaves.
    fn leaves(tags: Self) -> Self::Mask;
    /// The numbers on the axes of inner nodes.
    fn on_axis(tags: Self, numbers: &[Self; 3]) -> Self;
    /// The numbers, as bits, of the children of inner nodes, those above the plane or those below.
    fn child(tags: Self, above: Self::Mask) -> Self;
    /// Both words of some nodes with these numbers, and for the rest what is given.
    fn nodes(pairs: &Buf<UVec4>, numbers: Self, some: Self::Mask, rest: (Self, Self)) -> (Self, Self);
}

/// Faces of boxes side by side, half of them low ones, half high ones of the same boxes.
pub trait Row: Number {
    /// Boxes in a row.
    const BOXES: u32;
    /// The first low ones and high ones of two lists of bits.
    fn of(lows: &[u32], highs: &[u32]) -> Self;
    /// `low`, `low + 1` and so on, then `high`, `high + 1` and so on.
    fn numbers(low: f32, high: f32) -> Self;
    /// How often answers were yes.
    type Tally: Copy;
    /// Never.
    fn never() -> Self::Tally;
    /// Once more where the answer is yes.
    fn once_more(tally: Self::Tally, mask: Self::Mask) -> Self::Tally;
    /// As numbers.
    fn times(tally: Self::Tally) -> Self;
    /// The smallest of them.
    fn smallest(self) -> f32;
}

impl Number for f32 {
    type Mask = bool;
    #[inline(always)]
    fn all(x: f32) -> Self {
        x
    }
    #[inline(always)]
    fn exceeds(self, other: Self) -> bool {
        self > other
    }
    #[inline(always)]
    fn is(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn choose(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn every(mask: bool) -> bool {
        mask
    }
}

impl Listed for f32 {
    const WIDTH: u32 = 1;
    #[inline(always)]
    fn numbers(first: u32) -> Self {
        first as f32
    }
    #[inline(always)]
    fn bits<const N: usize>(words: &[u32; N], i: u32) -> Self {
        Self::from_bits(words.at(i))
    }
    #[inline(always)]
    fn counts<const N: usize>(words: &[u32; N], i: u32) -> Self {
        words.at(i) as f32
    }
    #[inline(always)]
    fn put<const N: usize>(self, words: &mut [u32; N], i: u32) {
        words.put(i, self.to_bits());
    }
}

impl Digits for f32 {
    #[inline(always)]
    fn below(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn abs(self) -> Self {
        abs(self)
    }
    #[inline(always)]
    fn two_product(self, other: Self) -> (Self, Self) {
        two_product(self, other)
    }
    #[inline(always)]
    fn is_small(self, floor: f32) -> bool {
        is_small(self, floor)
    }
    #[inline(always)]
    fn unit(self) -> Self {
        exp2(-exponent(self))
    }
    #[inline(always)]
    fn low(self, other: Self) -> Self {
        low(self, other)
    }
    #[inline(always)]
    fn high(self, other: Self) -> Self {
        high(self, other)
    }
    #[inline(always)]
    fn signed(self, sign: Self) -> Self {
        Self::from_bits((sign.to_bits() & 0x8000_0000) | self.to_bits())
    }
    #[inline(always)]
    fn over(self, divisor: Self) -> Self {
        div(self, divisor)
    }
    #[inline(always)]
    fn reciprocal(self) -> Self {
        if ON_GPU { rounded_reciprocal(self) } else { 1.0 / self }
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        if ON_GPU { near_inverse(abs(self)).signed(self) } else { self.reciprocal() }
    }
}

impl Number for Vec4 {
    type Mask = BVec4A;
    #[inline(always)]
    fn all(x: f32) -> Self {
        Self::splat(x)
    }
    #[inline(always)]
    fn exceeds(self, other: Self) -> Self::Mask {
        self.cmpgt(other)
    }
    #[inline(always)]
    fn is(self, other: Self) -> Self::Mask {
        self.cmpeq(other)
    }
    #[inline(always)]
    fn choose(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self::select(mask, a, b)
    }
    #[inline(always)]
    fn every(mask: Self::Mask) -> bool {
        mask.all()
    }
}

impl Listed for Vec4 {
    const WIDTH: u32 = 4;
    #[inline(always)]
    fn numbers(first: u32) -> Self {
        Self::new(0.0, 1.0, 2.0, 3.0) + first as f32
    }
    #[inline(always)]
    fn bits<const N: usize>(words: &[u32; N], i: u32) -> Self {
        Self::from_array(four(words, i).map(f32::from_bits))
    }
    #[inline(always)]
    fn counts<const N: usize>(words: &[u32; N], i: u32) -> Self {
        // Processors convert numbers with a sign.
        Self::from_array(four(words, i).map(|n| n as i32 as f32))
    }
    #[inline(always)]
    fn put<const N: usize>(self, words: &mut [u32; N], i: u32) {
        words[i as usize..i as usize + 4].copy_from_slice(&self.to_array().map(f32::to_bits));
    }
}

impl Row for Vec4 {
    const BOXES: u32 = 2;
    #[inline(always)]
    fn of(lows: &[u32], highs: &[u32]) -> Self {
        Self::from_array([lows[0], lows[1], highs[0], highs[1]].map(f32::from_bits))
    }
    #[inline(always)]
    fn numbers(low: f32, high: f32) -> Self {
        Self::new(low, low + 1.0, high, high + 1.0)
    }
    type Tally = Self;
    #[inline(always)]
    fn never() -> Self {
        Self::ZERO
    }
    #[inline(always)]
    fn once_more(tally: Self, mask: BVec4A) -> Self {
        tally + Self::select(mask, Self::ONE, Self::ZERO)
    }
    #[inline(always)]
    fn times(tally: Self) -> Self {
        tally
    }
    #[inline(always)]
    fn smallest(self) -> f32 {
        self.min_element()
    }
}

/// How many numbers a lane computes with side by side: a GPU has lanes enough.
#[cfg(target_arch = "spirv")]
pub type Wide = f32;
/// How many numbers a lane computes with side by side: a CPU, which runs the lanes in turn, four.
#[cfg(not(target_arch = "spirv"))]
pub type Wide = Vec4;

/// Four words.
#[inline(always)]
fn four<const N: usize>(words: &[u32; N], i: u32) -> [u32; 4] {
    let mut four = [0; 4];
    four.copy_from_slice(&words[i as usize..i as usize + 4]);
    four
}

/// One of the first three numbers. A GPU selects; a CPU, where that would be a jump table, takes it from
/// memory, and has a fourth so that no tag is out of range.
#[inline(always)]
fn on_axis(numbers: &[f32; 4], axis: u32) -> f32 {
    if !ON_GPU {
        numbers[axis as usize & 3]
    } else if axis == 0 {
        numbers[0]
    } else if axis == 1 {
        numbers[1]
    } else {
        numbers[2]
    }
}

/// The component of a vector on an axis.
#[inline(always)]
pub fn component(v: Vec3, axis: u32) -> f32 {
    on_axis(&[v.x, v.y, v.z, 0.0], axis)
}

/// The components of a vector, one to be taken again and again by an axis that changes: a CPU keeps them in
/// memory.
#[derive(Clone, Copy, Debug)]
pub struct ByAxis([f32; 4]);

impl ByAxis {
    /// Those of `v`.
    #[inline(always)]
    pub fn new(v: Vec3) -> Self {
        Self([v.x, v.y, v.z, 0.0])
    }

    /// The one on an axis.
    #[inline(always)]
    pub fn on(&self, axis: u32) -> f32 {
        on_axis(&self.0, axis)
    }
}

/// A vector with `axis` moved last, the others in cyclic order.
#[inline(always)]
pub fn cycle(v: Vec3, axis: u32) -> Vec3 {
    if axis == 0 {
        Vec3::new(v.y, v.z, v.x)
    } else if axis == 1 {
        Vec3::new(v.z, v.x, v.y)
    } else {
        v
    }
}

/// A vector whose component on `axis` has changed places with the last.
#[inline(always)]
pub fn exchange(v: Vec3, axis: u32) -> Vec3 {
    Vec3::new(if axis == 0 { v.z } else { v.x }, if axis == 1 { v.z } else { v.y }, component(v, axis))
}

/// The smaller of two numbers (`a` if they are equal).
#[inline(always)]
pub fn low(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// The larger of two numbers (`a` if they are equal).
#[inline(always)]
pub fn high(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// [`high`] where neither a zero's sign nor what is no number matters: one instruction of a GPU.
#[inline(always)]
pub(crate) fn higher(a: f32, b: f32) -> f32 {
    #[cfg(target_arch = "spirv")]
    return chosen!("40", a, b);
    #[cfg(not(target_arch = "spirv"))]
    high(a, b)
}

/// [`low`] where neither a zero's sign nor what is no number matters: one instruction of a GPU.
#[inline(always)]
pub(crate) fn lower(a: f32, b: f32) -> f32 {
    #[cfg(target_arch = "spirv")]
    return chosen!("37", a, b);
    #[cfg(not(target_arch = "spirv"))]
    low(a, b)
}

/// An instruction of the extended set for two numbers: `FMax` is number 40, `FMin` 37. `f32::max` and `f32::min` become
/// branches.
#[cfg(target_arch = "spirv")]
macro_rules! chosen {
    ($number:literal, $a:expr, $b:expr) => {{
        let (a, b, chosen): (f32, f32, f32);
        (a, b) = ($a, $b);
        // SAFETY: the instruction takes two numbers and gives one.
        unsafe {
            core::arch::asm!(
                "%glsl = OpExtInstImport \"GLSL.std.450\"",
                "%float = OpTypeFloat 32",
                concat!("{chosen} = OpExtInst %float %glsl ", $number, " {a} {b}"),
                a = in(reg) a,
                b = in(reg) b,
                chosen = out(reg) chosen,
            );
        }
        chosen
    }};
}
#[cfg(target_arch = "spirv")]
use chosen;

/// `a * b + c` with one rounding or two, as a device likes: for bounds that have room for both, never for results.
#[inline(always)]
pub(crate) fn about(a: f32, b: f32, c: f32) -> f32 {
    #[cfg(target_arch = "spirv")]
    return spirv_std::num_traits::Float::mul_add(a, b, c);
    #[cfg(not(target_arch = "spirv"))]
    {
        a * b + c
    }
}

/// The smallest of three.
#[inline(always)]
pub(crate) fn least<N: Digits>(a: N, b: N, c: N) -> N {
    a.low(b.low(c))
}

/// The largest of three.
#[inline(always)]
pub(crate) fn most<N: Digits>(a: N, b: N, c: N) -> N {
    a.high(b.high(c))
}

/// The whole part of a number, held to the range from 0 to `MOST`; 0 for NaN.
#[inline(always)]
pub fn whole<const MOST: u32>(a: f32) -> u32 {
    const { assert!(MOST < 1 << 24, "exact in 32 bits") };
    let held = low(high(0.0, a), MOST as f32);
    if ON_GPU {
        return held as u32;
    }
    // What `as` does for numbers out of range takes a CPU longer than the conversion. SAFETY: `high` leaves
    // no NaN, as no comparison with one holds, and `low` nothing above `MOST`, which fits.
    unsafe { held.to_int_unchecked::<i32>() as u32 }
}

/// A mask of the lowest `n` bits, `n <= 32`.
#[inline(always)]
pub fn ones(n: u32) -> u32 {
    if n >= 32 { u32::MAX } else { (1 << n) - 1 }
}

/// Absolute value.
#[inline(always)]
pub fn abs(a: f32) -> f32 {
    a.abs()
}

/// Whether a number is not 0, but smaller than `floor` in size.
#[inline(always)]
pub const fn is_small(a: f32, floor: f32) -> bool {
    // 0 wraps around.
    (a.to_bits() << 1).wrapping_sub(1) < (floor.to_bits() << 1) - 1
}

/// Whether this is no number, by its bits.
#[inline(always)]
pub fn is_nan(a: f32) -> bool {
    a.to_bits() & 0x7FFF_FFFF > 0x7F80_0000
}

/// `2^e` for `-126 <= e <= 127`.
#[inline(always)]
pub const fn exp2(e: i32) -> f32 {
    f32::from_bits(((e + 127) as u32) << 23)
}

/// Exponent of a normal number: `2^e <= |a| < 2^(e+1)`; -127 for zero and subnormals, 128 for the rest.
#[inline(always)]
pub fn exponent(a: f32) -> i32 {
    ((a.to_bits() >> 23) & 0xFF) as i32 - 127
}

/// `a * 2^e`, exact while the result is normal; larger becomes infinite, smaller becomes 0, and so does a
/// subnormal `a`: results never depend on whether a device keeps subnormals.
#[inline]
pub fn ldexp(a: f32, e: i32) -> f32 {
    let bits = a.to_bits();
    let sign = bits & 0x8000_0000;
    let field = ((bits >> 23) & 0xFF) as i32;
    let moved = field + e;
    let size = if moved >= 255 { sign | INFINITE } else { bits.wrapping_add((e as u32) << 23) };
    let number = if (field == 0) | (moved <= 0) { sign } else { size };
    f32::from_bits(if field == 255 { bits } else { number })
}

/// `a / b`, correctly rounded to nearest even where operands and result are normal numbers.
///
/// A result below the normal range is 0; `x / 0` is infinite for every non-zero `x`, and `0 / x` is 0.
/// Infinite and NaN operands are not supported.
#[inline(always)]
pub fn div(a: f32, b: f32) -> f32 {
    // A CPU's own division rounds correctly; what is not normal it treats otherwise.
    if !ON_GPU {
        let quotient = a / b;
        if a.is_normal() && b.is_normal() && abs(quotient) > f32::MIN_POSITIVE {
            return quotient;
        }
    }
    quotient(a, b)
}

/// The reciprocal of a number from 1 to 2, within `2^-22`: by a chord, then three Newton steps.
#[inline(always)]
fn near_inverse(x: f32) -> f32 {
    let mut r = 1.411_764_7 - 0.470_588_24 * x;
    r = r * (2.0 - x * r);
    r = r * (2.0 - x * r);
    r * (2.0 - x * r)
}

/// [`div`] without a division: Vulkan's may be off by 2.5 ULP. The quotient is estimated by `+ - *`, and corrected by
/// what it leaves of the dividend, which is exact (Markstein 1990).
///
/// After the first correction the quotient is off by little more than half of a last digit, so what it leaves has 24
/// digits, and comparing that with half of a last digit of the divisor rounds. There is no tie: an odd number of 25
/// digits times the divisor has more than 24.
// A CPU needs it seldom, and a page loads every copy.
#[cfg_attr(target_arch = "spirv", inline)]
#[cfg_attr(not(target_arch = "spirv"), cold, inline(never))]
pub fn quotient(a: f32, b: f32) -> f32 {
    let sign = (a.to_bits() ^ b.to_bits()) & 0x8000_0000;
    let (exp_a, exp_b) = (exponent_bits(a) >> 23, exponent_bits(b) >> 23);
    // Both from 1 to 2, their quotient from 1/2 to 2.
    let (y, x) = (mantissa(a), mantissa(b));
    let q = rounded_quotient(y, x);
    let exp = exp_a as i32 - exp_b as i32 + 127 - (y < x) as i32;
    let magnitude = q.to_bits().wrapping_add((exp_a << 23).wrapping_sub(exp_b << 23));
    let infinite = (exp_b == 0) | (exp >= 255);
    let zero = (exp_a == 0) | (!infinite & (exp <= 0));
    let size = if infinite { INFINITE } else { magnitude };
    f32::from_bits(sign | if zero { 0 } else { size })
}

/// The bits of infinity.
const INFINITE: u32 = 0x7F80_0000;

/// The bits of a number that are its exponent's.
#[inline(always)]
pub fn exponent_bits(a: f32) -> u32 {
    a.to_bits() & INFINITE
}

/// The size of a normal number, times a power of two by which that is from 1 to 2.
#[inline(always)]
fn mantissa(a: f32) -> f32 {
    f32::from_bits(0x3F80_0000 | (a.to_bits() & 0x007F_FFFF))
}

/// The quotient of two numbers from 1 to 2.
#[inline(always)]
fn rounded_quotient(y: f32, x: f32) -> f32 {
    let r = near_inverse(x);
    let q = y * r;
    let q = q + left_by(y, q, x) * r;
    let left = left_by(y, q, x);
    // Its last digit. From 1 on that is twice as large, but none is rounded to 1 that is not 1.
    let digit = if q >= 1.0 { exp2(-23) } else { exp2(-24) };
    let half = 0.5 * digit * x;
    let up = if left > half { digit } else { 0.0 };
    let down = if left < -half { digit } else { 0.0 };
    (q + up) - down
}

/// [`quotient`] of 1 and a number, where both that and the result are normal.
#[inline(always)]
fn rounded_reciprocal(a: f32) -> f32 {
    let size = rounded_quotient(1.0, mantissa(a)).to_bits();
    f32::from_bits(size.wrapping_add(exp2(0).to_bits()).wrapping_sub(exponent_bits(a))).signed(a)
}

/// What a quotient close to `a / b` leaves of `a`.
#[inline(always)]
fn left_by(a: f32, quotient: f32, b: f32) -> f32 {
    let (product, rest) = two_product(quotient, b);
    (a - product) - rest
}

/// `a / b` within `4.5 * 2^-24` of its size, by `+ - *`: much less work for a GPU than [`div`]. For normal `b` of less
/// than `2^125` in size.
#[inline(always)]
pub fn ratio(a: f32, b: f32) -> f32 {
    let bits = b.to_bits();
    // A reciprocal within 2^-4, whose error three Newton steps square until only their rounding is left.
    let guess = 0x7EF3_11C7_u32.wrapping_sub(bits & 0x7FFF_FFFF);
    let mut r = f32::from_bits((bits & 0x8000_0000) | guess);
    r = r * (2.0 - b * r);
    r = r * (2.0 - b * r);
    r = r * (2.0 - b * r);
    a * r
}

/// The upper half of a number's 24 digits; what it leaves is the lower half.
#[inline(always)]
fn head(a: f32) -> f32 {
    f32::from_bits(a.to_bits() & 0xFFFF_F000)
}

/// Stands for whether the device rounds a product and a sum once, as `fma` may: `raykd-spirv` puts a specialization
/// constant in place of `fma` of three of these, which the host sets to 1 where the start-up probe finds that it does.
/// The sum itself is negative, so without either the answer is no.
#[cfg(target_arch = "spirv")]
const ROUNDS_ONCE: f32 = f32::from_bits(0xBED1_0F3A);

/// `rest`, which is `a * b` less a `product`, rounded. A device that rounds once finds that by one instruction.
#[cfg(target_arch = "spirv")]
#[inline(always)]
pub(crate) fn left_of<F: spirv_std::num_traits::Float>(a: F, b: F, product: F, rest: F) -> F {
    use spirv_std::num_traits::Float as _;
    let once = a.mul_add(b, -product);
    if ROUNDS_ONCE.mul_add(ROUNDS_ONCE, ROUNDS_ONCE) > 0.0 { once } else { rest }
}
#[cfg(not(target_arch = "spirv"))]
#[inline(always)]
pub(crate) fn left_of<F>(_a: F, _b: F, _product: F, rest: F) -> F {
    rest
}

/// `a * b`, and exactly what rounding took from it (Dekker 1971, with halves cut instead of rounded), for
/// products that are 0 by a factor or at least `2^-78` in size.
#[inline(always)]
pub fn two_product(a: f32, b: f32) -> (f32, f32) {
    let product = a * b;
    let (ah, bh) = (head(a), head(b));
    let (al, bl) = (a - ah, b - bh);
    // Nothing left is a positive zero in either form.
    let rest = (((ah * bh - product) + al * bh) + ah * bl) + al * bl;
    (product, left_of(a, b, product, rest))
}

/// `a * b - c * d` within `2^-22` of its size, with an exact sign, 0 only if it is; for products as in
/// [`two_product`].
///
/// If the rounded products are within a factor of two, their difference is exact (Sterbenz), and so is that
/// of the two rounding errors, which share a grid of 24 bits; else nothing cancels.
#[inline(always)]
pub fn product_difference<N: Digits>(a: N, b: N, c: N, d: N) -> N {
    let ((p, p_error), (q, q_error)) = (a.two_product(b), c.two_product(d));
    (p - q) + (p_error - q_error)
}

/// A number as one of size 1 to 2 times a power of two. Subnormals count as 0.
#[inline(always)]
fn parts(a: f32) -> (f32, i32) {
    let e = exponent(a);
    if e == -127 { (0.0, OF_ZERO) } else { (f32::from_bits((a.to_bits() & 0x807F_FFFF) | 0x3F80_0000), e) }
}

/// The exponent of 0: less than any sum of two others.
const OF_ZERO: i32 = -1000;

/// [`product_difference`] for all normal numbers: 0, or a number of size 1 to 2 times two to the second.
#[inline(always)]
pub fn product_difference_wide(a: f32, b: f32, c: f32, d: f32) -> (f32, i32) {
    let ((a, ea), (b, eb), (c, ec), (d, ed)) = (parts(a), parts(b), parts(c), parts(d));
    let ((p, p_error), (q, q_error)) = (two_product(a, b), two_product(c, d));
    let (ep, eq) = (ea + eb, ec + ed);
    let top = if ep > eq { ep } else { eq };
    // So much smaller than the other product, it changes neither sign nor size by what counts.
    let (x, y) = (power(ep - top), power(eq - top));
    // Products that cancel leave less than `top` says, or nothing.
    let (rest, own) = parts((p * x - q * y) + (p_error * x - q_error * y));
    (rest, top + own)
}

/// `2^e`, or 0 below `2^-60`.
#[inline(always)]
fn power(e: i32) -> f32 {
    if e < -60 { 0.0 } else { exp2(e) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_inverses_are_near() {
        for bits in (0..=1 << 23).step_by(5) {
            let x = f32::from_bits(exp2(0).to_bits() + bits);
            let off = f64::from(near_inverse(x)) * f64::from(x) - 1.0;
            assert!(off.abs() <= f64::from(exp2(-22)), "{x}: {off}");
        }
    }

    #[test]
    fn reciprocals_are_rounded_correctly() {
        for mantissa in 0..1 << 23 {
            // From 2^-126 to 2^125.
            let exponent = 1 + mantissa % 252;
            let a = f32::from_bits((mantissa & 1) << 31 | exponent << 23 | mantissa);
            assert_eq!(rounded_reciprocal(a).to_bits(), (1.0 / a).to_bits(), "{a:e}");
        }
    }
}
