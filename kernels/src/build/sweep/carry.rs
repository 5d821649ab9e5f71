//! Moves the faces of references that stay whole to the children's lists, in order, and leaves gaps for the
//! others.

use super::{
    Cell, FACES, LEAVES, LEVEL_REFS, LISTS, REFERENCE, STATE_STATUS, cell_of, count_before, fresh_room, pick,
    ranked, room, sides_of,
};
use crate::{
    build::row_of,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// Moves face `i`, counted through all lists of the level.
pub fn carry(
    i: u32,
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    state: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    ranks: &Buf<u32>,
    totals: &Buf<UVec2>,
    next_cells: &Buf<UVec4>,
    moved: &Buf<u32>,
    fresh: &Buf<UVec2>,
    faces: &Buf<UVec2>,
    next_faces: &mut Buf<UVec2>,
) {
    let number = level.at(LEVEL_REFS);
    if i < LISTS * number && state.at(STATE_STATUS) == 0 {
        let params = params.at(0);
        let room = room(&params);
        let (list, at) = row_of(i, number, LISTS);
        let row = FACES + list;
        let side = sides_of(ranks, room, row, at);
        if side != 0 {
            let above = side >> 1;
            let first = Cell::load(cells, cell_of(refs, at)).first;
            let pair = 2 * ranked(ranks, totals, room, LEAVES, first).y;
            let child = Cell::load(next_cells, pair + above);
            if child.count > params.small {
                let face = faces.at(list * room + at);
                let before = pick(ranked(ranks, totals, room, row, at), above)
                    - pick(ranked(ranks, totals, room, row, first), above);
                let from = list * fresh_room(room) + child.fresh;
                let merged = count_before(fresh, from, from + child.freshes, face, false);
                let kind = face.y & !REFERENCE;
                next_faces.put(
                    list * room + child.first + before + merged,
                    UVec2::new(face.x, kind | moved.at(face.y & REFERENCE)),
                );
            }
        }
    }
}

kernel! {
    /// [`carry`] over all faces of a level.
    map CARRY = carry, threads 128, {
        0 params: read BuildParams, 1 level: read u32, 2 state: read u32, 3 refs: read UVec4, 4 cells: read UVec4,
        5 ranks: read u32, 6 totals: read UVec2, 7 next_cells: read UVec4, 8 moved: read u32, 9 fresh: read UVec2,
        10 faces: read UVec2, 11 next_faces: write UVec2,
    }
}
