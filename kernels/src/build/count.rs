//! Chooses the plane of a chunk's node, and marks which references of the chunk go below it and above, and how many;
//! these are the children's sizes.

use super::{
    LEVEL_CHUNKS, LEVEL_DEPTH,
    bin::{HIST_WORDS, TABLE, histograms, read},
    chunk_of,
    marks::{self, WORDS, mark},
    split::{FOUND, WEIGHING, chosen, find},
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{BuildParams, rule};

const LANES: u32 = 128;
const _: () = assert!(WEIGHING <= LANES, "every border is weighed");

/// Clears the histograms and sizes of the next level's nodes `first` and `first + 1`, if there may be such.
#[inline(always)]
fn clear(group: Group, next_hists: &mut Buf<u32>, next_sizes: &mut Buf<u32>, first: u32, nodes: u32) {
    let end = if first + 2 < nodes { first + 2 } else { nodes };
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = first * HIST_WORDS + lane;
        while word < end * HIST_WORDS {
            next_hists.put(word, 0);
            word += step;
        }
        let mut word = first * 2 + lane;
        while word < end * 2 {
            next_sizes.put(word, 0);
            word += step;
        }
    });
}

/// Adds what chunk `group.id` sends either way to its node's, and notes which reference goes where. Every chunk of a
/// node chooses the plane: to hand it on would take a dispatch more. The first notes it, and clears what the node's
/// children add up to, before it is known how many there are.
#[inline(always)]
pub fn count(
    group: Group,
    table: &mut [u32; TABLE],
    found: &mut [u32; FOUND],
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    sums: &mut [u32; 2],
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    hists: &Buf<u32>,
    refs: &mut Buf<UVec4>,
    planes: &mut Buf<UVec2>,
    bits: &mut Buf<UVec2>,
    sides: &mut Buf<UVec2>,
    sizes: &mut Buf<u32>,
    next_hists: &mut Buf<u32>,
    next_sizes: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) {
        let params = params.at(0);
        let (node, item, start, number) = chunk_of(group.id, params.references, chunks, active);
        let clips = (params.rule & rule::CLIP) != 0;
        read(group, table, hists, node);
        find(group, table, found, &params, level.at(LEVEL_DEPTH), &item);
        let plane = chosen(found);
        let is_first = group.id == item.extra;
        if is_first {
            clear(group, next_hists, next_sizes, 2 * node, histograms(params.level_refs));
        }
        mark(group, belows, aboves, clips, positions, indices, refs, start, number, plane);
        let step = group.sharers();
        lanes!(group, ..2, |lane| {
            sums.put(lane, 0);
        });
        lanes!(group, ..step, |lane| {
            let mut word = lane;
            while word < number.div_ceil(32) {
                let (below, above) = (belows.at(word), aboves.at(word));
                bits.put(group.id * marks::bits(params.references) + word, UVec2::new(below, above));
                sums.add(0, below.count_ones());
                sums.add(1, above.count_ones());
                word += step;
            }
        });
        lanes!(group, ..2, |lane| {
            if lane == 0 {
                sides.put(group.id, UVec2::new(sums.at(0), sums.at(1)));
                if is_first {
                    planes.put(node, plane.words());
                }
            }
            sizes.add(2 * node + lane, sums.at(lane));
        });
    }
}

kernel! {
    /// [`count`] over all chunks of a level.
    group COUNT = count, threads 128, shared [table: TABLE, found: FOUND, belows: WORDS, aboves: WORDS, sums: 2], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32,
        4 active: read UVec4, 5 chunks: read u32, 6 hists: read u32, 7 refs: write UVec4, 8 planes: write UVec2,
        9 bits: write UVec2, 10 sides: write UVec2, 11 sizes: write u32, 12 next_hists: write u32,
        13 next_sizes: write u32,
    }
}
