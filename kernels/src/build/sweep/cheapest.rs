//! The best candidate of every cell, left with its first reference, of those that [`super::weigh`] leaves of each of
//! the blocks it reaches into: one pass, which makes 32 candidates into one.

use super::{CHEAPEST_BITS, Cell, LEVEL_REFS, better, cell_of, lesser, weigh::LANES};
use crate::{
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};

/// Where [`super::weigh`] leaves the candidate of a cell in the block so many behind that of its first reference.
#[inline(always)]
fn candidate_in(cell: &Cell, block: u32) -> u32 {
    if block == 0 { cell.first } else { (cell.first / LANES + block) * LANES }
}

/// Goes on with the cell to which the last reference of block `i` belongs: of its candidates, `2^pass.x` blocks apart,
/// makes 32 one.
pub fn cheapest(
    i: u32,
    pass: &Buf<UVec2>,
    level: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    bests: &mut Buf<UVec4>,
) {
    let (number, begin) = (level.at(LEVEL_REFS), i * LANES);
    if begin < number {
        let last = lesser(number, begin + LANES) - 1;
        let cell = Cell::load(cells, cell_of(refs, last));
        let (first, step) = (cell.first / LANES, 1 << pass.at(0).x);
        let (block, blocks) = (i - first, (cell.first + cell.count - 1) / LANES - first);
        if block + step <= blocks && block & ((step << CHEAPEST_BITS) - 1) == 0 {
            let to = candidate_in(&cell, block);
            let mut best = bests.at(to);
            let mut other = block + step;
            let end = block + (step << CHEAPEST_BITS);
            let last = if end <= blocks { end - step } else { block + (blocks - block) / step * step };
            while other <= last {
                // Read side by side: a GPU would wait for each. The last one may be read again.
                let a = bests.at(candidate_in(&cell, other));
                let b = bests.at(candidate_in(&cell, lesser(other + step, last)));
                let c = bests.at(candidate_in(&cell, lesser(other + 2 * step, last)));
                let d = bests.at(candidate_in(&cell, lesser(other + 3 * step, last)));
                best = better(best, better(better(a, b), better(c, d)));
                other += 4 * step;
            }
            bests.put(to, best);
        }
    }
}

kernel! {
    /// [`cheapest`] over all blocks of a level's references.
    map CHEAPEST = cheapest, threads 128, {
        0 pass: read UVec2, 1 level: read u32, 2 refs: read UVec4, 3 cells: read UVec4, 4 bests: write UVec4,
    }
}
