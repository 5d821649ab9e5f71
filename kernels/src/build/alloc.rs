//! Gives every child of a level its place: tree slots, next level's lists, branches.
//!
//! Counts, scan, write: [`super::tally`] counted, so the order of everything is that of the nodes.

use super::{
    ARGS_ACTIVE, ARGS_BLOCKS, ARGS_CHUNKS, Item, LEVEL_ACTIVE, LEVEL_BRANCH_ROOM, LEVEL_BRANCHES,
    LEVEL_CHUNKS, LEVEL_DEPTH, LEVEL_FITS, LEVEL_REFS, LEVEL_TOP, STATE_LEVELS, STATE_STATUS,
    branch::{Next, branches, put_round, room},
    cut, growth_left, plane_of,
    scan::{LANES, before, total},
    tally::{
        ACTIVE, BLOCKS, BRANCH_ROOM, BRANCHES, CHUNKS, KINDS, PAIRS, REFS, SUMS, blocks_of,
        count as count_block,
    },
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
    put_groups,
};
use raykd_shared::{
    BuildParams, Node,
    limits::{BRANCH, chunk},
    status,
};

/// Bit of a scatter target that says: into the branches' list, not the next level's.
pub const TO_BRANCH: u32 = 1 << 31;
/// Sums over the blocks before this one, then over all.
const OUTER: usize = 2 * KINDS as usize;

/// The level past the last one is empty, too.
#[inline(always)]
fn end(group: Group, next_level: &mut Buf<u32>, next_args: &mut Buf<u32>) {
    lanes!(group, |lane| {
        if lane == 0 {
            next_level.put(LEVEL_ACTIVE, 0);
            next_level.put(LEVEL_CHUNKS, 0);
            put_groups(next_args, ARGS_ACTIVE, 0);
            put_groups(next_args, ARGS_CHUNKS, 0);
            put_groups(next_args, ARGS_BLOCKS, blocks_of(0));
        }
    });
}

/// Adds up what the blocks before this one need, and what all `number` nodes do.
#[inline(always)]
fn add_up(group: Group, parts: &[u32; BLOCKS], outer: &mut [u32; OUTER], blocks: &Buf<u32>, number: u32) {
    // One block alone is not tallied first.
    let several = number > LANES;
    lanes!(group, |lane| {
        if lane < KINDS {
            outer.put(lane, 0);
            outer.put(KINDS + lane, if several { 0 } else { total(KINDS, parts, lane) });
        }
    });
    lanes!(group, |lane| {
        let mut block = lane;
        while several && block < blocks_of(number) {
            let mut kind = 0;
            while kind < KINDS {
                let its = blocks.at(block * KINDS + kind);
                outer.add(KINDS + kind, its);
                if block < group.id {
                    outer.add(kind, its);
                }
                kind += 1;
            }
            block += LANES;
        }
    });
}

/// What all nodes of the level need of a kind.
#[inline(always)]
fn all(outer: &[u32; OUTER], kind: u32) -> u32 {
    outer.at(KINDS + kind)
}

/// Where what comes from this level starts in lists that all levels share.
#[derive(Clone, Copy)]
struct Bases {
    top: u32,
    branches: u32,
    room: u32,
}

impl Bases {
    #[inline(always)]
    fn of(level: &Buf<u32>) -> Self {
        Self {
            top: level.at(LEVEL_TOP),
            branches: level.at(LEVEL_BRANCHES),
            room: level.at(LEVEL_BRANCH_ROOM),
        }
    }

    /// Where what comes from the next one starts.
    #[inline(always)]
    fn next(self, outer: &[u32; OUTER]) -> Self {
        Self {
            top: self.top + 2 * all(outer, PAIRS),
            branches: self.branches + all(outer, BRANCHES),
            room: self.room + all(outer, BRANCH_ROOM),
        }
    }

    /// Whether all lists have room for this level's children.
    #[inline(always)]
    fn fits(self, outer: &[u32; OUTER], params: &BuildParams) -> bool {
        let next = self.next(outer);
        next.top <= 2 * params.treelets
            && next.branches <= branches(params.treelets)
            && next.room <= params.treelet_refs
            && all(outer, ACTIVE) <= params.active
            && all(outer, CHUNKS) <= params.active
            && all(outer, REFS) <= params.level_refs
    }
}

