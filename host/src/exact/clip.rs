//! Clipping a triangle to a box: how far the part of it inside reaches, rounded outward.
//!
//! Perfect splits (Wald & Havran 2006, section 4.3) need the box of `triangle ∩ cell`. It is not found by
//! cutting a polygon plane by plane, which takes arrays and lets rounding pile up, but an axis at a time.
//! A convex set reaches exactly as far along z inside the slab `lo.z..hi.z` as it does without, cut off there. So
//! what is needed is how far `triangle ∩ slab x ∩ slab y` reaches along z, and that polygon's vertices all lie on
//! the boundary of `triangle ∩ slab x`: the three edges, cut to the slab, and the two chords in which the
//! triangle meets the slab's planes. Five segments, each cut to slab y. The chords are what finds the corners
//! where an edge of the cell pierces the triangle.
//!
//! # Rounding
//! Let `u = 2^-24`, `span` the triangle's extent on an axis and `far` its largest coordinate there, by magnitude.
//! A point `a + t (b - a)` on a segment is off by at most `5.1 u span + u far`: two differences and a quotient in
//! `t`, a difference and a product, and the sum. `pad` has another `u far` for what is done with it next: moving
//! it by the pad, or slab y by one. Where a vertex is inside or outside of slab x is decided exactly. A point of a cut
//! edge is within one pad of what it stands for, so each exact vertex lies within one pad of a computed segment,
//! inside slab y widened by a pad, and its z within one pad of that of the segment, whose computed point is off by
//! another one. Vertices of the triangle itself are not padded: they are exact, and so is everything on an axis
//! across which the triangle is flat.
//!
//! Coordinates are 0 or at least `DUST` in size, and so are the results; nothing else is subnormal, or it is
//! flushed, and pads are at least four times what that may lose.

use raykd_kernels::{
    glam::Vec3,
    math::{abs, exp2, high, low},
    trace::frame::cycle,
};

/// Smaller numbers count as 0 inside, and are rounded outward in results.
const DUST: f32 = exp2(-100);

/// A box; empty if `lo` exceeds `hi` on some axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub lo: Vec3,
    /// Upper corner.
    pub hi: Vec3,
}

impl Bounds {
    /// Whether no point lies inside; the points of a flat box do.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.lo.x > self.hi.x || self.lo.y > self.hi.y || self.lo.z > self.hi.z
    }

    /// What lies in both.
    #[inline(always)]
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        let (a, b) = (self, other);
        Self {
            lo: Vec3::new(high(a.lo.x, b.lo.x), high(a.lo.y, b.lo.y), high(a.lo.z, b.lo.z)),
            hi: Vec3::new(low(a.hi.x, b.hi.x), low(a.hi.y, b.hi.y), low(a.hi.z, b.hi.z)),
        }
    }

    /// The box of a triangle.
    #[inline(always)]
    pub fn of(a: Vec3, b: Vec3, c: Vec3) -> Self {
        let (x, y, z) = (span(a.x, b.x, c.x), span(a.y, b.y, c.y), span(a.z, b.z, c.z));
        Self { lo: Vec3::new(x.lo, y.lo, z.lo), hi: Vec3::new(x.hi, y.hi, z.hi) }
    }
}

/// How far something reaches along an axis.
#[derive(Clone, Copy)]
struct Span {
    lo: f32,
    hi: f32,
}

/// Reaches nowhere.
const NOWHERE: Span = Span { lo: f32::INFINITY, hi: f32::NEG_INFINITY };

impl Span {
    /// Makes it reach `at`, which may be off by `pad`.
    #[inline(always)]
    fn take(&mut self, at: f32, pad: f32) {
        self.lo = low(self.lo, at - pad);
        self.hi = high(self.hi, at + pad);
    }

    #[inline(always)]
    fn holds(&self, at: f32) -> bool {
        self.lo <= at && at <= self.hi
    }

    /// Without dust.
    #[inline(always)]
    fn outward(self) -> Self {
        let (lo, hi) = (self.lo, self.hi);
        Self {
            lo: if abs(lo) >= DUST {
                lo
            } else if lo < 0.0 {
                -DUST
            } else {
                0.0
            },
            hi: if abs(hi) >= DUST {
                hi
            } else if hi > 0.0 {
                DUST
            } else {
                0.0
            },
        }
    }
}

#[inline(always)]
fn span(a: f32, b: f32, c: f32) -> Span {
    Span { lo: low(low(a, b), c), hi: high(high(a, b), c) }
}

