//! The triangles of the leaves, laid out as the leaves list them: one cache line or two instead of three jumps.

use crate::{
    glam::{Vec3, Vec4},
    mem::{Buf, Slots},
    mesh::triangle,
    trace::intersect::{Corners, Intersector, NORMAL, baldwin::Baldwin, strict::Strict},
};
use raykd_shared::TreeHeader;

/// What leaves keep of triangle `id` for a test; the first vector's `w` holds its number, see [`NORMAL`].
#[inline(always)]
pub fn kept<I: Intersector>(id: u32, (a, b, c): (Vec3, Vec3, Vec3)) -> Corners {
    let (a, b, c) = I::lay_out(a, b, c);
    (a.truncate().extend(f32::from_bits(id | NORMAL)), b, c)
}

/// Writes the triangle of reference `i` as a triangle test wants it.
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
        let (a, b, c) = kept::<I>(id, triangle(positions, indices, id));
        corners.put(3 * i, a);
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
