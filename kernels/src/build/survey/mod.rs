//! What a builder has to know of a mesh that lies on the device: which triangles have area, and the box around them.
//!
//! The host finds the same of a mesh in its own memory (`raykd::mesh`). [`vertices`] and [`indices`] copy the mesh, so
//! that whoever made it may change it later. [`sift`] marks the triangles that take part, bounds them and counts them
//! by blocks, [`offsets`] adds the blocks up, [`collect`] lists the marked triangles. Then the host reads [`Found`], a
//! few words, from which it knows the scale; [`settle`] brings the coordinates to it. Where a mesh is expected to be
//! like the one before, [`root`] decides what the host would, which looks at [`Found`] when the tree is built.
//!
//! Coordinates may be subnormal, which a device may take for 0. So all is decided by their bits: floats only tell what
//! is clear beyond doubt.

pub mod area;
pub mod collect;
pub mod indices;
pub mod offsets;
pub mod root;
pub mod settle;
pub mod sift;
pub mod vertices;

#[cfg(doc)]
use super::bin::ordered_bits;
use crate::{
    glam::UVec3,
    mem::{Buf, Slots},
};

words! {
    /// What is asked.
    Job {
        /// Vertices of the mesh.
        JOB_VERTICES vertices: u32,
        /// Triangles of the mesh.
        JOB_TRIANGLES triangles: u32,
        /// Coordinates of smaller magnitude, by the bits, are 0.
        JOB_DUST dust: u32,
        /// Whether triangles were marked before: only those can be marked again.
        JOB_AGAIN again: u32,
        /// Coordinates are multiplied by two to this power, which is 127 too large here.
        JOB_SCALE scale: u32,
        /// How many triangles are expected to take part.
        JOB_EXPECTED expected: u32,
    }
}

words! {
    /// What was found.
    Found {
        /// The first vertex with a coordinate that is not finite; `u32::MAX` for none.
        FOUND_VERTEX vertex: u32,
        /// The first triangle with an index that is out of range; `u32::MAX` for none.
        FOUND_TRIANGLE triangle: u32,
        /// Bits of that vertex, or the indices of that triangle.
        FOUND_WORDS words: [u32; 3],
        /// How many triangles take part.
        FOUND_KEPT kept: u32,
        /// The least coordinates of those, by [`ordered_bits`].
        FOUND_LO lo: [u32; 3],
        /// The greatest.
        FOUND_HI hi: [u32; 3],
        /// Bits of their least magnitude other than 0.
        FOUND_SMALLEST smallest: u32,
    }
}

impl Found {
    /// What is found of no triangle: kernels begin with it.
    pub const NOTHING: Self = Self {
        vertex: u32::MAX,
        triangle: u32::MAX,
        words: [0; 3],
        kept: 0,
        lo: [u32::MAX; 3],
        hi: [0; 3],
        smallest: u32::MAX,
    };
}

kernels! {
    /// The kernels of a survey, in the order in which they run.
    vertices::VERTICES,
    indices::INDICES,
    sift::SIFT,
    offsets::OFFSETS,
    collect::COLLECT,
    root::ROOT,
    settle::SETTLE,
}

/// Triangles of a block, for which [`sift`] takes a workgroup.
pub const BLOCK: u32 = 1024;
/// Words of its marks.
pub const MARKS: u32 = BLOCK / 32;

/// The magnitude, by the bits.
#[inline(always)]
const fn size(bits: u32) -> u32 {
    bits & 0x7FFF_FFFF
}

/// Whether bits are those of no finite number.
#[inline(always)]
const fn is_endless(bits: u32) -> bool {
    size(bits) >= 0x7F80_0000
}

/// The bits of vertex `v`.
#[inline(always)]
fn vertex(positions: &Buf<u32>, v: u32) -> UVec3 {
    UVec3::new(positions.at(3 * v), positions.at(3 * v + 1), positions.at(3 * v + 2))
}

/// The vertices of triangle `t`.
#[inline(always)]
fn corners(indices: &Buf<u32>, t: u32) -> UVec3 {
    UVec3::new(indices.at(3 * t), indices.at(3 * t + 1), indices.at(3 * t + 2))
}