/// Writes node `k`, that of a lane, and puts its children into the lists.
#[inline(always)]
fn put_children(
    k: u32,
    place: impl Fn(u32) -> u32,
    bases: Bases,
    depth: u32,
    params: &BuildParams,
    active: &Buf<UVec4>,
    planes: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
    targets: &mut Buf<UVec4>,
    top: &mut Buf<UVec2>,
    next_active: &mut Buf<UVec4>,
    branches: &mut Buf<UVec4>,
) {
    let pair = bases.top + 2 * place(PAIRS);
    let mut slot = place(ACTIVE);
    let mut first_chunk = place(CHUNKS);
    let mut reference = place(REFS);
    let mut branch = bases.branches + place(BRANCHES);
    let mut branch_room = bases.room + place(BRANCH_ROOM);
    let item = Item::load(active, k);
    let plane = plane_of(planes, k);
    let size = sizes.at(k);
    let is_leaf = plane.axis == Node::LEAF;
    // The node itself as a leaf counts as one child that keeps the slot and the box.
    let (mut starts, mut slots) = ([TO_BRANCH; 2], [0u32; 2]);
    let mut child = 0;
    while child < 2 {
        let count = if child == 0 { size.x } else { size.y };
        // Its references come last in its room.
        let its_room = room(count, params.small, 0);
        let first = branch_room + its_room - count;
        let mut to = Item { first, count, extra: depth, ..item };
        if !is_leaf {
            to.node = pair + child;
            to.extra = depth + 1;
            to.growth = growth_left(item.growth, item.count, size.x + size.y, plane.pays);
            let (hi_below, lo_above) = cut(item.lo, item.hi, plane);
            if child == 0 {
                to.hi = hi_below;
            } else {
                to.lo = lo_above;
            }
        }
        if !is_leaf && count > BRANCH {
            to.first = reference;
            to.extra = first_chunk;
            to.store(next_active, slot);
            starts.put(child, reference);
            slots.put(child, slot);
            first_chunk += count.div_ceil(chunk(params.references));
            slot += 1;
            reference += count;
        } else if !is_leaf || child == 0 {
            to.store(branches, branch);
            starts.put(child, first | TO_BRANCH);
            branch += 1;
            branch_room += its_room;
        }
        child += 1;
    }
    if !is_leaf {
        let (word0, word1) = Node::inner(plane.axis, plane.at, pair).words();
        top.put(item.node, UVec2::new(word0, word1));
    }
    targets.put(k, UVec4::new(starts.at(0), starts.at(1), slots.at(0), slots.at(1)));
}

/// Writes whose the next level's chunks are that come from this block's `rest` nodes: while nodes are few and
/// have many, several lanes to a child.
#[inline(always)]
fn put_chunks(
    group: Group,
    sums: &[u32; SUMS],
    parts: &[u32; BLOCKS],
    outer: &[u32; OUTER],
    rest: u32,
    size_of_chunk: u32,
    planes: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
    next_chunks: &mut Buf<u32>,
) {
    lanes!(group, |lane| {
        let children = 2 * if rest < LANES { rest } else { LANES };
        let sharers = if children < LANES { LANES / children } else { 1 };
        let mut turn = lane;
        while turn < children * sharers {
            let child = turn / sharers;
            let k = group.id * LANES + child / 2;
            let size = sizes.at(k);
            let is_active = |count: u32| planes.at(k).x != Node::LEAF && count > BRANCH;
            let place = |kind: u32| outer.at(kind) + before(sums, parts, kind, child / 2);
            let (mut slot, mut first) = (place(ACTIVE), place(CHUNKS));
            if child % 2 == 1 && is_active(size.x) {
                slot += 1;
                first += size.x.div_ceil(size_of_chunk);
            }
            let count = if child % 2 == 0 { size.x } else { size.y };
            let mut piece = turn % sharers;
            while is_active(count) && piece < count.div_ceil(size_of_chunk) {
                next_chunks.put(first + piece, slot);
                piece += sharers;
            }
            turn += LANES;
        }
    });
}

