//! Sorts the faces of references that were clipped, list by list and cell by cell: one pass of a merge sort.

use super::{Cell, LEVEL_FRESH, LISTS, REFERENCE, SORT_BITS, cell_of, count_before};
use crate::{
    build::row_of,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// Moves face `i`: in runs of `2^pass.x` that are sorted, sixteen runs become one. A list has room for `pass.y`.
pub fn sort(
    i: u32,
    params: &Buf<BuildParams>,
    pass: &Buf<UVec2>,
    level: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    from: &Buf<UVec2>,
    to: &mut Buf<UVec2>,
) {
    let number = level.at(LEVEL_FRESH);
    if i < LISTS * number {
        let (bits, room) = (pass.at(0).x, pass.at(0).y);
        let (list, at) = row_of(i, number, LISTS);
        let base = list * room;
        let face = from.at(base + at);
        let cell = Cell::load(cells, cell_of(refs, face.y & REFERENCE));
        let mut target = base + at;
        // Cells without lists need no order.
        if cell.count > params.at(0).small {
            let (first, end) = (base + cell.fresh, base + cell.fresh + cell.freshes);
            let place = at - cell.fresh;
            let run = place >> bits;
            let mut other = (run >> SORT_BITS) << SORT_BITS;
            let mut before = (other << bits) + (place - (run << bits));
            let last = other + (1 << SORT_BITS);
            while other < last && first + (other << bits) < end {
                if other != run {
                    let begin = first + (other << bits);
                    let stop = if end - begin > (1 << bits) { begin + (1 << bits) } else { end };
                    before += count_before(from, begin, stop, face, other < run);
                }
                other += 1;
            }
            target = first + before;
        }
        to.put(target, face);
    }
}

kernel! {
    /// [`sort`] over the faces of all references that were clipped.
    map SORT = sort, threads 128, {
        0 params: read BuildParams, 1 pass: read UVec2, 2 level: read u32, 3 refs: read UVec4, 4 cells: read UVec4,
        5 from: read UVec2, 6 to: write UVec2,
    }
}
