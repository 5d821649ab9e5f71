//! Moves the references of a chunk to the children's lists, in order.

use super::{LEVEL_CHUNKS, STATE_STATUS, alloc::TO_TREELET, chunk_of, count::TRIANGLE};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::limits::CHUNK;

const LANES: u32 = 128;
const WIDTH: usize = LANES as usize;
/// Lanes whose sums are added up by one.
const BLOCK: u32 = 16;
/// Lanes that do.
const SUMMING: u32 = LANES / BLOCK;
const BLOCKS: usize = SUMMING as usize;
// Two bits a reference must fit the word a lane keeps them in.
const _: () = assert!(CHUNK <= 16 * LANES, "a lane keeps the sides of at most 16 references");

/// Scatters chunk `group.id`. Each lane takes a run of references, so that runs in lane order keep the order.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
pub fn scatter(
    group: Group,
    kept: &mut [u32; WIDTH],
    sums: &mut [u32; WIDTH],
    blocks: &mut [u32; BLOCKS],
    earlier: &mut [u32; 2],
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    refs: &Buf<u32>,
    sides: &Buf<UVec2>,
    targets: &Buf<UVec2>,
    state: &Buf<u32>,
    next: &mut Buf<u32>,
    treelet_refs: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) && state.at(STATE_STATUS) == 0 {
        let (node, item, start, number) = chunk_of(group.id, chunks, active);
        let run = number.div_ceil(LANES);
        // Lanes that have one.
        let used = number.div_ceil(run);
        lanes!(group, ..used, |lane| {
            let (mut bits, mut sum) = (0, 0);
            let mut i = 0;
            while i < run {
                let at = lane * run + i;
                if at < number {
                    let s = refs.at(start + at) >> 30;
                    bits |= s << (2 * i);
                    sum += (s & 1) | ((s >> 1) << 16);
                }
                i += 1;
            }
            kept.put(lane, bits);
            sums.put(lane, sum);
            if lane == 0 {
                earlier.put(0, 0);
                earlier.put(1, 0);
            }
        });
        let step = group.sharers();
        lanes!(group, ..if step > SUMMING { step } else { SUMMING }, |lane| {
            // What lanes send before each lane of a block.
            if lane < SUMMING {
                let end = (lane + 1) * BLOCK;
                let end = if end < used { end } else { used };
                let mut sum = 0;
                let mut i = lane * BLOCK;
                while i < end {
                    let here = sums.at(i);
                    sums.put(i, sum);
                    sum += here;
                    i += 1;
                }
                blocks.put(lane, sum);
            }
            // What the node's chunks before this one send either way.
            let mut chunk = item.extra + lane;
            while lane < step && chunk < group.id {
                let both = sides.at(chunk);
                earlier.add(0, both.x);
                earlier.add(1, both.y);
                chunk += step;
            }
        });
        let target = targets.at(node);
        lanes!(group, ..used, |lane| {
            let mut before = sums.at(lane);
            let mut block = 0;
            while block < lane / BLOCK {
                before += blocks.at(block);
                block += 1;
            }
            let bits = kept.at(lane);
            let mut below = (target.x & !TO_TREELET) + earlier.at(0) + (before & 0xFFFF);
            let mut above = (target.y & !TO_TREELET) + earlier.at(1) + (before >> 16);
            let mut i = 0;
            while i < run {
                let at = lane * run + i;
                let s = bits >> (2 * i);
                if at < number && (s & 3) != 0 {
                    let id = refs.at(start + at) & TRIANGLE;
                    if (s & 1) != 0 {
                        if (target.x & TO_TREELET) != 0 {
                            treelet_refs.put(below, id);
                        } else {
                            next.put(below, id);
                        }
                        below += 1;
                    }
                    if (s & 2) != 0 {
                        if (target.y & TO_TREELET) != 0 {
                            treelet_refs.put(above, id);
                        } else {
                            next.put(above, id);
                        }
                        above += 1;
                    }
                }
                i += 1;
            }
        });
    }
}

kernel! {
    /// [`scatter`] over all chunks of a level.
    group SCATTER = scatter, threads 128, shared [kept: WIDTH, sums: WIDTH, blocks: BLOCKS, earlier: 2], {
        0 level: read u32, 1 active: read UVec4, 2 chunks: read u32, 3 refs: read u32, 4 sides: read UVec2,
        5 targets: read UVec2, 6 state: read u32, 7 next: write u32, 8 treelet_refs: write u32,
    }
}
