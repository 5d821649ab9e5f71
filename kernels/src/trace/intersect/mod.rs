//! What a triangle test is to a traversal, and what the published ones share.
//!
//! `strict` is what raykd uses, `exact` rounds nothing but its answer. The others are there to be compared
//! with them: each in a file of its own, with the formulas and thresholds of its source, so that it fails
//! where it is known to fail. Common to all are the rules of the contract: edges belong to triangles, ranges
//! of `t` are inclusive, the lowest number wins. `perturbed` says what a ray crosses.

pub mod baldwin;
pub(super) mod bounds;
pub(in crate::trace) mod by_doubles;
mod double;
pub mod exact;
pub(in crate::trace) mod filter;
pub mod integers;
pub mod moeller;
pub mod perturbed;
pub mod plane;
pub mod strict;
pub mod triple;
pub mod unit;
pub(crate) mod wide;
pub mod woop;

kernels! {
    /// The kernels of triangle tests: with a stack, but for those of `strict` and `exact`, and of every triangle.
    moeller::MOELLER,
    plane::PLANE,
    baldwin::BALDWIN,
    woop::WOOP,
    strict::brute_strict::BRUTE_STRICT,
    exact::brute_exact::BRUTE_EXACT,
    moeller::brute_moeller::BRUTE_MOELLER,
    plane::brute_plane::BRUTE_PLANE,
    baldwin::brute_baldwin::BRUTE_BALDWIN,
    woop::brute_woop::BRUTE_WOOP,
}

use super::frame::Frame;
use crate::{
    glam::{Vec3, Vec4},
    math::Number,
};
use raykd_shared::MISS;

/// Added to a triangle's number where it stands among floats: alone its bits are those of a subnormal, and
/// CPUs that compute all four lanes of a vector take a hundred cycles for one, needed or not.
pub const NORMAL: u32 = 0x4000_0000;

/// The best hit of a ray so far. `u` and `v` stay undivided until the end.
#[derive(Clone, Copy, Debug)]
pub struct Best {
    /// Scaled ray parameter.
    pub t: f32,
    /// Triangle, or [`MISS`].
    pub triangle: u32,
    /// Weight of the second vertex, to be divided by `det`.
    pub u: f32,
    /// Weight of the third vertex, to be divided by `det`.
    pub v: f32,
    /// Sum of the three weights.
    pub det: f32,
}

impl Best {
    /// No hit yet.
    pub const NOTHING: Self = Self { t: f32::INFINITY, triangle: MISS, u: 0.0, v: 0.0, det: 1.0 };

    /// Whether it is a hit, if `any` will do.
    #[inline(always)]
    pub const fn is_enough(&self, any: bool) -> bool {
        any && self.triangle != MISS
    }

    /// Whether a hit at `t` may be taken.
    #[inline(always)]
    pub fn may_take(&self, ray: &Frame, t: f32) -> bool {
        t >= ray.t_min && t <= ray.t_max && t <= self.t
    }

    /// Keeps the better of this and a hit that is in the ray's range. Smaller `t` wins, then the smaller
    /// number.
    #[inline(always)]
    pub fn offer(&mut self, ray: &Frame, hit: Self) {
        let inside = (hit.t >= ray.t_min) & (hit.t <= ray.t_max);
        let better = (hit.t < self.t) | ((hit.t == self.t) & (hit.triangle < self.triangle));
        if inside & better {
            *self = hit;
        }
    }
}

/// What floats tell of a triangle that the ray's line may pass through.
#[derive(Clone, Copy, Debug)]
pub struct Glance<N: Number = f32> {
    /// The lowest number that `t` may be, as it is rounded.
    pub near: N,
    /// The highest.
    pub later: N,
    /// Whether the line surely passes through it.
    pub sure: N::Mask,
    /// Whether then along its normal.
    pub leaving: N::Mask,
}

/// A triangle as leaves keep it: what [`Intersector::lay_out`] made of it, `w` of the first vector not counted.
pub type Corners = (Vec4, Vec4, Vec4);

/// A triangle's vertices.
#[inline(always)]
pub(in crate::trace) fn vertices((a, b, c): Corners) -> (Vec3, Vec3, Vec3) {
    (a.truncate(), b.truncate(), c.truncate())
}

/// A triangle test.
pub trait Intersector: Copy {
    /// What a first look at a triangle leaves for the test.
    type Seen: Copy + Default;
    /// Whether its test has loops, which a driver may leave early.
    const LOOPS: bool = false;
    /// Whether it takes rays as [`Frame::whole`] makes them.
    const WHOLE: bool = false;

    /// Made ready for a ray.
    fn new(ray: &Frame) -> Self;

    /// What leaves keep of a triangle.
    #[inline(always)]
    fn lay_out(a: Vec3, b: Vec3, c: Vec3) -> Corners {
        (a.extend(0.0), b.extend(0.0), c.extend(0.0))
    }

    /// A cheap first look: what it saw, and false only for triangles that [`Intersector::test`] would not take; always
    /// true where the test is as quick.
    fn look(self, ray: &Frame, corners: Corners) -> (Self::Seen, bool);

    /// The whole test of triangle `id`, after a look: keeps the better of it and `best`. False if a driver left a loop
    /// of it early.
    fn test(self, ray: &Frame, id: u32, corners: Corners, seen: Self::Seen, best: &mut Best) -> bool;

    /// The whole test of a triangle that was not looked at, whatever a look would say.
    #[inline(always)]
    fn test_unseen(self, ray: &Frame, id: u32, corners: Corners, best: &mut Best) -> bool {
        let (seen, _) = self.look(ray, corners);
        self.test(ray, id, corners, seen, best)
    }
}
