//! Exact building blocks: what `+ - *` and comparisons do not give.

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

/// Absolute value, by clearing the sign bit.
#[inline(always)]
pub fn abs(a: f32) -> f32 {
    f32::from_bits(a.to_bits() & 0x7FFF_FFFF)
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
    if field == 255 {
        a
    } else if field == 0 || moved <= 0 {
        f32::from_bits(sign)
    } else if moved >= 255 {
        f32::from_bits(sign | 0x7F80_0000)
    } else {
        f32::from_bits((bits & 0x807F_FFFF) | ((moved as u32) << 23))
    }
}

/// `a / b`, correctly rounded to nearest even where operands and result are normal numbers.
///
/// Vulkan's division may be off by 2.5 ULP. Here a quotient is estimated by `+ - *` and made exact in integers:
/// the remainder of a quotient that is off by a few units fits 32 bits although the product does not.
/// A result below the normal range is 0; `x / 0` is infinite for every non-zero `x`, and `0 / x` is 0.
/// Infinite and NaN operands are not supported.
#[inline]
pub fn div(a: f32, b: f32) -> f32 {
    let (bits_a, bits_b) = (a.to_bits(), b.to_bits());
    let sign = (bits_a ^ bits_b) & 0x8000_0000;
    let (exp_a, exp_b) = ((bits_a >> 23) & 0xFF, (bits_b >> 23) & 0xFF);
    let mant_a = (bits_a & 0x007F_FFFF) | 0x0080_0000;
    let mant_b = (bits_b & 0x007F_FFFF) | 0x0080_0000;
    // Reciprocal of b's mantissa, x in [1, 2): a chord, then three Newton steps; within 2^-22.
    let x = f32::from_bits(0x3F80_0000 | (bits_b & 0x007F_FFFF));
    let y = f32::from_bits(0x3F80_0000 | (bits_a & 0x007F_FFFF));
    let mut r = 1.411_764_7 - 0.470_588_24 * x;
    r = r * (2.0 - x * r);
    r = r * (2.0 - x * r);
    r = r * (2.0 - x * r);
    // q = floor(mant_a * 2^shift / mant_b) has 25 bits: 24 and one to round by.
    let smaller = (mant_a < mant_b) as u32;
    let shift = 24 + smaller;
    let mut q = (y * r * exp2(shift as i32)) as u32;
    let mut rem = (mant_a << shift).wrapping_sub(q.wrapping_mul(mant_b)) as i32;
    let step = (rem as f32 * (r * 1.192_092_9e-7)) as i32;
    q = q.wrapping_add(step as u32);
    rem = rem.wrapping_sub(step.wrapping_mul(mant_b as i32));
    let divisor = mant_b as i32;
    if rem < 0 {
        q -= 1;
        rem += divisor;
    }
    if rem < 0 {
        q -= 1;
        rem += divisor;
    }
    if rem >= divisor {
        q += 1;
        rem -= divisor;
    }
    if rem >= divisor {
        q += 1;
        rem -= divisor;
    }
    let half = q >> 1;
    let up = q & 1 & ((rem != 0) as u32 | (half & 1));
    let exp = exp_a as i32 - exp_b as i32 + 127 - smaller as i32;
    // Rounding up to 2^24 carries into the exponent by itself.
    let magnitude = ((exp as u32) << 23).wrapping_add(half - 0x0080_0000 + up);
    if exp_a == 0 {
        f32::from_bits(sign)
    } else if exp_b == 0 || exp >= 255 {
        f32::from_bits(sign | 0x7F80_0000)
    } else if exp <= 0 {
        f32::from_bits(sign)
    } else {
        f32::from_bits(sign | magnitude)
    }
}

/// The product of two 24-bit integers as `(high, low)` words of 24 bits.
#[inline(always)]
fn wide(a: u32, b: u32) -> (u32, u32) {
    let (ah, al, bh, bl) = (a >> 12, a & 0xFFF, b >> 12, b & 0xFFF);
    let middle = ah * bl + al * bh;
    let low = al * bl + ((middle & 0xFFF) << 12);
    (ah * bh + (middle >> 12) + (low >> 24), low & 0x00FF_FFFF)
}

