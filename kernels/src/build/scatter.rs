//! Moves the references of a chunk to the children's lists, in order, and makes the histograms of large children on the
//! way.

use super::{
    LEVEL_CHUNKS, LEVEL_FITS, SplitPlane, ahead,
    alloc::TO_BRANCH,
    bin::{self, TABLE, enter_box, rates},
    chunk_of, cut,
    marks::{self, BLOCKS, Marks, WORDS, scan},
    plane_of,
    reference::{Reference, Words, triangle_at},
};
use crate::{
    Group, ON_GPU,
    glam::{UVec2, UVec4, Vec3},
    kernel::Bits,
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{BuildParams, rule};

/// Reads which references of the chunk go below and above, in so many `words` of `bits` from `from` on, and adds up
/// what the node's chunks before this one, from `first_chunk` on, send either way.
#[inline(always)]
fn read(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    earlier: &mut [u32; 2],
    bits: &Buf<UVec2>,
    sides: &Buf<UVec2>,
    (from, words): (u32, u32),
    first_chunk: u32,
) {
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = lane;
        while word < words {
            let both = bits.at(from + word);
            belows.put(word, both.x);
            aboves.put(word, both.y);
            word += step;
        }
        if lane == 0 {
            earlier.put(0, 0);
            earlier.put(1, 0);
        }
    });
    lanes!(group, ..step, |lane| {
        let mut chunk = first_chunk + lane;
        while chunk < group.id {
            let both = sides.at(chunk);
            earlier.add(0, both.x);
            earlier.add(1, both.y);
            chunk += step;
        }
    });
}

/// Moves every `step`-th reference from `lane` on, in batches: triangles are clipped together, for which
/// lanes meet and a CPU asks ahead.
#[inline(always)]
fn move_references(
    group: Group,
    lane: u32,
    below_table: &mut [u32; TABLE],
    above_table: &mut [u32; TABLE],
    marks: Marks,
    clips: bool,
    plane: SplitPlane,
    (start, number): (u32, u32),
    (below, above): (Target, Target),
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<UVec4>,
    next: &mut Buf<UVec4>,
    branch_refs: &mut Buf<UVec4>,
) {
    let step = group.sharers();
    let mut i = lane;
    while i < number {
        let mut straddling = move_boxes(
            group,
            below_table,
            above_table,
            marks,
            clips,
            (start, i, number),
            (below, above),
            refs,
            next,
            branch_refs,
        );
        let triangle_of = |k| triangle_at(refs, start + i + k * step);
        ahead::indices(group, indices, straddling, triangle_of);
        ahead::corners(group, positions, indices, straddling, triangle_of);
        while straddling != 0 {
            let at = i + straddling.trailing_zeros() * step;
            straddling &= straddling - 1;
            let whole = Reference::load(refs, start + at);
            let (under, over) = whole.halves(positions, indices, plane);
            let (under, over) = (Reference { bounds: under, ..whole }, Reference { bounds: over, ..whole });
            below.put(group, under.words(), marks.below_before(at), below_table, next, branch_refs);
            above.put(group, over.words(), marks.above_before(at), above_table, next, branch_refs);
        }
        i += 32 * step;
    }
}

/// Moves every `step`-th reference from `i` on, 32 at most, but those that go both ways: a bit for each.
#[inline(always)]
fn move_boxes(
    group: Group,
    below_table: &mut [u32; TABLE],
    above_table: &mut [u32; TABLE],
    marks: Marks,
    clips: bool,
    (start, i, number): (u32, u32, u32),
    (below, above): (Target, Target),
    refs: &Buf<UVec4>,
    next: &mut Buf<UVec4>,
    branch_refs: &mut Buf<UVec4>,
) -> u32 {
    let step = group.sharers();
    if !ON_GPU && step == 1 {
        let (is_below, is_above) = (marks.belows.at(i / 32), marks.aboves.at(i / 32));
        let straddling = if clips { is_below & is_above } else { 0 };
        for k in Bits(is_below & !straddling) {
            let words = Words::load(refs, start + i + k);
            below.put(group, words, marks.below_before(i + k), below_table, next, branch_refs);
        }
        for k in Bits(is_above & !straddling) {
            let words = Words::load(refs, start + i + k);
            above.put(group, words, marks.above_before(i + k), above_table, next, branch_refs);
        }
        return straddling;
    }
    let mut straddling = 0u32;
    let mut k = 0;
    while k < 32 && i + k * step < number {
        let at = i + k * step;
        let (is_below, is_above) = marks.sides(at);
        if is_below | is_above {
            let words = Words::load(refs, start + at);
            if clips && is_below && is_above {
                straddling |= 1 << k;
            } else {
                if is_below {
                    below.put(group, words, marks.below_before(at), below_table, next, branch_refs);
                }
                if is_above {
                    above.put(group, words, marks.above_before(at), above_table, next, branch_refs);
                }
            }
        }
        k += 1;
    }
    straddling
}

