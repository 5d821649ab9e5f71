//! What a CPU asks its memory for before it reads it; a GPU has other lanes to run while it waits.

use crate::{
    Group, Order,
    glam::Vec4,
    mem::{Buf, Slots},
};

/// How many references ahead boxes are asked for.
const AHEAD: u32 = 24;

/// Only where references are gone through one by one; and it reads lists, which counts where bytes are counted.
#[inline(always)]
fn asks(group: Group) -> bool {
    group.order == Order::Forward && cfg!(not(feature = "traffic"))
}

/// Asks for the boxes that [`next`] does not.
#[inline(always)]
pub(super) fn first(group: Group, refs: &Buf<u32>, start: u32, count: u32, boxes: &Buf<Vec4>) {
    if asks(group) {
        for i in start..start + count.min(AHEAD) {
            boxes.soon(2 * refs.at(i));
        }
    }
}

/// Where reference `i` of `count` is read, asks for the box of a later one.
#[inline(always)]
pub(super) fn next(group: Group, refs: &Buf<u32>, start: u32, i: u32, count: u32, boxes: &Buf<Vec4>) {
    if asks(group) && i + AHEAD < count {
        boxes.soon(2 * refs.at(start + i + AHEAD));
    }
}

/// Asks for the triangles of the references from `first` on whose bits are set.
#[inline(always)]
pub(super) fn triangles(
    group: Group,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<u32>,
    first: u32,
    mut mask: u32,
) {
    while asks(group) && mask != 0 {
        let (a, b, c) = indices.three(3 * refs.at(first + mask.trailing_zeros()));
        positions.soon(3 * a);
        positions.soon(3 * b);
        positions.soon(3 * c);
        mask &= mask - 1;
    }
}
