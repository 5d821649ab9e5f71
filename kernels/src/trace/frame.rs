//! One ray made ready: scaled, with exact reciprocals, and with the pad that makes traversal conservative.
//!
//! # Why nothing is missed
//! Let `e = 2^-24` and `M` the largest distance along an axis from the origin to a corner of the scene. The
//! triangle test works on vertices that were translated and sheared in `f32`, which moves each by at most `8
//! e M` across the ray and `3 e M` along it. For these vertices it decides exactly, and it finds their mean
//! depth `t` within `10 e M`. The same mean of the true vertices is a point of the triangle, so: at `t` the
//! ray is within `21 e M`, on every axis, of a point `q` of the triangle. Some leaf whose cell contains `q`
//! lists the triangle, also if references were clipped. Traversal counts every plane as [`PAD`] `* M = 32 e
//! M` thick on either side, which covers this and the rounding of `(split - origin) * inverse` and what
//! follows (`6 e M`). Hence each accepted hit lies in the interval of some leaf that lists its triangle,
//! whatever the tree looks like: traversal and brute force give the same bytes. Hits of `exact` are points of
//! the ray and of the triangle but for the rounding of `t`: a special case.

use crate::{
    glam::{Vec3, Vec4},
    math::{Digits, abs, component, cycle, exp2, exponent, exponent_bits, high, is_nan, ldexp},
};
use raykd_shared::{Ray, TreeHeader};

/// Half width, in units of `M`, of what a splitting plane counts as.
pub const PAD: f32 = exp2(-19);

/// Direction components smaller than this fraction of the largest are taken as this fraction: over the
/// scene's length the ray then strays less than `PAD` by far.
const STEEPEST: i32 = 40;

/// The power of two that [`Frame::heading`] is multiplied with: however small a component beside the largest,
/// no digit of it is lost.
pub const HEADING: i32 = 127;

/// Origins are accepted up to this power of two (in scaled units, where scenes are at most `2^20` wide).
pub const FARTHEST: i32 = 30;

/// And scenes up to this distance. Theirs is less than `2^45`, as coordinates have 24 digits, but for scenes
/// that are flat across an axis: farther away, products of lengths would have no room.
pub(super) const FARTHEST_SCENE: i32 = 50;

/// What is smaller counts as 0, for origins (in scaled units, where scenes are at least `2^-10` wide) and for
/// the shear: with coordinates of at least `2^-60` of the scene's width no sheared vertex is subnormal, and a
/// ray strays by a small fraction of what rounding does.
pub(super) const DUST: f32 = exp2(SMALLEST);
const SMALLEST: i32 = -70;
pub(super) const NO_SHEAR: f32 = exp2(-30);

/// A ray in the form traversal and triangle test need.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Origin, scaled as the scene is; coordinates below `2^-70` are 0, but see [`Frame::whole`].
    pub origin: Vec3,
    /// The same with all its coordinates, but those below `2^-126`.
    pub place: Vec3,
    /// Reciprocals of the direction's components, of size `2^-1` to `2^40`, never infinite.
    pub inverse: Vec3,
    /// Direction, the largest component of size 1 to 2; components below `2^-30` are 0.
    pub direction: Vec3,
    /// The same with all its components, times [`HEADING`].
    pub heading: Vec3,
    /// `PAD * M`.
    pub pad: f32,
    /// Axis of the largest direction component.
    pub main: u32,
    /// Shear along the two other axes, in cyclic order.
    pub shear_x: f32,
    /// See `shear_x`.
    pub shear_y: f32,
    /// The first `t` inside scene and ray, scaled.
    pub enter: f32,
    /// The last such `t`; smaller than `enter` if there is none.
    pub exit: f32,
    /// Smallest `t` that counts, scaled.
    pub t_min: f32,
    /// Largest `t` that counts, scaled.
    pub t_max: f32,
    /// Scaled `t` is `t * 2^stretch`.
    pub stretch: i32,
    /// Scaled coordinates are those of the mesh times `2^scale`.
    pub scale: i32,
    /// Whether the ray is one: finite, non-zero direction, origin and scene in range.
    pub valid: bool,
}