/// How far a point on a segment between points of the span may be off, its own rounding included.
#[inline(always)]
fn pad(on: Span) -> f32 {
    let extent = on.hi - on.lo;
    let far = high(abs(on.lo), abs(on.hi));
    let pad = high(extent * (5.25 * exp2(-24)) + far * (2.125 * exp2(-24)), 4.0 * DUST);
    // Across a flat triangle nothing is rounded.
    if extent == 0.0 { 0.0 } else { pad }
}

/// Where on the way from `a` to `b` the plane `at` between them is met, from 0 to 1.
#[inline(always)]
fn meet(a: f32, b: f32, at: f32) -> f32 {
    let (part, whole) = (at - a, b - a);
    part / whole
}

/// The coordinate at `t` on the way from `a` to `b`.
#[inline(always)]
fn on(a: f32, b: f32, t: f32) -> f32 {
    let way = t * (b - a);
    a + if abs(way) < DUST { 0.0 } else { way }
}

/// A point of the boundary of `triangle ∩ slab x`; z may be off by `pad`.
#[derive(Clone, Copy)]
struct Point {
    y: f32,
    z: f32,
    pad: f32,
}

/// The segment in which the triangle meets a plane: both ends, once both are known.
#[derive(Clone, Copy)]
struct Chord {
    first: Point,
    last: Point,
    ends: u32,
}

impl Chord {
    const NONE: Self = {
        let nowhere = Point { y: 0.0, z: 0.0, pad: 0.0 };
        Self { first: nowhere, last: nowhere, ends: 0 }
    };

    /// An edge that begins and ends on different sides of the plane meets it in one point; none or two do.
    #[inline(always)]
    fn add(&mut self, a: Vec3, b: Vec3, at: f32, pad: f32) -> Point {
        let t = meet(a.x, b.x, at);
        let point = Point { y: on(a.y, b.y, t), z: on(a.z, b.z, t), pad };
        if self.ends == 0 {
            self.first = point;
        }
        self.last = point;
        self.ends += 1;
        point
    }
}

/// The z-reach of `triangle ∩ slab x ∩ slab y`, while it is put together.
struct Reach {
    /// Slab x.
    x: Span,
    /// Slab y, widened.
    y: Span,
    /// One pad along z.
    pad: f32,
    /// Where the triangle meets the planes of slab x.
    enter: Chord,
    exit: Chord,
    z: Span,
}

impl Reach {
    /// Takes in the part of a segment that lies in slab y.
    #[inline(always)]
    fn segment(&mut self, p: Point, q: Point) {
        if self.y.holds(p.y) {
            self.z.take(p.z, p.pad);
        }
        if self.y.holds(q.y) {
            self.z.take(q.z, q.pad);
        }
        if (p.y < self.y.lo) != (q.y < self.y.lo) {
            self.z.take(on(p.z, q.z, meet(p.y, q.y, self.y.lo)), 2.0 * self.pad);
        }
        if (p.y > self.y.hi) != (q.y > self.y.hi) {
            self.z.take(on(p.z, q.z, meet(p.y, q.y, self.y.hi)), 2.0 * self.pad);
        }
    }

    /// Takes in an edge of the triangle.
    #[inline(always)]
    fn edge(&mut self, a: Vec3, b: Vec3) {
        let mut p = Point { y: a.y, z: a.z, pad: 0.0 };
        let mut q = Point { y: b.y, z: b.z, pad: 0.0 };
        if (a.x < self.x.lo) != (b.x < self.x.lo) {
            let point = self.enter.add(a, b, self.x.lo, self.pad);
            if a.x < self.x.lo {
                p = point;
            } else {
                q = point;
            }
        }
        if (a.x > self.x.hi) != (b.x > self.x.hi) {
            let point = self.exit.add(a, b, self.x.hi, self.pad);
            if a.x > self.x.hi {
                p = point;
            } else {
                q = point;
            }
        }
        if low(a.x, b.x) <= self.x.hi && high(a.x, b.x) >= self.x.lo {
            self.segment(p, q);
        }
    }
}

