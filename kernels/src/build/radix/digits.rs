//! How many elements of each block have which value of a digit.

use super::{BLOCK, LANES, PASS_DIGIT, PASS_ELEMENTS, PASS_LISTS, PASS_ROOM, VALUES, block_of, run, value};
use crate::{
    Group,
    glam::UVec2,
    mem::{Atomics, Buf, Slots},
};

/// Counts in a block of a list.
pub fn digits(
    group: Group,
    values: &mut [u32; VALUES as usize],
    pass: &Buf<u32>,
    from: &Buf<UVec2>,
    counts: &mut Buf<u32>,
) {
    let digit = pass.at(PASS_DIGIT);
    let blocks = pass.at(PASS_ELEMENTS).div_ceil(BLOCK);
    let (list, block, end) = block_of(group.id, pass);
    let base = list * pass.at(PASS_ROOM);
    lanes!(group, |lane| {
        if lane < VALUES {
            values.put(lane, 0);
        }
    });
    lanes!(group, |lane| {
        let mut i = block * BLOCK + lane;
        while i < end {
            values.add(value(from.at(base + i), digit), 1);
            i += LANES;
        }
    });
    lanes!(group, |lane| {
        if lane < VALUES && list < pass.at(PASS_LISTS) {
            counts.put(run(list, lane, blocks) + block, values.at(lane));
        }
    });
}

kernel! {
    /// [`digits`] over all blocks of all lists.
    group COUNT_DIGITS = digits, threads 256, shared [values: VALUES as usize], {
        0 pass: read u32, 1 from: read UVec2, 2 counts: write u32,
    }
}