/// The number, or 0 if it is smaller than `floor` in size.
#[inline(always)]
pub fn flush<N: Digits>(a: N, floor: f32) -> N {
    N::choose(a.abs().below(N::all(floor)), N::all(0.0), a)
}

/// The reciprocal of a direction component of size at most 2, kept finite.
#[inline(always)]
pub(super) fn reciprocal<N: Digits>(d: N) -> N {
    let least = N::all(exp2(-STEEPEST));
    N::choose(d.abs().below(least), least.signed(d), d).reciprocal()
}

/// The part of `enter..exit` in which the ray is in the slab `lo..hi`, widened by `slack` in space; empty, with
/// its ends in the wrong order, if there is none.
#[inline(always)]
pub fn slab<N: Digits>(lo: f32, hi: f32, origin: N, inverse: N, slack: N, enter: N, exit: N) -> (N, N) {
    let to_lo = (N::all(lo) - origin) * inverse;
    let to_hi = (N::all(hi) - origin) * inverse;
    let wide = slack * inverse.abs();
    let back = inverse.below(N::all(0.0));
    let near = N::choose(back, to_hi, to_lo);
    let far = N::choose(back, to_lo, to_hi);
    (enter.high(near - wide), exit.low(far + wide))
}

/// A scaled end of a ray's range, one to which there is no number moved inwards to the next: `least` is that
/// next to 0.
#[inline(always)]
fn bound(t: f32, stretch: i32, least: f32) -> f32 {
    let scaled = ldexp(t, stretch);
    let lost = (scaled == 0.0) & (exponent_bits(t) > 0);
    if lost & ((t < 0.0) == (least < 0.0)) { least } else { scaled }
}

/// `v * 2^e`, component by component: 0 where that is less than `2^least` in size, or it was not normal; of the same
/// sign then if `SIGNED`. Results that would be infinite mean nothing.
#[inline(always)]
fn scaled<const SIGNED: bool>(v: Vec3, e: i32, least: i32) -> Vec3 {
    // The largest bits of an exponent that is too small: bits are 127 more than exponents, the result's `e` more.
    let none = if least + 126 > e { ((least + 126 - e) as u32) << 23 } else { 0 };
    let kept = if SIGNED { 0x8000_0000 } else { 0 };
    let one = |a: f32| {
        let moved = a.to_bits().wrapping_add((e as u32) << 23);
        f32::from_bits(if exponent_bits(a) > none { moved } else { a.to_bits() & kept })
    };
    Vec3::new(one(v.x), one(v.y), one(v.z))
}

/// The exponent of the smallest normal number.
const NORMAL: i32 = -126;

impl Frame {
    /// No ray.
    pub(super) const NOTHING: Self = Self {
        origin: Vec3::ZERO,
        place: Vec3::ZERO,
        inverse: Vec3::ZERO,
        direction: Vec3::ZERO,
        heading: Vec3::ZERO,
        pad: 0.0,
        main: 0,
        shear_x: 0.0,
        shear_y: 0.0,
        enter: 0.0,
        exit: 0.0,
        t_min: 0.0,
        t_max: f32::INFINITY,
        stretch: 0,
        scale: 0,
        valid: false,
    };

    /// Prepares a ray.
    #[inline(always)]
    pub fn of(ray: &Ray, header: &TreeHeader) -> Self {
        let ([ox, oy, oz], [dx, dy, dz]) = (ray.origin, ray.direction);
        Self::new(Vec4::new(ox, oy, oz, dx), Vec4::new(dy, dz, ray.t_min, ray.t_max), header)
    }

