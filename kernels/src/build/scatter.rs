//! Moves the references of a chunk to the children's lists, in order.

#[cfg(not(target_arch = "spirv"))]
use super::ahead;
use super::{
    LEVEL_CHUNKS, STATE_STATUS, alloc::TO_TREELET, boxes::triangle, chunk_of, clip::clip_plane, plane_of,
    reference::Reference,
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{BuildParams, limits::CHUNK, rule};

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
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    refs: &Buf<UVec4>,
    planes: &Buf<UVec2>,
    sides: &Buf<UVec2>,
    targets: &Buf<UVec2>,
    state: &Buf<u32>,
    next: &mut Buf<UVec4>,
    treelet_refs: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) && state.at(STATE_STATUS) == 0 {
        let (node, item, start, number) = chunk_of(group.id, chunks, active);
        let plane = plane_of(planes, node);
        let clips = (params.at(0).rule & rule::CLIP) != 0;
        let run = number.div_ceil(LANES);
        // Lanes that have one.
        let used = number.div_ceil(run);
        lanes!(group, ..used, |lane| {
            let (mut bits, mut sum) = (0, 0);
            let mut i = 0;
            while i < run {
                let at = lane * run + i;
                if at < number {
                    let s = Reference::load(refs, start + at).sides(plane);
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
            let to_below = Target::new(target.x, earlier.at(0) + (before & 0xFFFF));
            let to_above = Target::new(target.y, earlier.at(1) + (before >> 16));
            // Those that are clipped later, when all lanes are.
            let mut straddling = 0u32;
            let mut i = 0;
            while i < run {
                let at = lane * run + i;
                let s = (bits >> (2 * i)) & 3;
                if at < number && s != 0 {
                    let reference = Reference::load(refs, start + at);
                    if clips && s == 3 && !(to_below.is_treelet && to_above.is_treelet) {
                        straddling |= 1 << i;
                        indices.soon(3 * reference.triangle);
                    } else {
                        if (s & 1) != 0 {
                            to_below.put(bits, i, &reference, next, treelet_refs);
                        }
                        if (s & 2) != 0 {
                            to_above.put(bits >> 1, i, &reference, next, treelet_refs);
                        }
                    }
                }
                i += 1;
            }
            #[cfg(not(target_arch = "spirv"))]
            ahead::triangles(group, positions, indices, straddling, |i| {
                Reference::load(refs, start + lane * run + i).triangle
            });
            while straddling != 0 {
                let i = straddling.trailing_zeros();
                straddling &= straddling - 1;
                let whole = Reference::load(refs, start + lane * run + i);
                let (a, b, c) = triangle(positions, indices, whole.triangle);
                let (under, over) = clip_plane(a, b, c, &whole.bounds, plane.axis, plane.at);
                to_below.put(bits, i, &Reference { bounds: under, ..whole }, next, treelet_refs);
                to_above.put(bits >> 1, i, &Reference { bounds: over, ..whole }, next, treelet_refs);
            }
        });
    }
}

/// Where a lane's references for a child go.
#[derive(Clone, Copy)]
struct Target {
    is_treelet: bool,
    first: u32,
}

impl Target {
    #[inline(always)]
    fn new(child: u32, before: u32) -> Self {
        Self { is_treelet: (child & TO_TREELET) != 0, first: (child & !TO_TREELET) + before }
    }

    /// Stores reference `i` of the lane behind those for the child before it, of which every other bit tells.
    #[inline(always)]
    fn put(&self, bits: u32, i: u32, reference: &Reference, next: &mut Buf<UVec4>, treelet_refs: &mut Buf<u32>) {
        let at = self.first + (bits & 0x5555_5555 & ((1 << (2 * i)) - 1)).count_ones();
        if self.is_treelet {
            treelet_refs.put(at, reference.triangle);
        } else {
            reference.store(next, at);
        }
    }
}

kernel! {
    /// [`scatter`] over all chunks of a level.
    group SCATTER = scatter, threads 128, shared [kept: WIDTH, sums: WIDTH, blocks: BLOCKS, earlier: 2], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32,
        4 active: read UVec4, 5 chunks: read u32, 6 refs: read UVec4, 7 planes: read UVec2, 8 sides: read UVec2,
        9 targets: read UVec2, 10 state: read u32, 11 next: write UVec4, 12 treelet_refs: write u32,
    }
}
