//! The triangles of the leaves, laid out as the leaves list them: one cache line or two instead of three jumps.

use crate::{
    build::boxes::vertex,
    glam::Vec4,
    mem::{Buf, Slots},
};
use raykd_shared::TreeHeader;

/// Added to a triangle's number where it stands among floats: alone its bits are those of a subnormal, and CPUs that
/// compute all four lanes of a vector take a hundred cycles for one, needed or not.
pub const NORMAL: u32 = 0x4000_0000;

/// Writes the triangle of reference `i` as three points; the first one's `w` holds its number, see [`NORMAL`].
pub fn lay_out(
    i: u32,
    header: &Buf<TreeHeader>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<u32>,
    corners: &mut Buf<Vec4>,
) {
    if i < header.at(0).refs {
        let id = refs.at(i);
        corners.put(3 * i, vertex(positions, indices, id, 0).extend(f32::from_bits(id | NORMAL)));
        corners.put(3 * i + 1, vertex(positions, indices, id, 1).extend(0.0));
        corners.put(3 * i + 2, vertex(positions, indices, id, 2).extend(0.0));
    }
}

kernel! {
    /// [`lay_out`] over all references.
    map CORNERS = lay_out, threads 64, {
        0 header: read TreeHeader, 1 positions: read f32, 2 indices: read u32, 3 refs: read u32,
        4 corners: write Vec4,
    }
}
