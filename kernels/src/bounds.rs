//! Boxes with faces across the axes.

use crate::{
    glam::Vec3,
    math::{cycle, high, low},
};

/// A box; empty if `lo` exceeds `hi` on some axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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

    /// The box around both.
    #[inline(always)]
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        let (a, b) = (self, other);
        Self {
            lo: Vec3::new(low(a.lo.x, b.lo.x), low(a.lo.y, b.lo.y), low(a.lo.z, b.lo.z)),
            hi: Vec3::new(high(a.hi.x, b.hi.x), high(a.hi.y, b.hi.y), high(a.hi.z, b.hi.z)),
        }
    }

    /// The box of a triangle.
    #[inline(always)]
    pub fn of(a: Vec3, b: Vec3, c: Vec3) -> Self {
        let lo = |a: f32, b: f32, c: f32| low(low(a, b), c);
        let hi = |a: f32, b: f32, c: f32| high(high(a, b), c);
        Self {
            lo: Vec3::new(lo(a.x, b.x, c.x), lo(a.y, b.y, c.y), lo(a.z, b.z, c.z)),
            hi: Vec3::new(hi(a.x, b.x, c.x), hi(a.y, b.y, c.y), hi(a.z, b.z, c.z)),
        }
    }

    /// With the axes where they were before `axis` was moved last.
    #[inline(always)]
    pub(crate) fn turn_back(&self, axis: u32) -> Self {
        let back = if axis == 2 { 2 } else { 1 - axis };
        Self { lo: cycle(self.lo, back), hi: cycle(self.hi, back) }
    }
}
