//! A ray against a triangle in integers: exact whatever the numbers, and a hundred times slower than in floats.
//!
//! Every float is a multiple of a power of two, the *grid*. Corners seen from the origin, and the direction,
//! become integers of as many digits as the numbers at hand need, of 16 bits each so that products of digits
//! fit a word. Four determinants decide: `D = d . (b x c) + d . (c x a) + d . (a x b)`, whose parts are the
//! weights, and `N = a . (b x c)`; then `t = N / D` (the volumes of Möller & Trumbore 1997, undivided).
//! Quotients are rounded once.

use crate::{
    glam::Vec3,
    math::{component, exponent},
    mem::{Slots, scratch},
    trace::frame::HEADING,
};

/// Digits of a coordinate: the whole range of normal `f32`, and a bit for differences.
const WIDTH: u32 = 18;
/// Digits of a determinant.
const LONG: u32 = 3 * WIDTH + 1;
/// Where numbers lie: x, y, z of the direction and of the corners `a`, `b`, `c`; a component of a cross
/// product; three weights and the volume; two numbers to be divided.
const CROSS: u32 = 12 * WIDTH;
const DETERMINANTS: u32 = CROSS + 2 * WIDTH;
const DIVIDEND: u32 = DETERMINANTS + 4 * LONG;
const DIVISOR: u32 = DIVIDEND + LONG;
const WORDS: usize = (DIVISOR + LONG) as usize;

/// Numbers of digits of 16 bits, lowest first, negative ones in two's complement.
type Digits = [u32; WORDS];

/// What [`cross`] found.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// Whether the line passes through the closed triangle, and not in its plane.
    pub hit: bool,
    /// Correctly rounded, as are the weights; 0 below the normal range, infinite beyond it.
    pub t: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third.
    pub v: f32,
    /// False if a driver left a loop early: nothing counts then.
    pub whole: bool,
}

/// The least exponent of a number that is not 0, and the largest.
#[inline(always)]
fn widen(range: (i32, i32), v: Vec3) -> (i32, i32) {
    let (mut lo, mut hi) = range;
    let mut axis = 0;
    while axis < 3 {
        let e = exponent(component(v, axis));
        if e > -127 {
            lo = if e < lo { e } else { lo };
            hi = if e > hi { e } else { hi };
        }
        axis += 1;
    }
    (lo, hi)
}

/// How many digits hold sums of two numbers of such exponents and a sign, at most [`WIDTH`].
#[inline(always)]
fn digits((lo, hi): (i32, i32)) -> u32 {
    let n = (hi - lo + 23 + 3 + 15) as u32 / 16;
    if n > WIDTH { WIDTH } else { n }
}

/// Adds a float, in units of `2^grid`, to the number of `n` digits from `base`; takes it if `minus`.
#[inline(always)]
fn add_float(m: &mut Digits, base: u32, n: u32, x: f32, grid: i32, minus: bool) {
    let e = exponent(x);
    let mantissa = if e == -127 { 0 } else { (x.to_bits() & 0x007F_FFFF) | 0x0080_0000 };
    let shift = if e == -127 { 0 } else { (e - 23 - grid) as u32 };
    let first = shift >> 4;
    let low = (mantissa & 0xFFFF) << (shift & 15);
    let high = ((mantissa >> 16) << (shift & 15)) + (low >> 16);
    let negative = (x.to_bits() >> 31 != 0) != minus;
    let mut carry = 0;
    let mut i = first;
    while i < n {
        let digit = if i == first {
            low & 0xFFFF
        } else if i == first + 1 {
            high & 0xFFFF
        } else if i == first + 2 {
            high >> 16
        } else {
            0
        };
        carry = accumulate(m, base + i, digit + carry, negative);
        i += 1;
    }
}

/// Adds a value of up to 17 bits to a digit, or takes it; returns what to carry.
#[inline(always)]
fn accumulate(m: &mut Digits, i: u32, value: u32, negative: bool) -> u32 {
    let old = m.at(i);
    let new = if negative { old.wrapping_sub(value) } else { old + value };
    m.put(i, new & 0xFFFF);
    // The borrow, if negative: bits 16 and up are 0, or all ones, or all but one.
    if negative { (new >> 16).wrapping_neg() & 0xFFFF } else { new >> 16 }
}

