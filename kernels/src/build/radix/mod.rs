//! Sorts lists of one length by digits, the last first (Knuth 1998, section 5.2.5). An element's key is its first word
//! and the highest bit of its second; those with the same key keep their order. For each digit [`digits`] counts, block
//! by block, [`runs`] adds up, and [`deal`] moves.

pub mod deal;
pub mod digits;
pub mod runs;

kernels! {
    /// The kernels of one digit, in their order.
    digits::COUNT_DIGITS,
    runs::RUNS,
    deal::DEAL,
}

use super::row_of;
use crate::{
    glam::UVec2,
    mem::{Buf, Slots},
};

words! {
    /// What is sorted, and by which digit.
    Pass {
        /// The digit, the last being number 0.
        PASS_DIGIT digit: u32,
        /// Lists.
        PASS_LISTS lists: u32,
        /// Elements of each.
        PASS_ELEMENTS elements: u32,
        /// How many there is room for: from the start of one list to that of the next.
        PASS_ROOM room: u32,
    }
}

/// Bits of a digit. Five make the 33 of a key.
pub const DIGIT_BITS: u32 = 7;
/// How many digits a key has.
pub const DIGITS: u32 = 5;
/// How many values one has.
pub const VALUES: u32 = 1 << DIGIT_BITS;
/// Lanes of the workgroups that sort.
pub const LANES: u32 = 256;
/// Elements of a block, of which each lane has every 256th.
pub const BLOCK: u32 = 8 * LANES;

/// The value of a digit of an element.
#[inline(always)]
fn value(element: UVec2, digit: u32) -> u32 {
    let rest =
        if digit == 0 { (element.x << 1) | (element.y >> 31) } else { element.x >> (digit * DIGIT_BITS - 1) };
    rest & (VALUES - 1)
}

/// Where the counts of a list's elements with a value stand, block by block.
#[inline(always)]
fn run(list: u32, value: u32, blocks: u32) -> u32 {
    (list * VALUES + value) * blocks
}

/// The list of a workgroup and its block there, and the block's last element and one more: none if there is no such
/// list, as workgroups come in whole rows.
#[inline(always)]
fn block_of(group: u32, pass: &Buf<u32>) -> (u32, u32, u32) {
    let (lists, elements) = (pass.at(PASS_LISTS), pass.at(PASS_ELEMENTS));
    let (list, block) = row_of(group, elements.div_ceil(BLOCK), lists);
    let end = (block + 1) * BLOCK;
    let end = if end < elements { end } else { elements };
    (list, block, if list < lists { end } else { 0 })
}
