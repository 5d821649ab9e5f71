//! The root's lists of faces are sorted by digits, the last first (Knuth 1998, section 5.2.5). How many faces of each
//! block have which digit; [`super::runs`] and [`super::deal`] follow.

use super::{LEVEL_LISTS, LEVEL_REFS, row_of};
use crate::{
    Group,
    glam::UVec2,
    mem::{Atomics, Buf, Slots},
};

/// Bits of a digit. Five make the 33 by which faces are ordered: position, and whether the box is flat.
pub const DIGIT_BITS: u32 = 7;
/// How many digits a face has.
pub const DIGITS: u32 = 5;
/// How many values one has.
pub const VALUES: u32 = 1 << DIGIT_BITS;
/// Lanes of the workgroups that sort.
pub const LANES: u32 = 256;
/// Faces of a block, of which each lane has every 256th.
pub const BLOCK: u32 = 8 * LANES;

/// The value of digit number `digit` of a face, the last being number 0.
#[inline(always)]
pub(super) fn value(face: UVec2, digit: u32) -> u32 {
    let rest = if digit == 0 { (face.x << 1) | (face.y >> 31) } else { face.x >> (digit * DIGIT_BITS - 1) };
    rest & (VALUES - 1)
}

/// Where the counts of a list's faces with a value stand, block by block.
#[inline(always)]
pub(super) fn run(list: u32, value: u32, blocks: u32) -> u32 {
    (list * VALUES + value) * blocks
}

/// The last face of a block of a list, and one more; none if there is no such list: workgroups come in whole rows.
#[inline(always)]
pub(super) fn end_of(list: u32, block: u32, level: &Buf<u32>) -> u32 {
    let number = level.at(LEVEL_REFS);
    let end = (block + 1) * BLOCK;
    if list >= level.at(LEVEL_LISTS) {
        0
    } else if end < number {
        end
    } else {
        number
    }
}

/// Counts in a block of a list, by the digit number `pass.x`. A list has room for `pass.y`.
pub fn digits(
    group: Group,
    values: &mut [u32; VALUES as usize],
    pass: &Buf<UVec2>,
    level: &Buf<u32>,
    from: &Buf<UVec2>,
    counts: &mut Buf<u32>,
) {
    let number = level.at(LEVEL_REFS);
    let (digit, room) = (pass.at(0).x, pass.at(0).y);
    let blocks = number.div_ceil(BLOCK);
    let (list, block) = row_of(group.id, blocks);
    let end = end_of(list, block, level);
    lanes!(group, |lane| {
        if lane < VALUES {
            values.put(lane, 0);
        }
    });
    lanes!(group, |lane| {
        let mut i = block * BLOCK + lane;
        while i < end {
            values.add(value(from.at(list * room + i), digit), 1);
            i += LANES;
        }
    });
    lanes!(group, |lane| {
        if lane < VALUES && list < level.at(LEVEL_LISTS) {
            counts.put(run(list, lane, blocks) + block, values.at(lane));
        }
    });
}

kernel! {
    /// [`digits`] over all blocks of the root's lists.
    group COUNT_DIGITS = digits, threads 256, shared [values: VALUES as usize], {
        0 pass: read UVec2, 1 level: read u32, 2 from: read UVec2, 3 counts: write u32,
    }
}