/// Sets `n` digits to 0.
#[inline(always)]
fn clear(m: &mut Digits, base: u32, n: u32) {
    let mut i = base;
    while i < base + n {
        m.put(i, 0);
        i += 1;
    }
}

/// Makes a number positive; whether it was negative.
#[inline(always)]
fn settle(m: &mut Digits, base: u32, n: u32) -> bool {
    let negative = m.at(base + n - 1) >> 15 != 0;
    if negative {
        let mut carry = 1;
        let mut i = base;
        while i < base + n {
            let digit = (m.at(i) ^ 0xFFFF) + carry;
            m.put(i, digit & 0xFFFF);
            carry = digit >> 16;
            i += 1;
        }
    }
    negative
}

/// Whether a number is not 0.
#[inline(always)]
fn is_some(m: &Digits, base: u32, n: u32) -> bool {
    let mut any = 0;
    let mut i = base;
    while i < base + n {
        any |= m.at(i);
        i += 1;
    }
    any != 0
}

/// Adds the product of two positive numbers to the `n` digits from `base`, or takes it.
#[inline(always)]
fn multiply(m: &mut Digits, base: u32, n: u32, (x, nx): (u32, u32), (y, ny): (u32, u32), negative: bool) {
    let mut i = 0;
    while i < nx {
        let factor = m.at(x + i);
        if factor != 0 {
            let mut carry = 0;
            let mut j = 0;
            // Past the product's digits only what is carried.
            while i + j < n && (j < ny || carry != 0) {
                let digit = if j < ny { m.at(y + j) } else { 0 };
                let product = factor * digit + carry;
                carry = (product >> 16) + accumulate(m, base + i + j, product & 0xFFFF, negative);
                j += 1;
            }
        }
        i += 1;
    }
}

/// Moves a positive number up until its top bit is set; by how many bits.
#[inline(always)]
fn justify(m: &mut Digits, base: u32, n: u32) -> i32 {
    let mut top = n - 1;
    while top > 0 && m.at(base + top) == 0 {
        top -= 1;
    }
    // The exponent of a digit is that of the float it is.
    let bits = (15 - exponent(m.at(base + top) as f32)) as u32;
    let away = n - 1 - top;
    let mut i = n;
    while i > 0 {
        i -= 1;
        let upper = if i >= away { m.at(base + i - away) } else { 0 };
        let lower = if i > away { m.at(base + i - away - 1) } else { 0 };
        m.put(base + i, ((upper << bits) & 0xFFFF) | (lower >> (16 - bits)));
    }
    (16 * away + bits) as i32
}

/// The positive number of `n` digits from `base` over that from [`DIVISOR`], which was moved up by `moved`,
/// times `2^e`, rounded to nearest even. Schoolbook division (Knuth 1969, algorithm D) to 32 bits and a
/// remainder.
#[inline(always)]
fn quotient(m: &mut Digits, base: u32, n: u32, moved: i32, e: i32) -> f32 {
    let mut i = 0;
    while i < n {
        m.put(DIVIDEND + i, m.at(base + i));
        i += 1;
    }
    if !is_some(m, DIVIDEND, n) {
        return 0.0;
    }
    let e = e + moved - justify(m, DIVIDEND, n);
    // Its top bit is set; if a driver left loops early it might not be, and division by 0 would end the
    // kernel unseen.
    let top = m.at(DIVISOR + n - 1) | 0x8000;
    // First whether it goes in once, then two digits.
    let (mut one, mut word, mut over) = (0, 0, 0);
    let mut round = 0;
    while round < 3 {
        let estimate = ((over << 16) | m.at(DIVIDEND + n - 1)) / top;
        let mut digit = if estimate > 0xFFFF { 0xFFFF } else { estimate };
        let mut carry = 0;
        i = 0;
        while i < n {
            let product = digit * m.at(DIVISOR + i) + carry;
            carry = (product >> 16) + accumulate(m, DIVIDEND + i, product & 0xFFFF, true);
            i += 1;
        }
        // An estimate by one digit is at most two too large.
        let mut left = over as i32 - carry as i32;
        while left < 0 {
            digit -= 1;
            carry = 0;
            i = 0;
            while i < n {
                carry = accumulate(m, DIVIDEND + i, m.at(DIVISOR + i) + carry, false);
                i += 1;
            }
            left += carry as i32;
        }
        if round == 0 {
            one = digit;
        } else {
            word = (word << 16) | digit;
        }
        round += 1;
        if round < 3 {
            // The next digit comes in from below, and there it is 0.
            over = m.at(DIVIDEND + n - 1);
            i = n - 1;
            while i > 0 {
                m.put(DIVIDEND + i, m.at(DIVIDEND + i - 1));
                i -= 1;
            }
            m.put(DIVIDEND, 0);
        }
    }
    let rest = is_some(m, DIVIDEND, n) as u32;
    // Of 33 or 32 bits, 24 and one to round by; the quotient of two such numbers is above a half.
    let drop = 8 + one;
    let mantissa = ((one << 31) | (word >> 1)) >> (drop - 1);
    let below = word & ((1 << drop) - 1);
    let half = 1 << (drop - 1);
    let sticky = (below & (half - 1)) | rest | (mantissa & 1);
    let up = (below & half != 0 && sticky != 0) as u32;
    let field = e + 126 + one as i32;
    if field < 0 {
        0.0
    } else if field >= 255 {
        f32::INFINITY
    } else {
        let bits = ((field as u32) << 23) + (mantissa - 0x0080_0000) + up;
        // Just below the normal range it may be rounded up into it.
        f32::from_bits(if bits < 0x0080_0000 { 0 } else { bits })
    }
}

