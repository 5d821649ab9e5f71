//! The watertight ray-triangle test (Woop, Benthin & Wald 2013), with signs that are exact.
//!
//! Vertices are translated to the ray's origin and sheared so that the ray runs along one axis; in the plane
//! across it, the origin is inside the triangle if the three edge functions have one sign. Each is a
//! difference of two products, whose rounding errors are found exactly: it has the right sign and is accurate
//! to its last digits. The sheared vertices are the same numbers in every triangle that shares them, so a
//! closed mesh has no gaps, at edges and at vertices (the paper falls back to doubles here); and since the
//! edge functions are accurate, so is `t`, their mean of the vertices' depths, even where the ray grazes the
//! triangle (see frame.rs).

use super::{Best, Corners, Intersector, vertices};
use crate::{
    ON_GPU,
    glam::Vec3,
    math::{
        Digits, Number, component, cycle, div, exchange, exp2, product_difference, product_difference_wide,
    },
    trace::frame::{Frame, flush},
};

/// Depths smaller than this count as zero, and so do weights below [`WEIGHT_FLOOR`]: their products stay
/// normal.
const DEPTH_FLOOR: f32 = exp2(-46);
const WEIGHT_FLOOR: f32 = exp2(-40);
/// Products of numbers at least this large have exact rounding errors.
pub(super) const PRODUCT_FLOOR: f32 = exp2(-39);

/// A triangle's vertices seen from a ray: moved to its origin, sheared along it.
#[derive(Clone, Copy, Default)]
#[allow(missing_debug_implementations, missing_docs, reason = "seen by tests alone")]
pub struct Sheared<N = f32> {
    pub ax: N,
    pub ay: N,
    pub bx: N,
    pub by: N,
    pub cx: N,
    pub cy: N,
    pub az: N,
    pub bz: N,
    pub cz: N,
}

/// A coordinate across the ray, of a corner at depth `z`.
#[inline(always)]
pub(in crate::trace) fn sheared<N: Number>(across: N, shear: N, z: N) -> N {
    across - shear * z
}

#[inline(always)]
pub(in crate::trace) fn shear(ray: &Frame, corners: (Vec3, Vec3, Vec3)) -> Sheared {
    <Mirrored>::new(ray, corners).righted(ray)
}

/// A vector with its component on `axis` last.
#[inline(always)]
fn main_last<const IMAGE: bool>(v: Vec3, axis: u32) -> Vec3 {
    if IMAGE { exchange(v, axis) } else { cycle(v, axis) }
}

/// A [`Sheared`] triangle or, if `IMAGE`, its mirror image where the main axis is not the last one: that has changed
/// places with the last, which takes four selections a corner; moving all three on takes six. The image's edge
/// functions have the opposite signs, so whether they agree can be asked of it. A CPU branches instead of selecting.
#[derive(Clone, Copy, Default)]
#[allow(missing_debug_implementations, reason = "nobody outside sees inside")]
pub struct Mirrored<const IMAGE: bool = ON_GPU>(Sheared);

impl<const IMAGE: bool> Mirrored<IMAGE> {
    #[inline(always)]
    pub(in crate::trace) fn new(ray: &Frame, (a, b, c): (Vec3, Vec3, Vec3)) -> Self {
        let (mut x, mut y) = (ray.shear_x, ray.shear_y);
        if IMAGE && ray.main != 2 {
            (x, y) = (y, x);
        }
        let ra = main_last::<IMAGE>(a - ray.origin, ray.main);
        let rb = main_last::<IMAGE>(b - ray.origin, ray.main);
        let rc = main_last::<IMAGE>(c - ray.origin, ray.main);
        Self(Sheared {
            ax: sheared(ra.x, x, ra.z),
            ay: sheared(ra.y, y, ra.z),
            bx: sheared(rb.x, x, rb.z),
            by: sheared(rb.y, y, rb.z),
            cx: sheared(rc.x, x, rc.z),
            cy: sheared(rc.y, y, rc.z),
            az: ra.z,
            bz: rb.z,
            cz: rc.z,
        })
    }

    /// As it is.
    #[inline(always)]
    pub(in crate::trace) fn image(&self) -> &Sheared {
        &self.0
    }

    /// The triangle itself.
    #[inline(always)]
    pub(in crate::trace) fn righted(self, ray: &Frame) -> Sheared {
        let s = self.0;
        if IMAGE && ray.main != 2 {
            Sheared { ax: s.ay, ay: s.ax, bx: s.by, by: s.bx, cx: s.cy, cy: s.cx, ..s }
        } else {
            s
        }
    }
}

impl<N: Digits> Sheared<N> {
    /// Whether no edge function contradicts another, by rounded products alone: the cheap part of the test. Few
    /// triangles get past it without being hit.
    #[inline(always)]
    pub(in crate::trace) fn agree(&self) -> N::Mask {
        let (up, uq) = (self.cx * self.by, self.cy * self.bx);
        let (vp, vq) = (self.ax * self.cy, self.ay * self.cx);
        let (wp, wq) = (self.bx * self.ay, self.by * self.ax);
        let negative = up.below(uq) | vp.below(vq) | wp.below(wq);
        let positive = up.exceeds(uq) | vp.exceeds(vq) | wp.exceeds(wq);
        !(negative & positive)
    }

