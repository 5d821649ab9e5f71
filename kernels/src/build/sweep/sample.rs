//! What the cheapest plane of a cell costs at most: some of the candidates that [`super::weigh`] weighs, so that it can
//! rule most of the others out.

use super::{Cell, LEVEL_DEPTH, LEVEL_REFS, LISTS, NONE, cell_of, room, weigh::in_list};
use crate::{
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::BuildParams;

/// One of so many faces of a list is weighed.
pub const SHARE: u32 = 32;

/// Weighs face `i / LISTS * SHARE` of list `i % LISTS`, if its cell has lists.
pub fn sample(
    i: u32,
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    faces: &Buf<UVec2>,
    bounds: &mut Buf<u32>,
) {
    let (list, at) = (i % LISTS, i / LISTS * SHARE);
    if at < level.at(LEVEL_REFS) {
        let params = params.at(0);
        let number = cell_of(refs, at);
        let cell = Cell::load(cells, number);
        let sah = cell.sah(&params);
        if cell.count > params.small && sah.may_pay && level.at(LEVEL_DEPTH) < params.max_depth {
            let best = in_list(NONE, at, list, sah.leaf, &cell, &sah, faces, room(&params));
            // Costs are not negative: their bits order as they do.
            bounds.lower(number, best.x);
        }
    }
}

kernel! {
    /// [`sample`] over some faces of a level.
    map SAMPLE = sample, threads 128, {
        0 params: read BuildParams, 1 level: read u32, 2 refs: read UVec4, 3 cells: read UVec4, 4 faces: read UVec2,
        5 bounds: write u32,
    }
}