/// How far a 48-bit number, not 0, must go up until its top bit is set.
#[inline(always)]
fn lift(high: u32, low: u32) -> u32 {
    if high != 0 { high.leading_zeros() - 8 } else { 24 + (low | 1).leading_zeros() - 8 }
}

/// A 48-bit number times `2^by`, `by < 48`.
#[inline(always)]
fn shift(high: u32, low: u32, by: u32) -> (u32, u32) {
    let (high, low, by) = if by >= 24 { (low, 0, by - 24) } else { (high, low, by) };
    ((high << by) | (low >> (24 - by)), (low << by) & 0x00FF_FFFF)
}

/// A number as an integer of 24 bits times `2^(e - 150)`.
#[inline(always)]
fn parts(a: f32) -> (u32, i32) {
    let field = (a.to_bits() >> 23) & 0xFF;
    let mant = a.to_bits() & 0x007F_FFFF;
    if field == 0 { (mant, 1) } else { (mant | 0x0080_0000, field as i32) }
}

/// `a * b - c * d` where the rounded products are equal: the sign is exact, the size within a factor of
/// `1 +- 2^-22`, but never below `floor`, a power of two. Zero only if the exact difference is.
///
/// Rounding is monotonic, so unequal rounded products already tell the sign; this settles the rest.
#[inline]
pub fn product_difference(a: f32, b: f32, c: f32, d: f32, floor: f32) -> f32 {
    let ((ma, ea), (mb, eb)) = (parts(a), parts(b));
    let ((mc, ec), (md, ed)) = (parts(c), parts(d));
    let (mut ph, mut pl) = wide(ma, mb);
    let (mut qh, mut ql) = wide(mc, md);
    let p_zero = (ph | pl) == 0;
    let q_zero = (qh | ql) == 0;
    let p_negative = ((a.to_bits() ^ b.to_bits()) >> 31) != 0;
    let q_negative = ((c.to_bits() ^ d.to_bits()) >> 31) != 0;
    // Bring both to one exponent. Equal rounded products are within a binade of each other unless they
    // underflow, and then only the sign matters; so a long shift may lose low bits.
    let (p_up, q_up) = (lift(ph, pl), lift(qh, ql));
    let (mut pe, mut qe) = (ea + eb - p_up as i32, ec + ed - q_up as i32);
    (ph, pl) = shift(ph, pl, p_up);
    (qh, ql) = shift(qh, ql, q_up);
    // One binade apart: double the larger one (25 bits in its high word are fine).
    if !p_zero && !q_zero && pe == qe + 1 {
        ph = (ph << 1) | (pl >> 23);
        pl = (pl << 1) & 0x00FF_FFFF;
        pe = qe;
    } else if !p_zero && !q_zero && qe == pe + 1 {
        qh = (qh << 1) | (ql >> 23);
        ql = (ql << 1) & 0x00FF_FFFF;
        qe = pe;
    }
    let p_greater = !p_zero && (q_zero || pe > qe || (pe == qe && (ph > qh || (ph == qh && pl > ql))));
    let equal = (p_zero && q_zero) || (!p_zero && !q_zero && pe == qe && ph == qh && pl == ql);
    let mut negative = if p_greater { p_negative } else { !q_negative };
    let mut size = floor;
    if p_negative == q_negative || p_zero || q_zero {
        if pe == qe && !p_zero && !q_zero {
            // Both fit: subtract the smaller from the larger, 24 bits a word.
            let (gh, gl) = if p_greater { (ph, pl) } else { (qh, ql) };
            let (sh, sl) = if p_greater { (qh, ql) } else { (ph, pl) };
            let borrow = (gl < sl) as u32;
            let low_word = (gl + (borrow << 24)) - sl;
            let high_word = gh - sh - borrow;
            let value = high_word as f32 * 16_777_216.0 + low_word as f32;
            size = high(ldexp(value, pe - 300), floor);
        }
    } else {
        // Opposite signs: both products underflowed.
        negative = p_negative;
    }
    if equal && (p_negative == q_negative || p_zero) {
        0.0
    } else if negative {
        -size
    } else {
        size
    }
}
