//! The best plane at the faces of each reference, or in large cells at six faces of their lists; of those that one cell
//! has in a block of references, the best.

use super::{
    AFTER_FLAT, Cell, LEVEL_DEPTH, LEVEL_REFS, LISTS, NONE, Reference, THREADS, better, candidate, cell_of,
    count_before, is_before, lesser, room,
};
use crate::{
    Group,
    build::{Sah, bin::ordered, bin::unordered},
    glam::{UVec2, UVec4},
    math::{component, low},
    mem::{Buf, PerLane, Slots},
};
use raykd_shared::BuildParams;

/// References that one workgroup weighs for.
pub const LANES: u32 = THREADS;
/// Words of the candidates of all lanes.
const WORDS: usize = 4 * LANES as usize;

/// How many boxes start before a plane, end by it, and lie in it, on one axis of a cell.
#[derive(Clone, Copy)]
struct Counts {
    before: u32,
    ended: u32,
    flat: u32,
}

impl Counts {
    const ZERO: Self = Self { before: 0, ended: 0, flat: 0 };

    #[inline(always)]
    fn add(&mut self, lo: f32, hi: f32, at: f32) {
        self.before += (lo < at) as u32;
        self.ended += (hi <= at) as u32;
        self.flat += ((lo == at) & (hi == at)) as u32;
    }
}

/// The better one of a candidate and those at a plane.
#[inline(always)]
fn consider(best: UVec4, sah: &Sah, axis: u32, at: u32, cell: &Cell, counts: &Counts) -> UVec4 {
    let across = sah.across(axis);
    let above = cell.count - counts.ended;
    let plane = unordered(at);
    let flat_above = across.cut(plane, counts.before as f32, (above + counts.flat) as f32);
    let flat_below = across.cut(plane, (counts.before + counts.flat) as f32, above as f32);
    better(better(best, candidate(flat_above, axis, at, true)), candidate(flat_below, axis, at, false))
}

/// The best plane at the box of reference `i`: all boxes of the cell are looked at.
#[inline(always)]
fn one_by_one(i: u32, cell: &Cell, sah: &Sah, refs: &Buf<UVec4>) -> UVec4 {
    let own = Reference::load(refs, i).bounds;
    let (mut lo_x, mut hi_x) = (Counts::ZERO, Counts::ZERO);
    let (mut lo_y, mut hi_y) = (Counts::ZERO, Counts::ZERO);
    let (mut lo_z, mut hi_z) = (Counts::ZERO, Counts::ZERO);
    let mut j = cell.first;
    while j < cell.first + cell.count {
        let its = Reference::load(refs, j).bounds;
        lo_x.add(its.lo.x, its.hi.x, own.lo.x);
        hi_x.add(its.lo.x, its.hi.x, own.hi.x);
        lo_y.add(its.lo.y, its.hi.y, own.lo.y);
        hi_y.add(its.lo.y, its.hi.y, own.hi.y);
        lo_z.add(its.lo.z, its.hi.z, own.lo.z);
        hi_z.add(its.lo.z, its.hi.z, own.hi.z);
        j += 1;
    }
    let mut best = consider(NONE, sah, 0, ordered(own.lo.x), cell, &lo_x);
    best = consider(best, sah, 0, ordered(own.hi.x), cell, &hi_x);
    best = consider(best, sah, 1, ordered(own.lo.y), cell, &lo_y);
    best = consider(best, sah, 1, ordered(own.hi.y), cell, &hi_y);
    best = consider(best, sah, 2, ordered(own.lo.z), cell, &lo_z);
    consider(best, sah, 2, ordered(own.hi.z), cell, &hi_z)
}

/// The better one of a candidate and that at face `i` of one list of an axis, unless it surely costs more than `bound`.
/// Of starts at one position the first counts, of ends the last: how many there are before it, or up to it, is then its
/// place.
#[inline(always)]
pub(super) fn in_list(
    best: UVec4,
    i: u32,
    list: u32,
    bound: f32,
    cell: &Cell,
    sah: &Sah,
    faces: &Buf<UVec2>,
    room: u32,
) -> UVec4 {
    let is_end = (list & 1) == 1;
    let axis = list >> 1;
    let starts = 2 * axis * room;
    let ends = starts + room;
    let (first, last) = (cell.first, cell.first + cell.count - 1);
    let at = faces.at(list * room + i).x;
    let beside = if is_end && i < last {
        i + 1
    } else if !is_end && i > first {
        i - 1
    } else {
        i
    };
    let plane = unordered(at);
    let mut counts = Counts { before: i - first, ended: i + 1 - first, flat: 0 };
    // A box ends no sooner than it starts, so at least so many are below and above. Boxes that lie in the plane may go
    // to either side: at a start this bounds the cut with them above, at an end the cut with them below. Each list
    // rules out one of the two ways.
    let (below, above) = if is_end {
        (counts.ended, cell.count - counts.ended)
    } else {
        (counts.before, cell.count - counts.before)
    };
    let least = sah.across(axis).least(plane, plane, below as f32, above as f32);
    let may_be_best = (least <= bound) | (below == 0) | (above == 0);
    let counts_here = beside == i || faces.at(list * room + beside).x != at;
    let is_inside = component(cell.bounds.lo, axis) < plane && plane < component(cell.bounds.hi, axis);
    if may_be_best && counts_here && is_inside {
        let (flat, after) = (UVec2::new(at, 0), UVec2::new(at, AFTER_FLAT));
        if is_end {
            counts.before = count_before(faces, starts + first, starts + last + 1, flat, false);
        } else {
            counts.ended = count_before(faces, ends + first, ends + last + 1, after, false);
        }
        let next = first + counts.before;
        if next <= last && !is_before(flat, faces.at(starts + next)) {
            counts.flat = count_before(faces, starts + next, starts + last + 1, after, false);
        }
        consider(best, sah, axis, at, cell, &counts)
    } else {
        best
    }
}