/// Scatters chunk `group.id`. References that go both ways are clipped again: [`super::count`] has no room for two
/// boxes.
#[inline(always)]
pub fn scatter(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    sums: &mut [u32; WORDS],
    blocks: &mut [u32; BLOCKS],
    earlier: &mut [u32; 2],
    below_table: &mut [u32; TABLE],
    above_table: &mut [u32; TABLE],
    below_rate: &mut [u32; 3],
    above_rate: &mut [u32; 3],
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    refs: &Buf<UVec4>,
    planes: &Buf<UVec2>,
    bits: &Buf<UVec2>,
    sides: &Buf<UVec2>,
    targets: &Buf<UVec4>,
    next_level: &Buf<u32>,
    next: &mut Buf<UVec4>,
    branch_refs: &mut Buf<UVec4>,
    hists: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) && next_level.at(LEVEL_FITS) != 0 {
        let references = params.at(0).references;
        let (node, item, start, number) = chunk_of(group.id, references, chunks, active);
        let plane = plane_of(planes, node);
        let clips = (params.at(0).rule & rule::CLIP) != 0;
        let range = (start, number);
        let words = number.div_ceil(32);
        let its_bits = (group.id * marks::bits(references), words);
        read(group, belows, aboves, earlier, bits, sides, its_bits, item.extra);
        scan(group, belows, aboves, sums, blocks, words);
        let marks = Marks { belows, aboves, sums };
        let target = targets.at(node);
        let (is_below, is_above) = ((target.x & TO_BRANCH) == 0, (target.y & TO_BRANCH) == 0);
        let (hi_below, lo_above) = cut(item.lo, item.hi, plane);
        if is_below {
            bin::start(group, below_table, below_rate, item.lo, hi_below);
        }
        if is_above {
            bin::start(group, above_table, above_rate, lo_above, item.hi);
        }
        lanes!(group, ..group.sharers(), |lane| {
            let below = Target::new(target.x, earlier.at(0), item.lo, rates(below_rate));
            let above = Target::new(target.y, earlier.at(1), lo_above, rates(above_rate));
            move_references(
                group,
                lane,
                below_table,
                above_table,
                marks,
                clips,
                plane,
                range,
                (below, above),
                positions,
                indices,
                refs,
                next,
                branch_refs,
            );
        });
        if is_below {
            bin::add(group, below_table, hists, target.z);
        }
        if is_above {
            bin::add(group, above_table, hists, target.w);
        }
    }
}

/// Where a chunk's references for a child go.
#[derive(Clone, Copy)]
struct Target {
    is_branch: bool,
    first: u32,
    /// Of a large child, where its box begins, and how many bins there are to a unit of length.
    from: Vec3,
    rates: Vec3,
}

impl Target {
    /// `earlier` ones come from other chunks.
    #[inline(always)]
    fn new(child: u32, earlier: u32, from: Vec3, rates: Vec3) -> Self {
        Self { is_branch: (child & TO_BRANCH) != 0, first: (child & !TO_BRANCH) + earlier, from, rates }
    }

    /// Stores a reference, `before` which others come from this chunk.
    #[inline(always)]
    fn put(
        &self,
        group: Group,
        words: Words,
        before: u32,
        table: &mut [u32; TABLE],
        next: &mut Buf<UVec4>,
        branch_refs: &mut Buf<UVec4>,
    ) {
        // Not one store to either: a choice of buffers is no SPIR-V for Vulkan, and an H200's driver dies of
        // it.
        if self.is_branch {
            words.store(branch_refs, self.first + before);
        } else {
            words.store(next, self.first + before);
            enter_box(&group, table, self.rates, self.from, words);
        }
    }
}

kernel! {
    /// [`scatter`] over all chunks of a level.
    group SCATTER = scatter, threads 256, shared [
        belows: WORDS, aboves: WORDS, sums: WORDS, blocks: BLOCKS, earlier: 2, below_table: TABLE, above_table: TABLE,
        below_rate: 3, above_rate: 3
    ], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32,
        4 active: read UVec4, 5 chunks: read u32, 6 refs: read UVec4, 7 planes: read UVec2, 8 bits: read UVec2,
        9 sides: read UVec2, 10 targets: read UVec4, 11 next_level: read u32, 12 next: write UVec4,
        13 branch_refs: write UVec4, 14 hists: write u32,
    }
}
