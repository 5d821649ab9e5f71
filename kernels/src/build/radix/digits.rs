//! How many elements of each block have which value of a digit.

use super::{Block, LANES, VALUES, value};
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
    let block = Block::of(group.id, pass);
    lanes!(group, |lane| {
        if lane < VALUES {
            values.put(lane, 0);
        }
    });
    lanes!(group, |lane| {
        let mut i = block.start + lane;
        while i < block.end {
            values.add(value(from.at(block.base + i), block.digit), 1);
            i += LANES;
        }
    });
    lanes!(group, |lane| {
        if lane < VALUES && block.end > 0 {
            counts.put(block.count(lane), values.at(lane));
        }
    });
}

kernel! {
    /// [`digits`] over all blocks of all lists.
    group COUNT_DIGITS = digits, threads 256, shared [values: VALUES as usize], {
        0 pass: read u32, 1 from: read UVec2, 2 counts: write u32,
    }
}
