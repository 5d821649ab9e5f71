//! What a CPU asks its memory for before it reads it; a GPU has other lanes to run while it waits.

use crate::{
    Group, ON_GPU,
    mem::{Buf, Slots},
};

/// Only where references are gone through one by one; and it reads lists, which counts where bytes are counted.
#[inline(always)]
fn asks(group: Group) -> bool {
    group.sharers() == 1 && cfg!(not(feature = "traffic"))
}

/// Asks for the triangles whose bits are set.
#[inline(always)]
pub(super) fn triangles(
    group: Group,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    mut mask: u32,
    triangle: impl Fn(u32) -> u32,
) {
    while !ON_GPU && asks(group) && mask != 0 {
        let (a, b, c) = indices.three(3 * triangle(mask.trailing_zeros()));
        positions.soon(3 * a);
        positions.soon(3 * b);
        positions.soon(3 * c);
        mask &= mask - 1;
    }
}