/// How the numbers at hand are written down.
#[derive(Clone, Copy)]
struct Scale {
    /// Digits of a coordinate, and the power of two that its lowest bit stands for.
    places: (u32, i32),
    /// The same of the direction's.
    ways: (u32, i32),
    /// Digits of a determinant.
    long: u32,
}

impl Scale {
    #[inline(always)]
    fn new(origin: Vec3, d: Vec3, a: Vec3, b: Vec3, c: Vec3) -> Self {
        let none = (127, -127);
        let places = widen(widen(widen(widen(none, origin), a), b), c);
        let ways = widen(none, d);
        let (n, nd) = (digits(places), digits(ways));
        let widest = if nd > n { nd } else { n };
        Self { places: (n, places.0 - 23), ways: (nd, ways.0 - 23), long: widest + 2 * n + 1 }
    }
}

/// Where the component of a row on an axis stands: of the direction, then of the corners.
#[inline(always)]
fn place(row: u32, axis: u32) -> u32 {
    (3 * row + axis) * WIDTH
}

/// Writes the sizes of the twelve coordinates; a bit for each that is negative.
#[inline(always)]
fn put_coordinates(m: &mut Digits, scale: Scale, origin: Vec3, d: Vec3, a: Vec3, b: Vec3, c: Vec3) -> u32 {
    let mut signs = 0u32;
    let mut i = 0;
    while i < 12 {
        let (base, row, axis) = (i * WIDTH, i / 3, i % 3);
        let v = if row == 0 {
            d
        } else if row == 1 {
            a
        } else if row == 2 {
            b
        } else {
            c
        };
        let (x, from) = (component(v, axis), component(origin, axis));
        let (n, grid) = if row == 0 { scale.ways } else { scale.places };
        clear(m, base, n);
        add_float(m, base, n, x, grid, false);
        add_float(m, base, n, if row == 0 { 0.0 } else { from }, grid, true);
        signs |= (settle(m, base, n) as u32) << i;
        i += 1;
    }
    signs
}

/// The rows of determinant `det`, which is the first times the cross product of the others: `d . (b x c)`, `d
/// . (c x a)`, `d . (a x b)`, `a . (b x c)`.
#[inline(always)]
fn rows(det: u32) -> (u32, u32, u32) {
    (
        if det == 3 { 1 } else { 0 },
        if det == 1 {
            3
        } else if det == 2 {
            1
        } else {
            2
        },
        if det == 1 {
            1
        } else if det == 2 {
            2
        } else {
            3
        },
    )
}

/// Adds the component on `axis` of the cross product of two rows, or takes it, to the number of `n` digits from `base`.
/// Rows come with their digits, `signs` as of [`put_coordinates`].
#[inline(always)]
fn add_cross(
    m: &mut Digits,
    base: u32,
    n: u32,
    axis: u32,
    (y, ny): (u32, u32),
    (z, nz): (u32, u32),
    signs: u32,
    minus: bool,
) {
    let j = if axis == 2 { 0 } else { axis + 1 };
    let k = if axis == 0 { 2 } else { axis - 1 };
    let odd = move |p: u32, q: u32| (((signs >> (3 * y + p)) ^ (signs >> (3 * z + q))) & 1 != 0) != minus;
    multiply(m, base, n, (place(y, j), ny), (place(z, k), nz), odd(j, k));
    multiply(m, base, n, (place(y, k), ny), (place(z, j), nz), !odd(k, j));
}

