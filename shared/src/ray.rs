//! Rays and hits, as files and buffers hold them.

use bytemuck::{Pod, Zeroable};

/// One ray: the points `origin + t * direction` for `t_min <= t <= t_max`.
///
/// The direction need not have unit length; `t` counts in its lengths. What is compared with `t_min` and
/// `t_max`, and what hits are ordered by, is `t` as it is returned, rounded to the 24 bits of an `f32`, but
/// also where it is too small or too large for one. `t_max` may be infinite. Subnormal numbers count as 0. A
/// ray with a NaN anywhere, an infinite origin or direction, or a zero direction hits nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Ray {
    /// Start of the ray, in the mesh's units.
    pub origin: [f32; 3],
    /// Direction, any non-zero length.
    pub direction: [f32; 3],
    /// Smallest `t` that counts, inclusive.
    pub t_min: f32,
    /// Largest `t` that counts, inclusive; may be infinite.
    pub t_max: f32,
}

impl Ray {
    /// The half line from `origin` along `direction`: `0 <= t <= infinity`.
    pub const fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }
}

/// The triangle number of a miss.
pub const MISS: u32 = u32::MAX;

/// The answer to one ray.
///
/// The point hit is `(1 - u - v) * a + u * b + v * c` for the triangle's vertices `a`, `b`, `c`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Hit {
    /// Triangle number in file order, or [`MISS`].
    pub triangle: u32,
    /// Ray parameter of the hit, in lengths of the ray's direction: 0 below 2^-126 and infinite from 2^128
    /// on; 0 for a miss.
    pub t: f32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
}

impl Hit {
    /// What a ray that hits nothing gets.
    pub const NONE: Self = Self { triangle: MISS, t: 0.0, u: 0.0, v: 0.0 };

    /// Whether a triangle was hit.
    pub const fn is_hit(&self) -> bool {
        self.triangle != MISS
    }
}

const _: () = assert!(size_of::<Ray>() == 32 && align_of::<Ray>() == 4, "rays are records of 8 f32");
const _: () = assert!(size_of::<Hit>() == 16 && align_of::<Hit>() == 4, "hits are records of 4 words");

/// How often a ray crosses surfaces in its range of `t`, an edge or a vertex of a closed surface counting as one
/// crossing. The side of a triangle from which its corners go round counterclockwise is its outside.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Crossings {
    /// From the inside out.
    pub leaving: u32,
    /// From the outside in.
    pub entering: u32,
}

impl Crossings {
    /// Crossings out less crossings in: the winding number of where a ray starts, if it goes on for ever and all
    /// surfaces are closed.
    pub const fn winding(self) -> i32 {
        self.leaving.wrapping_sub(self.entering).cast_signed()
    }
}
