//! Gives every child of a level its place: tree slots, next level's lists, treelets. One workgroup.
//!
//! Counts, scan, write: each lane owns a run of active nodes, so the order of everything is that of the nodes.

use super::{
    ARGS_ACTIVE, ARGS_CHUNKS, Item, LEVEL_ACTIVE, LEVEL_CHUNKS, LEVEL_DEPTH, LEVEL_REFS, Plane, STATE_STATUS,
    STATE_TOP, STATE_TREELET_REFS, STATE_TREELETS,
    bin::HIST_WORDS,
    cut,
    scan::{self, LANES, before, scan, total},
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::{
    BuildParams, Node,
    limits::{CHUNK, GROUPS_X},
    status,
};

/// Bit of a scatter target that says: into the treelets' list, not the next level's.
pub const TO_TREELET: u32 = 1 << 31;

// What is counted for every run of nodes.
const PAIRS: u32 = 0;
const ACTIVE: u32 = 1;
const CHUNKS: u32 = 2;
const REFS: u32 = 3;
const TREELETS: u32 = 4;
const TREELET_REFS: u32 = 5;
const KINDS: u32 = 6;
const SUMS: usize = scan::sums(KINDS);
const BLOCKS: usize = scan::blocks(KINDS);

#[inline(always)]
fn bump(sums: &mut [u32; SUMS], lane: u32, kind: u32, by: u32) {
    let i = kind * LANES + lane;
    let old = sums.at(i);
    sums.put(i, old + by);
}

/// What a child of so many references adds to a lane's sums.
#[inline(always)]
fn tally(sums: &mut [u32; SUMS], lane: u32, count: u32, small: u32) {
    if count > small {
        bump(sums, lane, ACTIVE, 1);
        bump(sums, lane, CHUNKS, count.div_ceil(CHUNK));
        bump(sums, lane, REFS, count);
    } else {
        bump(sums, lane, TREELETS, 1);
        bump(sums, lane, TREELET_REFS, count);
    }
}

/// Clears the histogram of active node `slot`: several workgroups will add to it.
#[inline(always)]
fn clear(hists: &mut Buf<u32>, slot: u32) {
    let mut word = 0;
    while word < HIST_WORDS {
        hists.put(slot * HIST_WORDS + word, 0);
        word += 1;
    }
}

/// Places all children of a level.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn alloc(
    group: Group,
    sums: &mut [u32; SUMS],
    blocks: &mut [u32; BLOCKS],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    planes: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
    targets: &mut Buf<UVec2>,
    top: &mut Buf<UVec2>,
    next_level: &mut Buf<u32>,
    next_active: &mut Buf<UVec4>,
    next_chunks: &mut Buf<u32>,
    next_args: &mut Buf<u32>,
    treelets: &mut Buf<UVec4>,
    treelet_args: &mut Buf<u32>,
    state: &mut Buf<u32>,
    hists: &mut Buf<u32>,
) {
    let params = params.at(0);
    let number = level.at(LEVEL_ACTIVE);
    let depth = level.at(LEVEL_DEPTH);
    // Levels past the last one are dispatched too, with nothing to do.
    if number == 0 {
        lanes!(group, |lane| {
            if lane == 0 {
                next_level.put(LEVEL_ACTIVE, 0);
                next_level.put(LEVEL_CHUNKS, 0);
                put_groups(next_args, ARGS_ACTIVE, 0);
                put_groups(next_args, ARGS_CHUNKS, 0);
            }
        });
        return;
    }
    let run = number.div_ceil(LANES);
    lanes!(group, |lane| {
        let mut kind = 0;
        while kind < KINDS {
            sums.put(kind * LANES + lane, 0);
            kind += 1;
        }
        let mut i = 0;
        while i < run {
            let k = lane * run + i;
            if k < number {
                let size = sizes.at(k);
                if planes.at(k).x == Node::LEAF {
                    bump(sums, lane, TREELETS, 1);
                    bump(sums, lane, TREELET_REFS, size.x);
                } else {
                    bump(sums, lane, PAIRS, 1);
                    tally(sums, lane, size.x, params.small);
                    tally(sums, lane, size.y, params.small);
                }
            }
            i += 1;
        }
    });
    scan(group, KINDS, sums, blocks);
    let top_base = state.at(STATE_TOP);
    let treelet_base = state.at(STATE_TREELETS);
    let ref_base = state.at(STATE_TREELET_REFS);
    let fits = state.at(STATE_STATUS) == 0
        && top_base + 2 * total(KINDS, blocks, PAIRS) <= 2 * params.treelets
        && treelet_base + total(KINDS, blocks, TREELETS) <= params.treelets
        && ref_base + total(KINDS, blocks, TREELET_REFS) <= params.treelet_refs
        && total(KINDS, blocks, ACTIVE) <= params.active
        && total(KINDS, blocks, CHUNKS) <= params.active
        && total(KINDS, blocks, REFS) <= params.level_refs;
    lanes!(group, |lane| {
        let mut pair = top_base + 2 * before(sums, blocks, PAIRS, lane);
        let mut slot = before(sums, blocks, ACTIVE, lane);
        let mut chunk = before(sums, blocks, CHUNKS, lane);
        let mut reference = before(sums, blocks, REFS, lane);
        let mut treelet = treelet_base + before(sums, blocks, TREELETS, lane);
        let mut treelet_ref = ref_base + before(sums, blocks, TREELET_REFS, lane);
        let mut i = 0;
        while i < run && fits {
            let k = lane * run + i;
            if k < number {
                let item = Item::load(active, k);
                let plane = planes.at(k);
                let size = sizes.at(k);
                let is_leaf = plane.x == Node::LEAF;
                let at = f32::from_bits(plane.y);
                // The node itself as a leaf counts as one child that keeps the slot and the box.
                let mut place = [0u32; 2];
                let mut child = 0;
                while child < 2 {
                    let count = if child == 0 { size.x } else { size.y };
                    let mut to = Item {
                        node: item.node,
                        first: treelet_ref,
                        count,
                        extra: depth,
                        lo: item.lo,
                        hi: item.hi,
                    };
                    if !is_leaf {
                        to.node = pair + child;
                        to.extra = depth + 1;
                        let (hi_below, lo_above) = cut(item.lo, item.hi, Plane { axis: plane.x, at });
                        if child == 0 {
                            to.hi = hi_below;
                        } else {
                            to.lo = lo_above;
                        }
                    }
                    if !is_leaf && count > params.small {
                        to.first = reference;
                        to.extra = chunk;
                        to.store(next_active, slot);
                        place.put(child, reference);
                        let end = chunk + count.div_ceil(CHUNK);
                        while chunk < end {
                            next_chunks.put(chunk, slot);
                            chunk += 1;
                        }
                        if count > CHUNK {
                            clear(hists, slot);
                        }
                        slot += 1;
                        reference += count;
                    } else if !is_leaf || child == 0 {
                        to.store(treelets, treelet);
                        place.put(child, treelet_ref | TO_TREELET);
                        treelet += 1;
                        treelet_ref += count;
                    }
                    child += 1;
                }
                if !is_leaf {
                    let (word0, word1) = Node::inner(plane.x, at, pair).words();
                    top.put(item.node, UVec2::new(word0, word1));
                    pair += 2;
                }
                targets.put(k, UVec2::new(place.at(0), place.at(1)));
            }
            i += 1;
        }
    });
    lanes!(group, |lane| {
        if lane == 0 {
            let (nodes, pieces, refs) = if fits {
                (total(KINDS, blocks, ACTIVE), total(KINDS, blocks, CHUNKS), total(KINDS, blocks, REFS))
            } else {
                (0, 0, 0)
            };
            next_level.put(LEVEL_ACTIVE, nodes);
            next_level.put(LEVEL_CHUNKS, pieces);
            next_level.put(LEVEL_REFS, refs);
            next_level.put(LEVEL_DEPTH, depth + 1);
            put_groups(next_args, ARGS_ACTIVE, nodes);
            put_groups(next_args, ARGS_CHUNKS, pieces);
            if fits {
                state.put(STATE_TOP, top_base + 2 * total(KINDS, blocks, PAIRS));
                let all = treelet_base + total(KINDS, blocks, TREELETS);
                state.put(STATE_TREELETS, all);
                put_groups(treelet_args, 0, all);
                state.put(STATE_TREELET_REFS, ref_base + total(KINDS, blocks, TREELET_REFS));
            } else {
                let old = state.at(STATE_STATUS);
                state.put(STATE_STATUS, old | status::CAPACITY);
            }
        }
    });
}

/// Indirect arguments for a dispatch of `groups` workgroups.
#[inline(always)]
pub fn put_groups(args: &mut (impl Slots<u32> + ?Sized), entry: u32, groups: u32) {
    let wide = groups > GROUPS_X;
    args.put(3 * entry, if wide { GROUPS_X } else { groups });
    args.put(3 * entry + 1, if wide { groups.div_ceil(GROUPS_X) } else { 1 });
    args.put(3 * entry + 2, 1);
}

kernel! {
    /// [`alloc`] for one level; a single workgroup.
    group ALLOC = alloc, threads 1024, shared [sums: SUMS, blocks: BLOCKS], {
        0 params: read BuildParams, 1 level: read u32, 2 active: read UVec4, 3 planes: read UVec2,
        4 sizes: read UVec2, 5 targets: write UVec2, 6 top: write UVec2, 7 next_level: write u32,
        8 next_active: write UVec4, 9 next_chunks: write u32, 10 next_args: write u32, 11 treelets: write UVec4,
        12 treelet_args: write u32, 13 state: write u32, 14 hists: write u32,
    }
}