    /// Whether no coordinate is too small for [`product_difference`].
    #[inline(always)]
    pub(in crate::trace) fn is_plain(&self) -> N::Mask {
        !(self.ax.is_small(PRODUCT_FLOOR)
            | self.ay.is_small(PRODUCT_FLOOR)
            | self.bx.is_small(PRODUCT_FLOOR)
            | self.by.is_small(PRODUCT_FLOOR)
            | self.cx.is_small(PRODUCT_FLOOR)
            | self.cy.is_small(PRODUCT_FLOOR))
    }

    /// The three edge functions, if coordinates are plain: exact signs, sizes within `2^-22`.
    #[inline(always)]
    pub(in crate::trace) fn edges(&self) -> (N, N, N) {
        (
            product_difference(self.cx, self.by, self.cy, self.bx),
            product_difference(self.ax, self.cy, self.ay, self.cx),
            product_difference(self.bx, self.ay, self.by, self.ax),
        )
    }

    /// The depths' mean by the weights, undivided; the main component of the direction is 1 by `along`.
    #[inline(always)]
    pub(in crate::trace) fn depth(&self, along: N, u: N, v: N, w: N) -> N {
        flush(u, WEIGHT_FLOOR) * flush(along * self.az, DEPTH_FLOOR)
            + flush(v, WEIGHT_FLOOR) * flush(along * self.bz, DEPTH_FLOOR)
            + flush(w, WEIGHT_FLOOR) * flush(along * self.cz, DEPTH_FLOOR)
    }
}

/// The three edge functions, up to a common power of two: exact signs, sizes within `2^-22`.
#[inline(always)]
fn edges(s: &Sheared) -> (f32, f32, f32) {
    if s.is_plain() {
        s.edges()
    } else {
        let (u, eu) = product_difference_wide(s.cx, s.by, s.cy, s.bx);
        let (v, ev) = product_difference_wide(s.ax, s.cy, s.ay, s.cx);
        let (w, ew) = product_difference_wide(s.bx, s.ay, s.by, s.ax);
        let top = if eu > ev { eu } else { ev };
        let top = if ew > top { ew } else { top };
        (lower(u, eu - top), lower(v, ev - top), lower(w, ew - top))
    }
}

/// `a * 2^e` for `e <= 0`, keeping the sign of what is too small to matter.
#[inline(always)]
fn lower(a: f32, e: i32) -> f32 {
    let least = f32::from_bits((a.to_bits() & 0x8000_0000) | exp2(-100).to_bits());
    if a == 0.0 {
        0.0
    } else if e < -50 {
        least
    } else {
        a * exp2(e)
    }
}

/// The edge functions times a power of two by which they add up to 1 to 4, and that sum.
#[inline(always)]
pub(in crate::trace) fn weights<N: Digits>(u: N, v: N, w: N) -> (N, N, N, N) {
    let unit = (u + v + w).unit();
    let (u, v, w) = (u * unit, v * unit, w * unit);
    (u, v, w, u + v + w)
}

/// The whole test of triangle `id`: keeps the better of it and `best`. Smaller `t` wins, then the smaller id.
#[inline(always)]
pub(in crate::trace) fn test(ray: &Frame, id: u32, s: &Sheared, best: &mut Best) {
    let (u, v, w) = edges(s);
    let negative = (u < 0.0) | (v < 0.0) | (w < 0.0);
    let positive = (u > 0.0) | (v > 0.0) | (w > 0.0);
    // Both: outside. Neither: the ray lies in the triangle's plane, a miss by contract.
    if negative != positive {
        let (u, v, w, det) = weights(u, v, w);
        let t = div(s.depth(component(ray.inverse, ray.main), u, v, w), det);
        best.offer(ray, Best { t, triangle: id, u: v, v: w, det });
    }
}

/// The default: signs of edge functions, exactly.
#[derive(Clone, Copy, Debug)]
pub struct Strict;

impl Intersector for Strict {
    type Seen = Mirrored;

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    #[inline(always)]
    fn look(self, ray: &Frame, corners: Corners) -> (Mirrored, bool) {
        let seen = Mirrored::new(ray, vertices(corners));
        (seen, seen.image().agree())
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, _corners: Corners, seen: Mirrored, best: &mut Best) -> bool {
        test(ray, id, &seen.righted(ray), best);
        true
    }
}

test!(brute_strict::BRUTE_STRICT = Strict);

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;
    use raykd_shared::{Ray, TreeHeader};

    #[test]
    fn a_mirror_image_is_righted() {
        let header = TreeHeader { lo: [-2.0; 3], hi: [2.0; 3], scale: 1.0, ..TreeHeader::zeroed() };
        let corners = (Vec3::new(0.1, 0.7, -1.3), Vec3::new(1.9, -0.3, 0.6), Vec3::new(-0.8, 1.1, 1.7));
        for main in 0..3 {
            let mut ray =
                Ray { origin: [-1.5, 0.25, 0.5], direction: [0.3, -0.7, 0.45], t_min: 0.0, t_max: 9.0 };
            ray.direction[main] = 1.25;
            let ray = Frame::of(&ray, &header);
            let seen = |p: Vec3| {
                let p = cycle(p - ray.origin, ray.main);
                [p.x - ray.shear_x * p.z, p.y - ray.shear_y * p.z, p.z]
            };
            let s = Mirrored::<true>::new(&ray, corners).righted(&ray);
            assert_eq!(ray.main, main as u32);
            assert_eq!([s.ax, s.ay, s.az], seen(corners.0));
            assert_eq!([s.bx, s.by, s.bz], seen(corners.1));
            assert_eq!([s.cx, s.cy, s.cz], seen(corners.2));
        }
    }
}
