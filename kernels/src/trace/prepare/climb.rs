//! From a node up to the root.

use crate::{
    glam::UVec4,
    mem::{Buf, Slots, scratch},
    trace::place::Place,
};
use raykd_shared::TreeHeader;

/// Beyond this side there is nothing.
pub const NONE: u32 = u32::MAX;

/// The box of a node: lower corner, upper corner. It is found by climbing to the root: on each side the first
/// plane met bounds it, and `met` is told the side (`3 * upper + axis`) and the child that lies beyond.
#[inline(always)]
pub fn climb(
    i: u32,
    header: &TreeHeader,
    pairs: &Buf<UVec4>,
    parents: &Buf<u32>,
    beyond: &mut [u32; 6],
) -> [f32; 6] {
    let mut sides = scratch::<f32, 6>();
    let mut side = 0;
    while side < 3 {
        sides.put(side, header.lo[side as usize]);
        sides.put(side + 3, header.hi[side as usize]);
        beyond.put(side, NONE);
        beyond.put(side + 3, NONE);
        side += 1;
    }
    let mut child = i;
    while child != 0 {
        let up = parents.at(child >> 1);
        let node = Place::load(up, pairs).node;
        // A child above its parent's plane has that plane on its lower side.
        let side = node.axis() + if child & 1 == 0 { 3 } else { 0 };
        if beyond.at(side) == NONE {
            sides.put(side, node.split());
            beyond.put(side, child ^ 1);
        }
        child = up;
    }
    sides
}
