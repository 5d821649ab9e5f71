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

/// A workgroup's block of a list, and the digit by which its elements are sorted.
struct Block {
    digit: u32,
    list: u32,
    /// Its number, and how many a list has.
    number: u32,
    blocks: u32,
    /// Where the list starts.
    base: u32,
    /// Its elements in the list: the first, and the last and one more. None if there is no such list, as workgroups
    /// come in whole rows.
    start: u32,
    end: u32,
}

impl Block {
    #[inline(always)]
    fn of(group: u32, pass: &Buf<u32>) -> Self {
        let (lists, elements) = (pass.at(PASS_LISTS), pass.at(PASS_ELEMENTS));
        let blocks = elements.div_ceil(BLOCK);
        let (list, number) = row_of(group, blocks, lists);
        let end = (number + 1) * BLOCK;
        let end = if end < elements { end } else { elements };
        Self {
            digit: pass.at(PASS_DIGIT),
            list,
            number,
            blocks,
            base: list * pass.at(PASS_ROOM),
            start: number * BLOCK,
            end: if list < lists { end } else { 0 },
        }
    }

    /// Where the count of its elements with a value stands: value by value, those of a list's blocks in turn.
    #[inline(always)]
    fn count(&self, value: u32) -> u32 {
        (self.list * VALUES + value) * self.blocks + self.number
    }
}