/// Writes the four determinants, with their signs.
#[inline(always)]
fn put_determinants(m: &mut Digits, scale: Scale, signs: u32) {
    let (n, long) = (scale.places.0, scale.long);
    let mut det = 0;
    while det < 4 {
        let (x, y, z) = rows(det);
        let to = DETERMINANTS + det * LONG;
        clear(m, to, long);
        let mut axis = 0;
        while axis < 3 {
            clear(m, CROSS, 2 * n);
            add_cross(m, CROSS, 2 * n, axis, (y, n), (z, n), signs, false);
            let negative = settle(m, CROSS, 2 * n) != ((signs >> (3 * x + axis)) & 1 != 0);
            let nx = if x == 0 { scale.ways.0 } else { n };
            multiply(m, to, long, (place(x, axis), nx), (CROSS, 2 * n), negative);
            axis += 1;
        }
        det += 1;
    }
}

/// Writes the sum of the weights, the first three determinants, as divisor.
#[inline(always)]
fn put_sum(m: &mut Digits, long: u32) {
    clear(m, DIVISOR, long);
    let mut det = 0;
    while det < 3 {
        let mut carry = 0;
        let mut i = 0;
        while i < long {
            let digit = m.at(DETERMINANTS + det * LONG + i);
            carry = accumulate(m, DIVISOR + i, digit + carry, false);
            i += 1;
        }
        det += 1;
    }
}

/// Writes coordinates, determinants and divisor; how they are written down, and what [`put_coordinates`] tells.
#[inline(always)]
fn put_all(m: &mut Digits, origin: Vec3, d: Vec3, a: Vec3, b: Vec3, c: Vec3) -> (Scale, u32) {
    let scale = Scale::new(origin, d, a, b, c);
    let signs = put_coordinates(m, scale, origin, d, a, b, c);
    put_determinants(m, scale, signs);
    put_sum(m, scale.long);
    (scale, signs)
}

/// Makes the determinants and the divisor positive: whether a weight was negative, whether one was positive,
/// and whether the volume was negative.
#[inline(always)]
fn settle_all(m: &mut Digits, long: u32) -> (bool, bool, bool) {
    let (mut negative, mut positive) = (false, false);
    let mut upside_down = false;
    let mut det = 0;
    while det < 4 {
        let base = DETERMINANTS + det * LONG;
        let minus = settle(m, base, long);
        if det == 3 {
            upside_down = minus;
        } else if minus {
            negative = true;
        } else if is_some(m, base, long) {
            positive = true;
        }
        det += 1;
    }
    settle(m, DIVISOR, long);
    (negative, positive, upside_down)
}

/// Whether loops go round as often as they should. A driver that leaves a loop early leaves all later ones
/// after a round, these too. They must not look as if what they count was known.
#[inline(always)]
fn is_whole(m: &mut Digits, n: u32) -> bool {
    clear(m, 0, n);
    let mut i = 0;
    while i < n {
        m.put(i, 1);
        i += 1;
    }
    let (mut rounds, mut counted) = (0, 0);
    while rounds < n {
        counted += m.at(rounds);
        rounds += 1;
    }
    counted == n
}

/// Whether and where the line `origin + t d / 2^HEADING` meets the triangle, all numbers being 0 or normal
/// ([`HEADING`]).
pub fn cross(origin: Vec3, d: Vec3, a: Vec3, b: Vec3, c: Vec3) -> Answer {
    let mut m: Digits = scratch();
    let (scale, _) = put_all(&mut m, origin, d, a, b, c);
    let long = scale.long;
    let (negative, positive, upside_down) = settle_all(&mut m, long);
    let hit = negative != positive;
    let (mut t, mut u, mut v) = (0.0, 0.0, 0.0);
    if hit {
        let moved = justify(&mut m, DIVISOR, long);
        let mut det = 1;
        while det < 4 {
            let shift = if det == 3 { scale.places.1 - scale.ways.1 + HEADING } else { 0 };
            let q = quotient(&mut m, DETERMINANTS + det * LONG, long, moved, shift);
            if det == 1 {
                u = q;
            } else if det == 2 {
                v = q;
            } else {
                t = if upside_down != negative { -q } else { q };
            }
            det += 1;
        }
    }
    let whole = is_whole(&mut m, scale.places.0);
    Answer { hit, t, u, v, whole }
}

