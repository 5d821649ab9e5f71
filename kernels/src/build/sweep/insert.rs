//! Puts the faces of references that were clipped among those that [`super::carry`] moves.

use super::{
    Cell, FACES, LEVEL_FRESH, LISTS, REFERENCE, cell_of, count_before, fresh_room, pick, ranked, room,
};
use crate::{
    build::row_of,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// Moves face `i`, counted through the sorted lists of new faces.
pub fn insert(
    i: u32,
    params: &Buf<BuildParams>,
    cells: &Buf<UVec4>,
    ranks: &Buf<u32>,
    totals: &Buf<UVec2>,
    next_level: &Buf<u32>,
    next_refs: &Buf<UVec4>,
    next_cells: &Buf<UVec4>,
    fresh: &Buf<UVec2>,
    faces: &Buf<UVec2>,
    next_faces: &mut Buf<UVec2>,
) {
    let number = next_level.at(LEVEL_FRESH);
    if i < LISTS * number {
        let params = params.at(0);
        let room = room(&params);
        let (list, at) = row_of(i, number, LISTS);
        let face = fresh.at(list * fresh_room(room) + at);
        let place = cell_of(next_refs, face.y & REFERENCE);
        let child = Cell::load(next_cells, place);
        if child.count > params.small {
            let parent = Cell::load(cells, child.parent);
            let base = list * room;
            let (from, to) = (base + parent.first, base + parent.first + parent.count);
            let passed = count_before(faces, from, to, face, true);
            let row = FACES + list;
            let before = ranked(ranks, totals, room, row, parent.first + passed)
                - ranked(ranks, totals, room, row, parent.first);
            next_faces.put(base + child.first + (at - child.fresh) + pick(before, place & 1), face);
        }
    }
}

kernel! {
    /// [`insert`] over the faces of all references that were clipped.
    map INSERT = insert, threads 128, {
        0 params: read BuildParams, 1 cells: read UVec4, 2 ranks: read u32, 3 totals: read UVec2,
        4 next_level: read u32, 5 next_refs: read UVec4, 6 next_cells: read UVec4, 7 fresh: read UVec2,
        8 faces: read UVec2, 9 next_faces: write UVec2,
    }
}
