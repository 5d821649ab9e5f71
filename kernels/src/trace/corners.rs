//! The triangles of the leaves, laid out as the leaves list them: one cache line or two instead of three jumps.

use super::{baldwin::Baldwin, intersector::Intersector, triangle::Strict};
use crate::{
    glam::Vec4,
    mem::{Buf, Slots},
    mesh::triangle,
};
use raykd_shared::TreeHeader;

/// Added to a triangle's number where it stands among floats: alone its bits are those of a subnormal, and CPUs that
/// compute all four lanes of a vector take a hundred cycles for one, needed or not.
pub const NORMAL: u32 = 0x4000_0000;

/// Writes the triangle of reference `i` as a triangle test wants it; the first vector's `w` holds its number, see
/// [`NORMAL`].
pub fn lay_out<I: Intersector>(
    i: u32,
    header: &Buf<TreeHeader>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<u32>,
    corners: &mut Buf<Vec4>,
) {
    if i < header.at(0).refs {
        let id = refs.at(i);
        let (a, b, c) = triangle(positions, indices, id);
        let (a, b, c) = I::lay_out(a, b, c);
        corners.put(3 * i, a.truncate().extend(f32::from_bits(id | NORMAL)));
        corners.put(3 * i + 1, b);
        corners.put(3 * i + 2, c);
    }
}

kernel! {
    /// The corners of all references, for most tests.
    map CORNERS = lay_out::<Strict>, threads 64, {
        0 header: read TreeHeader, 1 positions: read f32, 2 indices: read u32, 3 refs: read u32,
        4 corners: write Vec4,
    }
}

/// What Baldwin & Weber's test keeps instead of corners.
pub mod transforms {
    use super::{Baldwin, TreeHeader, Vec4, lay_out};

    kernel! {
        /// The transformations of all references.
        map TRANSFORMS = lay_out::<Baldwin>, threads 64, {
            0 header: read TreeHeader, 1 positions: read f32, 2 indices: read u32, 3 refs: read u32,
            4 corners: write Vec4,
        }
    }
}
