//! Moves the references of a chunk to the children's lists, in order.

use super::{
    LEVEL_CHUNKS, STATE_STATUS, SplitPlane, ahead, alloc::TO_TREELET, chunk_of, clip::clip_plane, plane_of,
    reference::Reference,
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

/// Marks which of `number` references from `start` on go below and above, and adds up what the node's chunks
/// before this one, from `first_chunk` on, send either way.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
fn mark(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    earlier: &mut [u32; 2],
    refs: &Buf<UVec4>,
    sides: &Buf<UVec2>,
    plane: SplitPlane,
    (start, number): (u32, u32),
    first_chunk: u32,
) {
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = lane;
        while word < number.div_ceil(32) {
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
            belows.mark(i / 32, (s & 1) << (i % 32));
            aboves.mark(i / 32, (s >> 1) << (i % 32));
            i += step;
        }
        let mut chunk = first_chunk + lane;
        while chunk < group.id {
            let both = sides.at(chunk);
            earlier.add(0, both.x);
            earlier.add(1, both.y);
            chunk += step;
        }
    });
}

/// How many references go below, and in the upper half of a sum above, before each of `words` words: first
/// before those of its block, then before its block.
#[inline(always)]
fn scan(
    group: Group,
    belows: &[u32; WORDS],
    aboves: &[u32; WORDS],
    sums: &mut [u32; WORDS],
    blocks: &mut [u32; BLOCKS],
    words: u32,
) {
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
}

/// Which references of a chunk go where, as workgroup memory has it.
#[derive(Clone, Copy)]
struct Marks<'a> {
    belows: &'a [u32; WORDS],
    aboves: &'a [u32; WORDS],
    sums: &'a [u32; WORDS],
}

impl Marks<'_> {
    /// Whether reference `i` goes below, and whether above.
    #[inline(always)]
    fn sides(&self, i: u32) -> (bool, bool) {
        let bit = 1 << (i % 32);
        (self.belows.at(i / 32) & bit != 0, self.aboves.at(i / 32) & bit != 0)
    }

    /// How many go below before reference `i`.
    #[inline(always)]
    fn below_before(&self, i: u32) -> u32 {
        (self.sums.at(i / 32) & 0xFFFF) + ones_before(self.belows, i)
    }

    /// How many go above.
    #[inline(always)]
    fn above_before(&self, i: u32) -> u32 {
        (self.sums.at(i / 32) >> 16) + ones_before(self.aboves, i)
    }
}

/// Moves every `step`-th reference from `lane` on, in batches: triangles are clipped together, for which
/// lanes meet and a CPU asks ahead.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
fn move_references(
    group: Group,
    lane: u32,
    marks: Marks,
    clips: bool,
    plane: SplitPlane,
    (start, number): (u32, u32),
    (below, above): (Target, Target),
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<UVec4>,
    next: &mut Buf<UVec4>,
    treelet_refs: &mut Buf<UVec4>,
) {
    let step = group.sharers();
    let mut i = lane;
    while i < number {
        let mut straddling = 0u32;
        let mut k = 0;
        while k < 32 && i + k * step < number {
            let at = i + k * step;
            let (is_below, is_above) = marks.sides(at);
            if is_below | is_above {
                let reference = Reference::load(refs, start + at);
                if clips && is_below && is_above {
                    straddling |= 1 << k;
                    indices.soon(3 * reference.triangle);
                } else {
                    if is_below {
                        below.put(&reference, marks.below_before(at), next, treelet_refs);
                    }
                    if is_above {
                        above.put(&reference, marks.above_before(at), next, treelet_refs);
                    }
                }
            }
            k += 1;
        }
        ahead::triangles(group, positions, indices, straddling, |k| {
            Reference::load(refs, start + i + k * step).triangle
        });
        while straddling != 0 {
            let at = i + straddling.trailing_zeros() * step;
            straddling &= straddling - 1;
            let whole = Reference::load(refs, start + at);
            let (a, b, c) = triangle(positions, indices, whole.triangle);
            let (under, over) = clip_plane(a, b, c, &whole.bounds, plane.axis, plane.at);
            below.put(&Reference { bounds: under, ..whole }, marks.below_before(at), next, treelet_refs);
            above.put(&Reference { bounds: over, ..whole }, marks.above_before(at), next, treelet_refs);
        }
        i += 32 * step;
    }
}

/// Scatters chunk `group.id`. Which references go below is a bit each, and so is above: how many go there
/// before one is a count of bits. Those that go both ways are clipped again: [`super::count`] has no room for
/// two boxes.
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
        let range = (start, number);
        mark(group, belows, aboves, earlier, refs, sides, plane, range, item.extra);
        scan(group, belows, aboves, sums, blocks, number.div_ceil(32));
        let target = targets.at(node);
        let to = (Target::new(target.x, earlier.at(0)), Target::new(target.y, earlier.at(1)));
        let marks = Marks { belows, aboves, sums };
        lanes!(group, ..group.sharers(), |lane| {
            move_references(
                group,
                lane,
                marks,
                clips,
                plane,
                range,
                to,
                positions,
                indices,
                refs,
                next,
                treelet_refs,
            );
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
        // Not one store to either: a choice of buffers is no SPIR-V for Vulkan, and an H200's driver dies of
        // it.
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
