//! Moves the references of a level to the children's, in order, and to the list of the leaves.

use super::{
    BELOW, CLIPPED, CLIPPED_SHIFT, CUT, Cell, LEAF, LEAVES, LEVEL_LEAVES, LEVEL_NODES, LEVEL_REFS, LISTS,
    Reference, STATE_STATUS, WHOLE, decide, face, fresh_room, in_two, pick, ranked, room,
};
use crate::{
    build::clip::clip_plane,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
    mesh::triangle,
};
use raykd_shared::{BuildParams, rule};

/// Moves reference `i`. `moved` gets the new number of one that stays whole; the faces of others are new.
pub fn distribute(
    i: u32,
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    level: &Buf<u32>,
    state: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    bests: &Buf<UVec4>,
    codes: &Buf<u32>,
    ranks: &Buf<u32>,
    totals: &Buf<UVec2>,
    next_cells: &Buf<UVec4>,
    next_refs: &mut Buf<UVec4>,
    moved: &mut Buf<u32>,
    fresh: &mut Buf<UVec2>,
    listed: &mut Buf<UVec2>,
) {
    if i < level.at(LEVEL_REFS) && state.at(STATE_STATUS) == 0 {
        let params = params.at(0);
        let room = room(&params);
        let code = codes.at(i);
        let reference = Reference::load(refs, i);
        let leaves = ranked(ranks, totals, room, LEAVES, i);
        if (code & LEAF) != 0 {
            let to = level.at(LEVEL_LEAVES) + leaves.x;
            listed.put(to, UVec2::new(reference.triangle, level.at(LEVEL_NODES) + reference.cell));
        } else {
            let cell = Cell::load(cells, reference.cell);
            let mut parts = (reference.bounds, reference.bounds);
            if (code & CUT) != 0 {
                let plane = decide(&cell, bests).plane;
                parts = in_two(&reference.bounds, plane);
                if (params.rule & rule::CLIP) != 0 {
                    let (a, b, c) = triangle(positions, indices, reference.triangle);
                    parts = clip_plane(a, b, c, &reference.bounds, plane.axis, plane.at);
                }
            }
            let pair = 2 * ranked(ranks, totals, room, LEAVES, cell.first).y;
            let whole =
                ranked(ranks, totals, room, WHOLE, i) - ranked(ranks, totals, room, WHOLE, cell.first);
            let clipped =
                ranked(ranks, totals, room, CLIPPED, i) - ranked(ranks, totals, room, CLIPPED, cell.first);
            let mut side = 0;
            while side < 2 {
                let stays = (code & (BELOW << side)) != 0;
                let is_fresh = (code & (BELOW << (side + CLIPPED_SHIFT))) != 0;
                if stays || is_fresh {
                    let child = Cell::load(next_cells, pair + side);
                    let to = child.first + pick(whole, side) + pick(clipped, side);
                    let bounds = if side == 0 { parts.0 } else { parts.1 };
                    let made = Reference { triangle: reference.triangle, cell: pair + side, bounds };
                    made.store(next_refs, to);
                    if is_fresh {
                        let at = child.fresh + pick(clipped, side);
                        let mut list = 0;
                        while list < LISTS {
                            fresh.put(list * fresh_room(room) + at, face(&made.bounds, list, to));
                            list += 1;
                        }
                    } else if (code & CUT) == 0 {
                        moved.put(i, to);
                    }
                }
                side += 1;
            }
        }
    }
}

kernel! {
    /// [`distribute`] over all references of a level.
    map DISTRIBUTE = distribute, threads 128, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32, 4 state: read u32,
        5 refs: read UVec4, 6 cells: read UVec4, 7 bests: read UVec4, 8 codes: read u32, 9 ranks: read u32,
        10 totals: read UVec2, 11 next_cells: read UVec4, 12 next_refs: write UVec4, 13 moved: write u32,
        14 fresh: write UVec2, 15 listed: write UVec2,
    }
}
