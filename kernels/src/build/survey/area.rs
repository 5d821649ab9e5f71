//! Whether a triangle has area: exactly, for all finite corners.
//!
//! It has none if its corners lie on one line, which is when all three projections along the axes are degenerate.
//! Floats say so where their rounding cannot matter. Else the six products of a projection's determinant are added up
//! in integers: a float is 24 digits times a power of two, also if it is subnormal, and a product has 48.

use super::size;
use crate::{
    glam::UVec3,
    math::{abs, exp2},
};

/// Smaller coordinates, by the bits, leave room for what floats tell.
const ROOM: u32 = exp2(20).to_bits();
/// What rounding takes from a determinant is less than this part of the sum of its products (Shewchuk 1997 proves three
/// fourths of it) ...
const PART: f32 = exp2(-22);
/// ... and this, where numbers may be subnormal and be taken for 0: a factor below `2^-126`, the other below `2^21`.
const LEAST: f32 = exp2(-100);

/// The coordinate with dust taken for 0.
#[inline(always)]
fn swept(bits: u32, dust: u32) -> u32 {
    if size(bits) < dust { 0 } else { bits }
}

#[inline(always)]
fn swept_all(p: UVec3, dust: u32) -> UVec3 {
    UVec3::new(swept(p.x, dust), swept(p.y, dust), swept(p.z, dust))
}

/// Whether a triangle of such corners, given by the bits, has area once dust is 0.
#[inline(always)]
pub fn has_area(a: UVec3, b: UVec3, c: UVec3, dust: u32) -> bool {
    let (a, b, c) = (swept_all(a, dust), swept_all(b, dust), swept_all(c, dust));
    clearly(a, b, c) || exactly(a, b, c)
}

#[inline(always)]
fn has_room(p: UVec3) -> bool {
    (size(p.x) < ROOM) & (size(p.y) < ROOM) & (size(p.z) < ROOM)
}

/// Whether floats leave no doubt that there is area.
#[inline(always)]
fn clearly(a: UVec3, b: UVec3, c: UVec3) -> bool {
    let room = has_room(a) & has_room(b) & has_room(c);
    let side = move |from: u32, to: u32| f32::from_bits(to) - f32::from_bits(from);
    let (ux, uy, uz) = (side(a.x, b.x), side(a.y, b.y), side(a.z, b.z));
    let (vx, vy, vz) = (side(a.x, c.x), side(a.y, c.y), side(a.z, c.z));
    room & (clear(ux, uy, vx, vy) | clear(uy, uz, vy, vz) | clear(uz, ux, vz, vx))
}

/// Whether the determinant of two sides is not 0, whatever was rounded.
#[inline(always)]
fn clear(ux: f32, uy: f32, vx: f32, vy: f32) -> bool {
    let (p, q) = (ux * vy, uy * vx);
    abs(p - q) > (abs(p) + abs(q)) * PART + LEAST
}

/// A product of two floats.
#[derive(Clone, Copy)]
struct Product {
    /// Its digits: the lower 32 bits, and the upper 16.
    low: u32,
    high: u32,
    /// What power of two the lowest stands for, 300 and more too large.
    place: u32,
    negative: bool,
}

/// The product of two floats, or its opposite, by their bits.
#[inline(always)]
fn product(a: u32, b: u32, minus: bool) -> Product {
    let (ea, eb) = (size(a) >> 23, size(b) >> 23);
    // Subnormal numbers lack the leading digit, and stand where the least normal ones do.
    let digits = move |bits: u32, e: u32| (bits & 0x007F_FFFF) | (((e != 0) as u32) << 23);
    let place = move |e: u32| if e == 0 { 1 } else { e };
    let (da, db) = (digits(a, ea), digits(b, eb));
    let (ah, al, bh, bl) = (da >> 12, da & 0xFFF, db >> 12, db & 0xFFF);
    let middle = ah * bl + al * bh;
    let lower = al * bl + ((middle & 0xFFF) << 12);
    let upper = ah * bh + (middle >> 12) + (lower >> 24);
    Product {
        low: (lower & 0x00FF_FFFF) | (upper << 24),
        high: upper >> 8,
        place: place(ea) + place(eb),
        negative: ((a ^ b) >> 31 != 0) != minus,
    }
}

impl Product {
    #[inline(always)]
    fn is_zero(self) -> bool {
        (self.low | self.high) == 0
    }

    /// The 16 bits from `place` on, with the sign.
    #[inline(always)]
    fn digit(self, place: u32) -> i32 {
        let by = place as i32 - self.place as i32;
        let digit = if by <= -16 || by >= 48 {
            0
        } else if by < 0 {
            self.low << -by
        } else if by == 0 {
            self.low
        } else if by < 32 {
            (self.low >> by) | (self.high << (32 - by))
        } else {
            self.high >> (by - 32)
        };
        let digit = (digit & 0xFFFF) as i32;
        if self.negative { -digit } else { digit }
    }
}

/// The least place of products that are not 0, and the greatest.
#[inline(always)]
fn widen(range: (u32, u32), p: Product) -> (u32, u32) {
    let (lo, hi) = range;
    if p.is_zero() {
        range
    } else {
        (if p.place < lo { p.place } else { lo }, if p.place > hi { p.place } else { hi })
    }
}

/// Whether three points of a plane do not lie on one line: their determinant is not 0.
#[inline(always)]
fn are_apart(ax: u32, ay: u32, bx: u32, by: u32, cx: u32, cy: u32) -> bool {
    // (a - c) x (b - c), in which c x c is nothing.
    let (p, q, r) = (product(ax, by, false), product(bx, cy, false), product(cx, ay, false));
    let (s, t, u) = (product(ay, bx, true), product(by, cx, true), product(cy, ax, true));
    let none = (u32::MAX, 0);
    let (from, to) = widen(widen(widen(widen(widen(widen(none, p), q), r), s), t), u);
    let mut apart = false;
    let mut carry = 0;
    let mut place = from;
    // The sum has three more digits than a product. Without products there is no place.
    while place < to + 48 + 16 && !apart {
        let sum = p.digit(place) + q.digit(place) + r.digit(place);
        let sum = sum + s.digit(place) + t.digit(place) + u.digit(place) + carry;
        apart = sum & 0xFFFF != 0;
        carry = sum >> 16;
        place += 16;
    }
    apart
}

/// The same in integers.
#[inline(always)]
fn exactly(a: UVec3, b: UVec3, c: UVec3) -> bool {
    let mut apart = false;
    let mut axis = 0;
    while axis < 3 && !apart {
        let (x, y) = (axis, if axis == 2 { 0 } else { axis + 1 });
        apart = are_apart(on(a, x), on(a, y), on(b, x), on(b, y), on(c, x), on(c, y));
        axis += 1;
    }
    apart
}

#[inline(always)]
fn on(p: UVec3, axis: u32) -> u32 {
    if axis == 0 {
        p.x
    } else if axis == 1 {
        p.y
    } else {
        p.z
    }
}
