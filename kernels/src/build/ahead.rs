//! What a CPU asks its memory for before it reads it; a GPU has other lanes to run while it waits.

use crate::{
    Group, ON_GPU,
    kernel::Bits,
    mem::{Buf, Slots},
};

/// Only where references are gone through one by one; and it reads lists, which counts where bytes are counted.
#[inline(always)]
fn asks(group: Group) -> bool {
    group.sharers() == 1 && cfg!(not(feature = "traffic"))
}

/// Asks where the corners of the triangles stand whose bits are set.
#[inline(always)]
pub(super) fn indices(group: Group, indices: &Buf<u32>, mask: u32, triangle: impl Fn(u32) -> u32) {
    if ON_GPU || !asks(group) {
        return;
    }
    for i in Bits(mask) {
        indices.soon(3 * triangle(i));
    }
}

/// Asks for the corners of the triangles whose bits are set. It reads where they stand: [`indices`] asked for that.
#[inline(always)]
pub(super) fn corners(
    group: Group,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    mask: u32,
    triangle: impl Fn(u32) -> u32,
) {
    if ON_GPU || !asks(group) {
        return;
    }
    for i in Bits(mask) {
        let (a, b, c) = indices.three(3 * triangle(i));
        positions.soon(3 * a);
        positions.soon(3 * b);
        positions.soon(3 * c);
    }
}
