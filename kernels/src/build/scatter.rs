//! Moves the references of a chunk to the children's lists, in order.

#[cfg(not(target_arch = "spirv"))]
use super::ahead;
use super::{
    LEVEL_CHUNKS, STATE_STATUS, alloc::TO_TREELET, chunk_of, clip::clip_plane, plane_of, reference::Reference,
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
    mesh::triangle,
};
use raykd_shared::{BuildParams, limits::CHUNK, rule};

/// Words of a bit for each reference of a chunk.
const BITS: u32 = CHUNK / 32;
const WORDS: usize = BITS as usize;
/// Words whose sums are added up by one lane.
const BLOCK: u32 = 8;
const BLOCKS: usize = (BITS / BLOCK) as usize;

/// Scatters chunk `group.id`. Which references go below is a bit each, and so is above: how many go there before one is a
/// count of bits. Those that go both ways are clipped again: [`super::count`] has no room for two boxes.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
pub fn scatter(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    sums: &mut [u32; WORDS],
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
    treelet_refs: &mut Buf<UVec4>,
) {
    if group.id < level.at(LEVEL_CHUNKS) && state.at(STATE_STATUS) == 0 {
        let (node, item, start, number) = chunk_of(group.id, chunks, active);
        let plane = plane_of(planes, node);
        let clips = (params.at(0).rule & rule::CLIP) != 0;
        let words = number.div_ceil(32);
        let step = group.sharers();
        lanes!(group, ..step, |lane| {
            let mut word = lane;
            while word < words {
                belows.put(word, 0);
                aboves.put(word, 0);
                word += step;
            }
            if lane == 0 {
                earlier.put(0, 0);
                earlier.put(1, 0);
            }
        });
        lanes!(group, ..step, |lane| {
            let mut i = lane;
            while i < number {
                let s = Reference::load(refs, start + i).sides(plane);
                // A GPU's lanes wait for each other here, a CPU for what it has guessed wrong.
                let always = cfg!(not(target_arch = "spirv"));
                if always || (s & 1) != 0 {
                    belows.or(i / 32, (s & 1) << (i % 32));
                }
                if always || (s & 2) != 0 {
                    aboves.or(i / 32, (s >> 1) << (i % 32));
                }
                i += step;
            }
            // What the node's chunks before this one send either way.
            let mut chunk = item.extra + lane;
            while chunk < group.id {
                let both = sides.at(chunk);
                earlier.add(0, both.x);
                earlier.add(1, both.y);
                chunk += step;
            }
        });
        // How many go either way before each word: before those of its block, then before its block.
        lanes!(group, ..words.div_ceil(BLOCK), |lane| {
            let end = (lane + 1) * BLOCK;
            let end = if end < words { end } else { words };
            let mut sum = 0;
            let mut word = lane * BLOCK;
            while word < end {
                sums.put(word, sum);
                sum += belows.at(word).count_ones() | (aboves.at(word).count_ones() << 16);
                word += 1;
            }
            blocks.put(lane, sum);
        });
        lanes!(group, ..words, |lane| {
            let mut sum = sums.at(lane);
            let mut block = 0;
            while block < lane / BLOCK {
                sum += blocks.at(block);
                block += 1;
            }
            sums.put(lane, sum);
        });
        let target = targets.at(node);
        let below = Target::new(target.x, earlier.at(0));
        let above = Target::new(target.y, earlier.at(1));
        lanes!(group, ..step, |lane| {
            // In batches: triangles are clipped together, for which lanes meet and a CPU asks ahead.
            let mut i = lane;
            while i < number {
                let mut straddling = 0u32;
                let mut k = 0;
                while k < 32 && i + k * step < number {
                    let at = i + k * step;
                    let bit = 1 << (at % 32);
                    let (is_below, is_above) = (belows.at(at / 32) & bit != 0, aboves.at(at / 32) & bit != 0);
                    if is_below | is_above {
                        let reference = Reference::load(refs, start + at);
                        if clips && is_below && is_above {
                            straddling |= 1 << k;
                            indices.soon(3 * reference.triangle);
                        } else {
                            let before = sums.at(at / 32);
                            if is_below {
                                below.put(
                                    &reference,
                                    (before & 0xFFFF) + ones_before(belows, at),
                                    next,
                                    treelet_refs,
                                );
                            }
                            if is_above {
                                above.put(
                                    &reference,
                                    (before >> 16) + ones_before(aboves, at),
                                    next,
                                    treelet_refs,
                                );
                            }
                        }
                    }
                    k += 1;
                }
                #[cfg(not(target_arch = "spirv"))]
                ahead::triangles(group, positions, indices, straddling, |k| {
                    Reference::load(refs, start + i + k * step).triangle
                });
                while straddling != 0 {
                    let at = i + straddling.trailing_zeros() * step;
                    straddling &= straddling - 1;
                    let whole = Reference::load(refs, start + at);
                    let (a, b, c) = triangle(positions, indices, whole.triangle);
                    let (under, over) = clip_plane(a, b, c, &whole.bounds, plane.axis, plane.at);
                    let before = sums.at(at / 32);
                    let (under, over) =
                        (Reference { bounds: under, ..whole }, Reference { bounds: over, ..whole });
                    below.put(&under, (before & 0xFFFF) + ones_before(belows, at), next, treelet_refs);
                    above.put(&over, (before >> 16) + ones_before(aboves, at), next, treelet_refs);
                }
                i += 32 * step;
            }
        });
    }
}

/// How many bits are set in the word of bit `at`, before it.
#[inline(always)]
fn ones_before(bits: &[u32; WORDS], at: u32) -> u32 {
    (bits.at(at / 32) & ((1 << (at % 32)) - 1)).count_ones()
}

/// Where a chunk's references for a child go.
#[derive(Clone, Copy)]
struct Target {
    is_treelet: bool,
    first: u32,
}

impl Target {
    /// `earlier` ones come from other chunks.
    #[inline(always)]
    fn new(child: u32, earlier: u32) -> Self {
        Self { is_treelet: (child & TO_TREELET) != 0, first: (child & !TO_TREELET) + earlier }
    }

    /// Stores a reference, `before` which others come from this chunk.
    #[inline(always)]
    fn put(&self, reference: &Reference, before: u32, next: &mut Buf<UVec4>, treelet_refs: &mut Buf<UVec4>) {
        // Not one store to either: a choice of buffers is no SPIR-V for Vulkan, and an H200's driver dies of it.
        if self.is_treelet {
            reference.store(treelet_refs, self.first + before);
        } else {
            reference.store(next, self.first + before);
        }
    }
}

kernel! {
    /// [`scatter`] over all chunks of a level.
    group SCATTER = scatter, threads 128, shared [belows: WORDS, aboves: WORDS, sums: WORDS, blocks: BLOCKS, earlier: 2], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32,
        4 active: read UVec4, 5 chunks: read u32, 6 refs: read UVec4, 7 planes: read UVec2, 8 sides: read UVec2,
        9 targets: read UVec2, 10 state: read u32, 11 next: write UVec4, 12 treelet_refs: write UVec4,
    }
}