/// What [`pass`] found.
#[derive(Clone, Copy, Debug)]
pub struct Passage {
    /// Whether the perturbed line crosses the triangle.
    pub crossed: bool,
    /// Whether it does along the normal.
    pub leaving: bool,
    /// Whether it does ahead of the perturbed origin.
    pub ahead: bool,
    /// Correctly rounded; 0 below the normal range, infinite beyond it.
    pub t: f32,
    /// False if a driver left a loop early: nothing counts then.
    pub whole: bool,
}

/// The sign of the number of `n` digits from [`DIVIDEND`]: 1, 0 or -1.
#[inline(always)]
fn sign_of_sum(m: &mut Digits, n: u32) -> i32 {
    let negative = settle(m, DIVIDEND, n);
    if !is_some(m, DIVIDEND, n) {
        0
    } else if negative {
        -1
    } else {
        1
    }
}

/// The sign of a weight that is 0 as seen from the perturbed origin: that of the first component of `(y - z) x d`, for
/// the weight `d . (y x z)`, that is not 0.
#[inline(always)]
fn sign_beside(m: &mut Digits, scale: Scale, signs: u32, det: u32) -> i32 {
    let (_, y, z) = rows(det);
    let ((n, _), (nd, _)) = (scale.places, scale.ways);
    let long = n + nd + 1;
    let mut sign = 0;
    let mut axis = 0;
    while axis < 3 && sign == 0 {
        clear(m, DIVIDEND, long);
        add_cross(m, DIVIDEND, long, axis, (y, n), (0, nd), signs, false);
        add_cross(m, DIVIDEND, long, axis, (z, n), (0, nd), signs, true);
        sign = sign_of_sum(m, long);
        axis += 1;
    }
    sign
}

/// The sign of the first component of the normal that is not 0.
#[inline(always)]
fn sign_of_normal(m: &mut Digits, scale: Scale, signs: u32) -> i32 {
    let n = scale.places.0;
    let long = 2 * n + 1;
    let mut sign = 0;
    let mut axis = 0;
    while axis < 3 && sign == 0 {
        clear(m, DIVIDEND, long);
        let mut det = 0;
        while det < 3 {
            let (_, y, z) = rows(det);
            add_cross(m, DIVIDEND, long, axis, (y, n), (z, n), signs, false);
            det += 1;
        }
        sign = sign_of_sum(m, long);
        axis += 1;
    }
    sign
}

/// Whether and where the line that [`cross`] takes crosses the triangle, if its origin is perturbed as
/// [`perturbed`](super::perturbed) says.
pub fn pass(origin: Vec3, d: Vec3, a: Vec3, b: Vec3, c: Vec3) -> Passage {
    let mut m: Digits = scratch();
    let (scale, signs) = put_all(&mut m, origin, d, a, b, c);
    let long = scale.long;
    let (mut negative, mut positive) = (false, false);
    let mut det = 0;
    while det < 3 {
        let base = DETERMINANTS + det * LONG;
        let minus = settle(&mut m, base, long);
        let some = is_some(&m, base, long);
        let sign = if some { 1 - 2 * minus as i32 } else { sign_beside(&mut m, scale, signs, det) };
        negative |= sign <= 0;
        positive |= sign >= 0;
        det += 1;
    }
    let crossed = negative != positive;
    let volume = DETERMINANTS + 3 * LONG;
    let (mut ahead, mut t) = (false, 0.0);
    if crossed {
        settle(&mut m, DIVISOR, long);
        let minus = settle(&mut m, volume, long);
        let behind = if is_some(&m, volume, long) { minus } else { sign_of_normal(&mut m, scale, signs) > 0 };
        ahead = behind == negative;
        let moved = justify(&mut m, DIVISOR, long);
        let shift = scale.places.1 - scale.ways.1 + HEADING;
        let q = quotient(&mut m, volume, long, moved, shift);
        t = if ahead { q } else { -q };
    }
    let whole = is_whole(&mut m, scale.places.0);
    Passage { crossed, leaving: positive, ahead, t, whole }
}
