//! The best candidate of every cell, left with its first reference: one pass, which makes 32 candidates into
//! one.

use super::{CHEAPEST_BITS, Cell, LEVEL_REFS, better, cell_of};
use crate::{
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};

/// What reference `i` is left with, of candidates `2^pass.x` apart in its cell.
pub fn cheapest(
    i: u32,
    pass: &Buf<UVec2>,
    level: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    bests: &mut Buf<UVec4>,
) {
    if i < level.at(LEVEL_REFS) {
        let bits = pass.at(0).x;
        let cell = Cell::load(cells, cell_of(refs, i));
        let (place, step) = (i - cell.first, 1 << bits);
        if place + step < cell.count && place & ((step << CHEAPEST_BITS) - 1) == 0 {
            let mut best = bests.at(i);
            let mut other = place + step;
            let end = place + (step << CHEAPEST_BITS);
            while other < end && other < cell.count {
                best = better(best, bests.at(cell.first + other));
                other += step;
            }
            bests.put(i, best);
        }
    }
}

kernel! {
    /// [`cheapest`] over all references of a level.
    map CHEAPEST = cheapest, threads 128, {
        0 pass: read UVec2, 1 level: read u32, 2 refs: read UVec4, 3 cells: read UVec4, 4 bests: write UVec4,
    }
}
