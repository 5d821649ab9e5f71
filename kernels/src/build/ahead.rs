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
    mask: u32,
    mut triangle: impl FnMut(u32) -> u32,
) {
    if ON_GPU || !asks(group) {
        return;
    }
    let mut rest = mask;
    while rest != 0 {
        indices.soon(3 * triangle(rest.trailing_zeros()));
        rest &= rest - 1;
    }
    rest = mask;
    while rest != 0 {
        let (a, b, c) = indices.three(3 * triangle(rest.trailing_zeros()));
        positions.soon(3 * a);
        positions.soon(3 * b);
        positions.soon(3 * c);
        rest &= rest - 1;
    }
}