/// Writes the records of the next level, one without nodes unless its lists fit, and of the build.
#[inline(always)]
fn put_records(
    group: Group,
    outer: &[u32; OUTER],
    bases: Bases,
    depth: u32,
    fits: bool,
    next_level: &mut Buf<u32>,
    next_args: &mut Buf<u32>,
    round: &mut Buf<u32>,
    state: &mut Buf<u32>,
) {
    lanes!(group, |lane| {
        if lane == 0 && group.id == 0 {
            let (nodes, pieces, refs) =
                if fits { (all(outer, ACTIVE), all(outer, CHUNKS), all(outer, REFS)) } else { (0, 0, 0) };
            next_level.put(LEVEL_ACTIVE, nodes);
            next_level.put(LEVEL_CHUNKS, pieces);
            next_level.put(LEVEL_REFS, refs);
            next_level.put(LEVEL_DEPTH, depth + 1);
            next_level.put(LEVEL_FITS, fits as u32);
            put_groups(next_args, ARGS_ACTIVE, nodes);
            put_groups(next_args, ARGS_CHUNKS, pieces);
            put_groups(next_args, ARGS_BLOCKS, blocks_of(nodes));
            if fits {
                let next = bases.next(outer);
                next_level.put(LEVEL_TOP, next.top);
                next_level.put(LEVEL_BRANCHES, next.branches);
                next_level.put(LEVEL_BRANCH_ROOM, next.room);
                state.put(STATE_LEVELS, depth + 1);
                let ready = if nodes == 0 { next.branches } else { 0 };
                put_round(
                    round,
                    Next { earlier: 0, from: 0, number: ready, top: next.top, treelets: 0, room: next.room },
                );
            } else {
                state.or(STATE_STATUS, status::CAPACITY);
            }
        }
    });
}

/// Places the children of block `group.id`, a node a lane.
pub fn alloc(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; BLOCKS],
    outer: &mut [u32; OUTER],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    planes: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
    blocks: &Buf<u32>,
    targets: &mut Buf<UVec4>,
    top: &mut Buf<UVec2>,
    next_level: &mut Buf<u32>,
    next_active: &mut Buf<UVec4>,
    next_chunks: &mut Buf<u32>,
    next_args: &mut Buf<u32>,
    branches: &mut Buf<UVec4>,
    round: &mut Buf<u32>,
    state: &mut Buf<u32>,
) {
    let params = params.at(0);
    let number = level.at(LEVEL_ACTIVE);
    let depth = level.at(LEVEL_DEPTH);
    // Levels past the last one are dispatched too, with nothing to do.
    if number == 0 {
        end(group, next_level, next_args);
        return;
    }
    count_block(group, sums, parts, number, &params, planes, sizes);
    add_up(group, parts, outer, blocks, number);
    let bases = Bases::of(level);
    let fits = bases.fits(outer, &params);
    if fits {
        lanes!(group, |lane| {
            let k = group.id * LANES + lane;
            if k < number {
                let place = |kind: u32| outer.at(kind) + before(sums, parts, kind, lane);
                put_children(
                    k,
                    place,
                    bases,
                    depth,
                    &params,
                    active,
                    planes,
                    sizes,
                    targets,
                    top,
                    next_active,
                    branches,
                );
            }
        });
        let (rest, size) = (number - group.id * LANES, chunk(params.references));
        put_chunks(group, sums, parts, outer, rest, size, planes, sizes, next_chunks);
    }
    put_records(group, outer, bases, depth, fits, next_level, next_args, round, state);
}

kernel! {
    /// [`alloc`] over all blocks of a level.
    group ALLOC = alloc, threads 256, shared [sums: SUMS, parts: BLOCKS, outer: OUTER], {
        0 params: read BuildParams, 1 level: read u32, 2 active: read UVec4, 3 planes: read UVec2,
        4 sizes: read UVec2, 5 blocks: read u32, 6 targets: write UVec4, 7 top: write UVec2, 8 next_level: write u32,
        9 next_active: write UVec4, 10 next_chunks: write u32, 11 next_args: write u32, 12 branches: write UVec4,
        13 round: write u32, 14 state: write u32,
    }
}
