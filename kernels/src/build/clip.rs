//! Clipping triangles: how far the part of one in a box or on a side of a plane reaches, rounded outward
//! ("perfect splits", Wald & Havran 2006, section 4.3).
//!
//! No polygon is kept. What lies of a triangle on one side of a plane is spanned by its vertices there and
//! the points where its edges meet the plane; the box of that is intersected with the one at hand, from plane
//! to plane. Not always as tight as the clipped polygon's, since a plane does not cut the edges that another
//! has made, and empty only if the polygon is.
//!
//! # Rounding
//! Let `u = 2^-24`, `span` the triangle's extent on an axis and `far` its largest coordinate there, by
//! magnitude. A point `a + t (b - a)` on an edge is off by at most `8.2 u span + u far`: two differences and
//! a ratio within 4 u in `t`, a difference and a product, and the sum; moving it by the pad takes another `u far`.
//! Where a vertex lies is decided exactly. Vertices are not padded, nor is anything on an axis across which
//! the triangle is flat.
//!
//! Coordinates are 0 or at least `DUST` in size, and so are the results; nothing else is subnormal, or it is
//! flushed, and pads are at least four times what that may lose.

use crate::{
    bounds::Bounds,
    glam::Vec3,
    math::{abs, cycle, exp2, high, low, ratio},
};

/// Smaller numbers count as 0 inside, and are rounded outward in results.
const DUST: f32 = exp2(-100);

/// How far something reaches along an axis.
#[derive(Clone, Copy)]
struct Span {
    lo: f32,
    hi: f32,
}

/// Reaches nowhere.
const NOWHERE: Span = Span { lo: f32::INFINITY, hi: f32::NEG_INFINITY };

impl Span {
    /// Makes it reach as far as another.
    #[inline(always)]
    fn take(&mut self, other: Self) {
        self.lo = low(self.lo, other.lo);
        self.hi = high(self.hi, other.hi);
    }

    /// Without dust.
    #[inline(always)]
    fn outward(self) -> Self {
        let (lo, hi) = (self.lo, self.hi);
        let (lo_dust, hi_dust) = (if lo < 0.0 { -DUST } else { 0.0 }, if hi > 0.0 { DUST } else { 0.0 });
        Self {
            lo: if abs(lo) >= DUST { lo } else { lo_dust },
            hi: if abs(hi) >= DUST { hi } else { hi_dust },
        }
    }
}

#[inline(always)]
fn span(a: f32, b: f32, c: f32) -> Span {
    Span { lo: low(low(a, b), c), hi: high(high(a, b), c) }
}

/// How far a point on an edge may be off, its own rounding included.
#[inline(always)]
fn pad(on: Span) -> f32 {
    let extent = on.hi - on.lo;
    let far = high(abs(on.lo), abs(on.hi));
    let pad = high(extent * (8.5 * exp2(-24)) + far * (2.125 * exp2(-24)), 4.0 * DUST);
    // Across a flat triangle nothing is rounded.
    if extent == 0.0 { 0.0 } else { pad }
}

/// The coordinate at `t` on the way from `a` to `b`.
#[inline(always)]
fn on(a: f32, b: f32, t: f32) -> f32 {
    let way = t * (b - a);
    a + if abs(way) < DUST { 0.0 } else { way }
}

/// A part of a triangle, seen along z: how far it reaches across.
#[derive(Clone, Copy)]
struct Part {
    x: Span,
    y: Span,
}

impl Part {
    #[inline(always)]
    fn vertex(&mut self, v: Vec3) {
        self.take(Self { x: Span { lo: v.x, hi: v.x }, y: Span { lo: v.y, hi: v.y } });
    }

    #[inline(always)]
    fn take(&mut self, other: Self) {
        self.x.take(other.x);
        self.y.take(other.y);
    }

    /// Its box, if it lies in `z`.
    #[inline(always)]
    fn bounds(&self, z: Span) -> Bounds {
        let Self { x, y } = self;
        Bounds { lo: Vec3::new(x.lo, y.lo, z.lo), hi: Vec3::new(x.hi, y.hi, z.hi) }
    }
}

/// Whether the edge from `a` to `b` passes through a plane across z.
#[inline(always)]
fn crosses(a: Vec3, b: Vec3, at: f32) -> bool {
    low(a.z, b.z) < at && at < high(a.z, b.z)
}

/// Where the edge from `a` to `b` meets a plane across z that it passes through.
#[inline(always)]
fn meet(a: Vec3, b: Vec3, at: f32) -> (f32, f32) {
    let t = ratio(at - a.z, b.z - a.z);
    (on(a.x, b.x, t), on(a.y, b.y, t))
}

/// How far two numbers reach that may be off by `pad`, without dust.
#[inline(always)]
fn around(a: f32, b: f32, pad: f32) -> Span {
    Span { lo: low(a, b) - pad, hi: high(a, b) + pad }.outward()
}

/// Which of two halves are something: bit 0 that below, bit 1 that above.
#[inline(always)]
pub fn sides_of_halves(under: &Bounds, over: &Bounds) -> u32 {
    !under.is_empty() as u32 | ((!over.is_empty() as u32) << 1)
}

/// Cuts `bounds`, a box around some part of a triangle, by a plane: boxes around what lies below and above,
/// each the box of the triangle's half within `bounds`.
#[inline(always)]
pub fn clip_plane(a: Vec3, b: Vec3, c: Vec3, bounds: &Bounds, axis: u32, at: f32) -> (Bounds, Bounds) {
    let (a, b, c) = (cycle(a, axis), cycle(b, axis), cycle(c, axis));
    let mut below = Part { x: NOWHERE, y: NOWHERE };
    let mut above = below;
    let mut vertex = |v: Vec3| {
        if v.z <= at {
            below.vertex(v);
        }
        if v.z >= at {
            above.vertex(v);
        }
    };
    vertex(a);
    vertex(b);
    vertex(c);
    let (ab, bc, ca) = (crosses(a, b, at), crosses(b, c, at), crosses(c, a, at));
    if ab | bc | ca {
        // Two edges do, or one, which is then both the first and the last. Side by side, a GPU waits for one ratio.
        let (from, to) = if ab {
            (a, b)
        } else if bc {
            (b, c)
        } else {
            (c, a)
        };
        let (x0, y0) = meet(from, to, at);
        let (from, to) = if ca {
            (c, a)
        } else if bc {
            (b, c)
        } else {
            (a, b)
        };
        let (x1, y1) = meet(from, to, at);
        let (pad_x, pad_y) = (pad(span(a.x, b.x, c.x)), pad(span(a.y, b.y, c.y)));
        let both = Part { x: around(x0, x1, pad_x), y: around(y0, y1, pad_y) };
        below.take(both);
        above.take(both);
    }
    let below = below.bounds(Span { lo: f32::NEG_INFINITY, hi: at }).turn_back(axis);
    let above = above.bounds(Span { lo: at, hi: f32::INFINITY }).turn_back(axis);
    (below.and(bounds), above.and(bounds))
}