    /// Prepares the ray in two words of four, as buffers hold it: origin and `direction.x`; `direction.y`,
    /// `direction.z`, `t_min`, `t_max`.
    #[inline(always)]
    pub fn new(first: Vec4, second: Vec4, header: &TreeHeader) -> Self {
        let direction = Vec3::new(first.w, second.x, second.y);
        let (dx, dy, dz) =
            (abs(direction.x).to_bits(), abs(direction.y).to_bits(), abs(direction.z).to_bits());
        let most = dx.max(dy).max(dz);
        let main = if dx == most { 0 } else { 1 + (dy < most) as u32 };
        let (top, scale) = ((most >> 23) as i32 - 127, exponent(header.scale));
        let d = scaled::<true>(direction, -top, NORMAL);
        let heading = scaled::<true>(direction, HEADING - top, NORMAL);
        let place = Vec3::new(first.x, first.y, first.z);
        // From these bits of an exponent on a coordinate is too far off, is infinite or no number.
        let too_far = FARTHEST + 127 - scale;
        let too_far = (if too_far < 255 { too_far as u32 } else { 255 }) << 23;
        let close = (exponent_bits(place.x) < too_far)
            & (exponent_bits(place.y) < too_far)
            & (exponent_bits(place.z) < too_far);
        let number = !is_nan(second.z) & !is_nan(second.w);
        let valid = (top > -127) & (top < 128) & number & close;
        let origin = scaled::<false>(place, scale, SMALLEST);
        let place = scaled::<true>(place, scale, NORMAL);
        // An invalid ray goes on as a harmless one, to keep the numbers below finite.
        let d = if valid { d } else { Vec3::new(1.0, 0.0, 0.0) };
        let origin = if valid { origin } else { Vec3::ZERO };
        let inverse = Vec3::new(reciprocal(d.x), reciprocal(d.y), reciprocal(d.z));
        let turned = cycle(d, main);
        let along = component(inverse, main);
        let (lo, hi) = (header.lo, header.hi);
        let mut far = high(abs(lo[0] - origin.x), abs(hi[0] - origin.x));
        far = high(far, high(abs(lo[1] - origin.y), abs(hi[1] - origin.y)));
        far = high(far, high(abs(lo[2] - origin.z), abs(hi[2] - origin.z)));
        // Only scenes without triangles come below this; it keeps subnormals from mattering there too.
        far = high(far, exp2(-40));
        let valid = valid & (far < exp2(FARTHEST_SCENE));
        let pad = PAD * far;
        let stretch = scale + top;
        let t_min = bound(second.z, stretch, exp2(-126));
        let t_max = bound(second.w, stretch, -exp2(-126));
        let (enter, exit) = slab(lo[0], hi[0], origin.x, inverse.x, pad, t_min, t_max);
        let (enter, exit) = slab(lo[1], hi[1], origin.y, inverse.y, pad, enter, exit);
        let (enter, exit) = slab(lo[2], hi[2], origin.z, inverse.z, pad, enter, exit);
        Self {
            origin,
            place,
            inverse,
            heading,
            direction: Vec3::new(flush(d.x, NO_SHEAR), flush(d.y, NO_SHEAR), flush(d.z, NO_SHEAR)),
            pad,
            main,
            shear_x: flush(turned.x * along, NO_SHEAR),
            shear_y: flush(turned.y * along, NO_SHEAR),
            enter,
            exit,
            t_min,
            t_max,
            stretch,
            scale,
            valid,
        }
    }

    /// With all of the origin that is left after scaling, for tests that no subnormal number matters to.
    #[inline(always)]
    pub fn whole(self) -> Self {
        Self { origin: self.place, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_scaled_as_numbers_are() {
        for power in 0..255_u32 {
            for mantissa in [0, 1, 0x40_0000, 0x7F_FFFF] {
                let a = f32::from_bits(power << 23 | mantissa);
                for e in (-254..=254).filter(|e| exponent(a) + e < 128) {
                    let (v, right) = (Vec3::new(a, -a, a), ldexp(a, e));
                    let bits = |v: Vec3| v.to_array().map(f32::to_bits);
                    let signed = Vec3::new(right, -right, right);
                    assert_eq!(bits(scaled::<true>(v, e, NORMAL)), bits(signed), "{a:e} * 2^{e}");
                    let right = flush(right, DUST);
                    let unsigned = Vec3::new(right, flush(-right, DUST), right);
                    assert_eq!(bits(scaled::<false>(v, e, SMALLEST)), bits(unsigned), "{a:e} * 2^{e}");
                }
            }
        }
    }
}
