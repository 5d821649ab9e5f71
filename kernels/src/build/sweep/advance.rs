//! The record of the next level, if there is room for it.

use super::{
    CLIPPED, FACES, LEAVES, LEVEL_CELLS, LEVEL_DEPTH, LEVEL_FRESH, LEVEL_LEAVES, LEVEL_LISTS, LEVEL_NODES,
    LEVEL_REFS, LISTS, OVER_BLOCKS, OVER_CELLS, OVER_FACES, OVER_FRESH, OVER_RANKS, OVER_REFERENCES,
    OVER_SAMPLES, STATE_CELLS, STATE_DEPTH, STATE_FRESH, STATE_LEVEL, STATE_LISTS, STATE_NODES, STATE_REFS,
    STATE_STATUS, THREADS, WHOLE, blocks, fresh_room, ranked, room, sample::SHARE, weigh::LANES,
};
use crate::{
    glam::UVec2,
    mem::{Buf, Slots},
    put_groups,
};
use raykd_shared::{BuildParams, status};

/// What a level holds: see [`record`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Level {
    /// Cells.
    pub cells: u32,
    /// References.
    pub refs: u32,
    /// Of these, clipped ones whose faces are sorted in.
    pub fresh: u32,
    /// Depth.
    pub depth: u32,
    /// Nodes of the levels above.
    pub nodes: u32,
    /// References of the leaves above.
    pub leaves: u32,
    /// [`LISTS`] if some of its cells may have lists, else 0.
    pub lists: u32,
}

/// Writes the record of a level.
#[inline(always)]
pub fn record(to: &mut (impl Slots<u32> + ?Sized), level: Level) {
    put_groups(to, OVER_REFERENCES, level.refs.div_ceil(THREADS));
    put_groups(to, OVER_CELLS, level.cells.div_ceil(THREADS));
    put_groups(to, OVER_RANKS, if level.cells > 0 { blocks(level.refs) } else { 0 });
    put_groups(to, OVER_FACES, (level.lists * level.refs).div_ceil(THREADS));
    put_groups(to, OVER_BLOCKS, level.refs.div_ceil(LANES).div_ceil(THREADS));
    put_groups(to, OVER_SAMPLES, (level.lists * level.refs.div_ceil(SHARE)).div_ceil(THREADS));
    put_groups(to, OVER_FRESH, (LISTS * level.fresh).div_ceil(THREADS));
    to.put(LEVEL_CELLS, level.cells);
    to.put(LEVEL_REFS, level.refs);
    to.put(LEVEL_FRESH, level.fresh);
    to.put(LEVEL_DEPTH, level.depth);
    to.put(LEVEL_NODES, level.nodes);
    to.put(LEVEL_LEAVES, level.leaves);
    to.put(LEVEL_LISTS, level.lists);
}

/// Goes on to the next level. The state says what was needed if it does not fit.
pub fn advance(
    i: u32,
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    ranks: &Buf<u32>,
    totals: &Buf<UVec2>,
    next_level: &mut Buf<u32>,
    state: &mut Buf<u32>,
) {
    if i == 0 {
        let params = params.at(0);
        let nodes = level.at(LEVEL_NODES) + level.at(LEVEL_CELLS);
        let mut next = Level { cells: 0, refs: 0, fresh: 0, depth: 0, nodes: 0, leaves: 0, lists: 0 };
        if level.at(LEVEL_CELLS) > 0 {
            let (room, number) = (room(&params), level.at(LEVEL_REFS));
            let whole = ranked(ranks, totals, room, WHOLE, number);
            let clipped = ranked(ranks, totals, room, CLIPPED, number);
            let leaves = ranked(ranks, totals, room, LEAVES, number);
            let fresh = clipped.x + clipped.y;
            let mut listed = fresh;
            if level.at(LEVEL_LISTS) > 0 {
                let carried = ranked(ranks, totals, room, FACES, number);
                listed += carried.x + carried.y;
            }
            next = Level {
                cells: 2 * leaves.y,
                refs: whole.x + whole.y + fresh,
                fresh,
                depth: level.at(LEVEL_DEPTH) + 1,
                nodes,
                leaves: level.at(LEVEL_LEAVES) + leaves.x,
                lists: if listed > 0 { LISTS } else { 0 },
            };
            state.put(STATE_DEPTH, level.at(LEVEL_DEPTH));
            state.put(STATE_NODES, nodes);
            state.put(STATE_REFS, next.leaves);
            state.put(STATE_CELLS, next.cells);
            state.put(STATE_LEVEL, next.refs);
            state.put(STATE_FRESH, fresh);
            state.put(STATE_LISTS, next.lists);
            let fits = next.refs <= room
                && fresh <= fresh_room(room)
                && next.cells <= params.active
                && nodes + next.cells <= params.treelets
                && next.leaves <= params.treelet_refs;
            if !fits {
                state.put(STATE_STATUS, status::CAPACITY);
                next = Level { cells: 0, refs: 0, fresh: 0, ..next };
            }
        }
        record(next_level, next);
    }
}

kernel! {
    /// [`advance`]; a single lane.
    map ADVANCE = advance, threads 1, {
        0 params: read BuildParams, 1 level: read u32, 2 ranks: read u32, 3 totals: read UVec2,
        4 next_level: write u32, 5 state: write u32,
    }
}
