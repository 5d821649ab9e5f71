//! The nodes of a level, and the cells of the next.

use super::{
    CLIPPED, Cell, LEAVES, LEVEL_CELLS, LEVEL_LEAVES, LEVEL_NODES, STATE_STATUS, WHOLE, decide, in_two,
    ranked, room,
};
use crate::{
    build::growth_left,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::{BuildParams, Node};

/// What the cheapest plane of a cell costs at most, as long as nothing is known.
pub const NO_BOUND: u32 = f32::INFINITY.to_bits();

/// Writes node `i` of the level and its two children. Nodes are numbered level by level for now.
pub fn children(
    i: u32,
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    state: &Buf<u32>,
    cells: &Buf<UVec4>,
    bests: &Buf<UVec4>,
    ranks: &Buf<u32>,
    totals: &Buf<UVec2>,
    next_cells: &mut Buf<UVec4>,
    bounds: &mut Buf<u32>,
    tree: &mut Buf<UVec2>,
) {
    let number = level.at(LEVEL_CELLS);
    if i < number && state.at(STATE_STATUS) == 0 {
        let params = params.at(0);
        let room = room(&params);
        let cell = Cell::load(cells, i);
        let (from, to) = (cell.first, cell.first + cell.count);
        let plane = decide(&cell, bests).plane;
        let place = ranked(ranks, totals, room, LEAVES, from);
        let mut node = Node::leaf(level.at(LEVEL_LEAVES) + place.x, cell.count);
        if plane.axis != Node::LEAF {
            let pair = 2 * place.y;
            node = Node::inner(plane.axis, plane.at, level.at(LEVEL_NODES) + number + pair);
            let whole = ranked(ranks, totals, room, WHOLE, from);
            let clipped = ranked(ranks, totals, room, CLIPPED, from);
            let whole_end = ranked(ranks, totals, room, WHOLE, to);
            let clipped_end = ranked(ranks, totals, room, CLIPPED, to);
            let (below, above) = in_two(&cell.bounds, plane);
            let fresh = clipped.x + clipped.y;
            let (freshes, beside_freshes) = (clipped_end.x - clipped.x, clipped_end.y - clipped.y);
            let count = whole_end.x - whole.x + freshes;
            let beside_count = whole_end.y - whole.y + beside_freshes;
            let growth = growth_left(cell.growth, cell.count, count + beside_count, plane.pays);
            let child = Cell {
                first: whole.x + whole.y + fresh,
                count,
                fresh,
                freshes,
                parent: i,
                bounds: below,
                growth,
            };
            child.store(next_cells, pair);
            let beside = Cell {
                first: child.first + count,
                count: beside_count,
                fresh: fresh + freshes,
                freshes: beside_freshes,
                parent: i,
                bounds: above,
                growth,
            };
            beside.store(next_cells, pair + 1);
            bounds.put(pair, NO_BOUND);
            bounds.put(pair + 1, NO_BOUND);
        }
        let (word0, word1) = node.words();
        tree.put(level.at(LEVEL_NODES) + i, UVec2::new(word0, word1));
    }
}

kernel! {
    /// [`children`] over all cells of a level.
    map CHILDREN = children, threads 128, {
        0 params: read BuildParams, 1 level: read u32, 2 state: read u32, 3 cells: read UVec4, 4 bests: read UVec4,
        5 ranks: read u32, 6 totals: read UVec2, 7 next_cells: write UVec4, 8 bounds: write u32,
        9 tree: write UVec2,
    }
}
