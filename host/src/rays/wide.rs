//! Rays on their way from a mesh's own coordinates to where its tree is.

use crate::{Ray, vector::below};
use rayon::prelude::*;
use std::borrow::Cow;

/// One ray in `f64`, for meshes whose coordinates have more digits than `f32`: as [`Ray`] otherwise.
///
/// Its origin loses [`Mesh::translation`](crate::Mesh::translation) in `f64`; then all is rounded to the nearest
/// `f32`, but `t_min` up and `t_max` down, so that no hit lies outside of what was asked for. A direction that is
/// infinite or zero in `f32` hits nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Ray64 {
    /// Start of the ray, in the mesh's own coordinates.
    pub origin: [f64; 3],
    /// Direction, any non-zero length.
    pub direction: [f64; 3],
    /// Smallest `t` that counts, inclusive.
    pub t_min: f64,
    /// Largest `t` that counts, inclusive; may be infinite.
    pub t_max: f64,
}

impl Ray64 {
    /// The half line from `origin` along `direction`: `0 <= t <= infinity`.
    pub const fn new(origin: [f64; 3], direction: [f64; 3]) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f64::INFINITY }
    }
}

/// What a scene takes for rays, in its mesh's own coordinates: [`Ray`] and [`Ray64`], and no other type.
pub trait AnyRay: Copy + Send + Sync + sealed::Sealed {
    /// The rays as the mesh's positions are: less its translation, in `f32`.
    #[doc(hidden)]
    fn local(rays: &[Self], translation: [f64; 3]) -> Cow<'_, [Ray]>;

    /// The same of one ray.
    #[doc(hidden)]
    fn alone(&self, translation: [f64; 3]) -> Ray;

    /// The same ray in `f64`.
    #[doc(hidden)]
    fn wide(&self) -> Ray64;
}

/// What a scene takes for points, in its mesh's own coordinates: three `f32` or `f64`, and no other type.
pub trait AnyPoint: Copy + Send + Sync + sealed::Sealed {
    /// The point as the mesh's positions are: less its translation, in `f32`.
    #[doc(hidden)]
    fn local(&self, translation: [f64; 3]) -> [f32; 3];
}

impl AnyPoint for [f32; 3] {
    #[inline]
    fn local(&self, translation: [f64; 3]) -> [f32; 3] {
        if translation == [0.0; 3] { *self } else { moved(self.map(f64::from), translation) }
    }
}

impl AnyPoint for [f64; 3] {
    #[inline]
    fn local(&self, translation: [f64; 3]) -> [f32; 3] {
        moved(*self, translation)
    }
}

mod sealed {
    /// Kernels know no other rays and points.
    pub trait Sealed {}
    impl Sealed for crate::Ray {}
    impl Sealed for super::Ray64 {}
    impl Sealed for [f32; 3] {}
    impl Sealed for [f64; 3] {}
}

impl AnyRay for Ray {
    fn local(rays: &[Self], translation: [f64; 3]) -> Cow<'_, [Ray]> {
        if translation == [0.0; 3] {
            return rays.into();
        }
        rays.par_iter().map(|ray| ray.alone(translation)).collect::<Vec<_>>().into()
    }

    #[inline]
    fn alone(&self, translation: [f64; 3]) -> Ray {
        let moves = translation != [0.0; 3];
        let origin = if moves { moved(self.origin.map(f64::from), translation) } else { self.origin };
        Self { origin, ..*self }
    }

    fn wide(&self) -> Ray64 {
        // What is subnormal counts as 0, also where an instance of a world would make it larger.
        let wide = |x: f32| if x.is_subnormal() { 0.0 } else { f64::from(x) };
        Ray64 {
            origin: self.origin.map(wide),
            direction: self.direction.map(wide),
            t_min: wide(self.t_min),
            t_max: wide(self.t_max),
        }
    }
}

impl AnyRay for Ray64 {
    fn local(rays: &[Self], translation: [f64; 3]) -> Cow<'_, [Ray]> {
        rays.par_iter().map(|ray| ray.alone(translation)).collect::<Vec<_>>().into()
    }

    fn alone(&self, translation: [f64; 3]) -> Ray {
        Ray {
            origin: moved(self.origin, translation),
            direction: self.direction.map(|x| x as f32),
            t_min: -end(-self.t_min),
            t_max: end(self.t_max),
        }
    }

    fn wide(&self) -> Ray64 {
        *self
    }
}

/// Where a range ends that is rounded down: never at a subnormal number, as those count as 0.
#[inline]
fn end(x: f64) -> f32 {
    let below = below(x);
    if !below.is_subnormal() {
        below
    } else if below < 0.0 {
        -f32::MIN_POSITIVE
    } else {
        0.0
    }
}

#[inline]
fn moved(origin: [f64; 3], translation: [f64; 3]) -> [f32; 3] {
    [0, 1, 2].map(|axis| (origin[axis] - translation[axis]) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_rounded_inward() {
        let ray = |t_min, t_max| Ray64 { t_min, t_max, ..Ray64::new([0.0; 3], [1.0; 3]) };
        let range = |t_min: f64, t_max: f64| {
            let local = Ray64::local(&[ray(t_min, t_max)], [0.0; 3])[0];
            (local.t_min, local.t_max)
        };
        assert_eq!(range(0.5, 2.0), (0.5, 2.0));
        assert_eq!(range(0.0, f64::INFINITY), (0.0, f32::INFINITY));
        assert_eq!(range(f64::NEG_INFINITY, 1e300), (f32::NEG_INFINITY, f32::MAX));
        // The nearest f32 to 0.1 is above it, the nearest to 0.7 below.
        assert_eq!(range(0.1, 0.1), (0.1, 0.1f32.next_down()));
        assert_eq!(range(0.7, 0.7), (0.7f32.next_up(), 0.7));
        // Subnormal numbers count as 0.
        assert_eq!(range(1e-60, 1e-39), (f32::MIN_POSITIVE, 0.0));
        assert_eq!(range(-1e-39, -1e-60), (0.0, -f32::MIN_POSITIVE));
        let (t_min, t_max) = range(f64::NAN, f64::NAN);
        assert!(t_min.is_nan() && t_max.is_nan());
    }

    #[test]
    fn rays_of_meshes_that_stay_are_as_they_were() {
        let rays = [Ray { t_min: f32::NAN, ..Ray::new([-0.0, 1e-40, f32::INFINITY], [0.1, 0.0, -0.0]) }];
        let same = Ray::local(&rays, [0.0; 3]);
        assert_eq!(bytemuck::cast_slice::<_, u8>(&rays), bytemuck::cast_slice::<_, u8>(&same));
        let local = Ray::local(&rays, [0.0, -2.0, 0.0])[0];
        assert_eq!(local.origin, [-0.0, 2.0, f32::INFINITY]);
    }

    #[test]
    fn origins_are_moved_before_they_are_rounded() {
        let ray = Ray64::new([4.5e6 + 0.003, 0.1, -4.5e6 - 0.25], [1.0, 2.0, 3.0]);
        let local = Ray64::local(&[ray], [4.5e6, 0.0, -4.5e6])[0];
        assert_eq!(local.origin, [(4.5e6f64 + 0.003 - 4.5e6) as f32, 0.1, -0.25]);
    }
}