/// How far `triangle ∩ cell` reaches along z.
#[inline(always)]
fn reach(a: Vec3, b: Vec3, c: Vec3, lo: Vec3, hi: Vec3) -> Span {
    let wide = pad(span(a.y, b.y, c.y));
    let own = span(a.z, b.z, c.z);
    let mut reach = Reach {
        x: Span { lo: lo.x, hi: hi.x },
        y: Span { lo: lo.y - wide, hi: hi.y + wide },
        pad: pad(own),
        enter: Chord::NONE,
        exit: Chord::NONE,
        z: NOWHERE,
    };
    reach.edge(a, b);
    reach.edge(b, c);
    reach.edge(c, a);
    if reach.enter.ends > 0 {
        reach.segment(reach.enter.first, reach.enter.last);
    }
    if reach.exit.ends > 0 {
        reach.segment(reach.exit.first, reach.exit.last);
    }
    let z = reach.z.outward();
    Span { lo: high(z.lo, high(own.lo, lo.z)), hi: low(z.hi, low(own.hi, hi.z)) }
}

/// The box of `triangle ∩ cell`, both closed: no smaller than it is, no larger than the triangle's box in the
/// cell, and within `16 u span + 7 u far` of exact on every axis (see the module), or of what is exact for a cell
/// that is a pad larger: that matters where the triangle runs along a face of it. Empty only if the intersection is.
pub fn clip(a: Vec3, b: Vec3, c: Vec3, cell: &Bounds) -> Bounds {
    let along = move |axis: u32| {
        let turn = move |v: Vec3| cycle(v, axis);
        reach(turn(a), turn(b), turn(c), turn(cell.lo), turn(cell.hi))
    };
    let (x, y, z) = (along(0), along(1), along(2));
    Bounds { lo: Vec3::new(x.lo, y.lo, z.lo), hi: Vec3::new(x.hi, y.hi, z.hi) }
}

/// Cuts `bounds`, a box around some part of a triangle, by a plane: boxes around what lies below and above, each
/// the box of the triangle's half within `bounds`. One quotient for each of the two edges that cross the plane; not as
/// tight as [`clip`], since the other faces of `bounds` cut no edges, and as safe.
pub fn clip_plane(a: Vec3, b: Vec3, c: Vec3, bounds: &Bounds, axis: u32, at: f32) -> (Bounds, Bounds) {
    let turn = move |v: Vec3| cycle(v, axis);
    let (a, b, c) = (turn(a), turn(b), turn(c));
    let mut halves = Halves {
        at,
        pad_x: pad(span(a.x, b.x, c.x)),
        pad_y: pad(span(a.y, b.y, c.y)),
        below: [NOWHERE; 2],
        above: [NOWHERE; 2],
    };
    halves.vertex(a);
    halves.vertex(b);
    halves.vertex(c);
    halves.edge(a, b);
    halves.edge(b, c);
    halves.edge(c, a);
    // Undoes `turn`.
    let unturn = move |v: Vec3| cycle(v, if axis == 2 { 2 } else { 1 - axis });
    let bounds_of = move |[x, y]: [Span; 2], z: Span| {
        let (x, y) = (x.outward(), y.outward());
        Bounds { lo: unturn(Vec3::new(x.lo, y.lo, z.lo)), hi: unturn(Vec3::new(x.hi, y.hi, z.hi)) }
    };
    let below = bounds_of(halves.below, Span { lo: f32::NEG_INFINITY, hi: at });
    let above = bounds_of(halves.above, Span { lo: at, hi: f32::INFINITY });
    (below.and(bounds), above.and(bounds))
}

/// How far a triangle's parts below and above a plane across z reach along x and y.
struct Halves {
    at: f32,
    pad_x: f32,
    pad_y: f32,
    below: [Span; 2],
    above: [Span; 2],
}

impl Halves {
    #[inline(always)]
    fn vertex(&mut self, v: Vec3) {
        if v.z <= self.at {
            self.below[0].take(v.x, 0.0);
            self.below[1].take(v.y, 0.0);
        }
        if v.z >= self.at {
            self.above[0].take(v.x, 0.0);
            self.above[1].take(v.y, 0.0);
        }
    }

    #[inline(always)]
    fn edge(&mut self, a: Vec3, b: Vec3) {
        if low(a.z, b.z) < self.at && self.at < high(a.z, b.z) {
            let t = meet(a.z, b.z, self.at);
            let (x, y) = (on(a.x, b.x, t), on(a.y, b.y, t));
            self.below[0].take(x, self.pad_x);
            self.below[1].take(y, self.pad_y);
            self.above[0].take(x, self.pad_x);
            self.above[1].take(y, self.pad_y);
        }
    }
}