/// The best candidate at face `i` of each list, but those that surely cost more than `bound`.
#[inline(always)]
fn in_lists(i: u32, bound: f32, cell: &Cell, sah: &Sah, faces: &Buf<UVec2>, room: u32) -> UVec4 {
    let mut best = NONE;
    let mut list = 0;
    while list < LISTS {
        let least = low(bound, f32::from_bits(best.x));
        best = in_list(best, i, list, least, cell, sah, faces, room);
        list += 1;
    }
    best
}

/// The candidate that any plane which pays is better than.
#[inline(always)]
fn instead(sah: &Sah, cell: &Cell) -> UVec4 {
    let plane = sah.middle(cell.count);
    UVec4::new(NONE.x, plane.axis, ordered(plane.at), 1)
}

/// The best candidate for reference `i`, of cell `number`.
#[inline(always)]
fn best_of(
    i: u32,
    number: u32,
    params: &BuildParams,
    level: &Buf<u32>,
    refs: &Buf<UVec4>,
    cell: &Cell,
    faces: &Buf<UVec2>,
    bounds: &Buf<u32>,
) -> UVec4 {
    let sah = cell.sah(params);
    let mut best = NONE;
    if sah.may_pay && level.at(LEVEL_DEPTH) < params.max_depth {
        if cell.count > params.small {
            let bound = low(sah.leaf, f32::from_bits(bounds.at(number)));
            best = in_lists(i, bound, cell, &sah, faces, room(params));
        } else {
            best = one_by_one(i, cell, &sah, refs);
        }
        if f32::from_bits(best.x) >= sah.leaf {
            best = instead(&sah, cell);
        }
    }
    best
}

#[inline(always)]
fn put(table: &mut [u32; WORDS], lane: u32, candidate: UVec4) {
    table.put(lane, candidate.x);
    table.put(LANES + lane, candidate.y);
    table.put(2 * LANES + lane, candidate.z);
    table.put(3 * LANES + lane, candidate.w);
}

#[inline(always)]
fn at(table: &[u32; WORDS], lane: u32) -> UVec4 {
    UVec4::new(table.at(lane), table.at(LANES + lane), table.at(2 * LANES + lane), table.at(3 * LANES + lane))
}

/// Weighs for the references of block `group.id`. The best of those of one cell is left with the first of them.
#[inline(always)]
pub fn weigh(
    group: Group,
    table: &mut [u32; WORDS],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    faces: &Buf<UVec2>,
    bounds: &Buf<u32>,
    bests: &mut Buf<UVec4>,
) {
    let (number, base) = (level.at(LEVEL_REFS), group.id * LANES);
    // The lanes from which and up to which a lane's cell has references in the block.
    let mut spans = PerLane::<(u32, u32), { LANES as usize }>::default();
    lanes!(group, |lane| {
        let i = base + lane;
        if i < number {
            let number = cell_of(refs, i);
            let cell = Cell::load(cells, number);
            put(table, lane, best_of(i, number, &params.at(0), level, refs, &cell, faces, bounds));
            let from = lane - lesser(lane, i - cell.first);
            spans.put(lane, (from, lesser(cell.first + cell.count - base, LANES)));
        } else {
            spans.put(lane, (lane, 0));
        }
    });
    let mut step = 1;
    while step < LANES {
        lanes!(group, |lane| {
            let (from, to) = spans.at(lane);
            if (lane - from) & (2 * step - 1) == 0 && lane + step < to {
                put(table, lane, better(at(table, lane), at(table, lane + step)));
            }
        });
        step *= 2;
    }
    lanes!(group, |lane| {
        let (from, to) = spans.at(lane);
        if lane == from && lane < to {
            bests.put(base + lane, at(table, lane));
        }
    });
}

kernel! {
    /// [`weigh`] over all references of a level.
    group WEIGH = weigh, threads 128, shared [table: WORDS], {
        0 params: read BuildParams, 1 level: read u32, 2 refs: read UVec4, 3 cells: read UVec4, 4 faces: read UVec2,
        5 bounds: read u32, 6 bests: write UVec4,
    }
}
