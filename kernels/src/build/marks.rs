//! Which references go below a plane and which above, a bit each; how many go there before one is a count of bits.

use super::{
    SplitPlane, ahead,
    clip::sides_of_halves,
    reference::{Reference, triangle_at},
};
use crate::{
    Group, ON_GPU,
    glam::UVec4,
    kernel::Bits,
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::limits::{MOST_CHUNK, chunk};

/// Words of a bit for each reference of the largest chunk.
pub const WORDS: usize = (MOST_CHUNK / 32) as usize;
/// Words whose sums are added up by one lane.
const BLOCK: u32 = 8;
/// Words of the sums.
pub const BLOCKS: usize = WORDS / BLOCK as usize;

/// Words of a bit for each reference of a chunk, in a mesh of so many `references`.
#[inline(always)]
pub const fn bits(references: u32) -> u32 {
    chunk(references) / 32
}

/// Marks which of `number` references from `start` on go below and above `plane`. Boxes that straddle it, of triangles
/// that do not, are clipped.
#[inline(always)]
pub fn mark(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    clips: bool,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &mut Buf<UVec4>,
    start: u32,
    number: u32,
    plane: SplitPlane,
) {
    if !ON_GPU && group.sharers() == 1 {
        return mark_words(group, belows, aboves, clips, positions, indices, refs, start, number, plane);
    }
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = lane;
        while word < number.div_ceil(32) {
            belows.put(word, 0);
            aboves.put(word, 0);
            word += step;
        }
    });
    lanes!(group, ..step, |lane| {
        // In batches: triangles are looked at together, in which lanes meet.
        let mut i = lane;
        while i < number {
            let mut straddling = mark_boxes(belows, aboves, clips, refs, (start, i, number), step, plane);
            while straddling != 0 {
                let at = i + straddling.trailing_zeros() * step;
                straddling &= straddling - 1;
                let mut reference = Reference::load(refs, start + at);
                let (under, over) = reference.halves(positions, indices, plane);
                let s = sides_of_halves(&under, &over);
                if s != 3 {
                    reference.bounds = if s == 2 { over } else { under };
                    reference.store(refs, start + at);
                }
                belows.mark(at / 32, (s & 1) << (at % 32));
                aboves.mark(at / 32, (s >> 1) << (at % 32));
            }
            i += 32 * step;
        }
    });
}

/// A bit for each of the next 32 of so many references which goes below a plane, and one for each which goes above.
#[inline(always)]
pub(super) fn sides_of(refs: &Buf<UVec4>, first: u32, number: u32, plane: SplitPlane) -> (u32, u32) {
    let (mut below, mut above) = (0, 0);
    for k in 0..if number < 32 { number } else { 32 } {
        let s = Reference::sides_at(refs, first + k, plane);
        below |= (s & 1) << k;
        above |= (s >> 1) << k;
    }
    (below, above)
}

/// [`mark`] by the one lane of a CPU: what straddles the plane is found first, and asked for.
#[inline(always)]
fn mark_words(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    clips: bool,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &mut Buf<UVec4>,
    start: u32,
    number: u32,
    plane: SplitPlane,
) {
    let words = number.div_ceil(32);
    for word in 0..words {
        let (below, above) = sides_of(refs, start + 32 * word, number - 32 * word, plane);
        belows.put(word, below);
        aboves.put(word, above);
        if clips {
            ahead::indices(group, indices, below & above, |k| triangle_at(refs, start + 32 * word + k));
        }
    }
    let both = |belows: &[u32; WORDS], aboves: &[u32; WORDS], word: u32| {
        if clips && word < words { belows.at(word) & aboves.at(word) } else { 0 }
    };
    for word in 0..words {
        let next = both(belows, aboves, word + 1);
        ahead::corners(group, positions, indices, next, |k| triangle_at(refs, start + 32 * (word + 1) + k));
        let (mut below, mut above) = (belows.at(word), aboves.at(word));
        for k in Bits(both(belows, aboves, word)) {
            let mut reference = Reference::load(refs, start + 32 * word + k);
            let (under, over) = reference.halves(positions, indices, plane);
            let s = sides_of_halves(&under, &over);
            if s != 3 {
                reference.bounds = if s == 2 { over } else { under };
                reference.store(refs, start + 32 * word + k);
            }
            below &= !((!s & 1) << k);
            above &= !((!s >> 1 & 1) << k);
        }
        belows.put(word, below);
        aboves.put(word, above);
    }
}

/// [`mark`] for every `step`-th reference from `i` on, 32 at most; a bit for each box that straddles the plane.
#[inline(always)]
fn mark_boxes(
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    clips: bool,
    refs: &Buf<UVec4>,
    (start, i, number): (u32, u32, u32),
    step: u32,
    plane: SplitPlane,
) -> u32 {
    let mut straddling = 0u32;
    let mut k = 0;
    while k < 32 && i + k * step < number {
        let at = i + k * step;
        let reference = Reference::load(refs, start + at);
        let s = reference.sides(plane);
        if clips && s == 3 {
            straddling |= 1 << k;
        } else {
            belows.mark(at / 32, (s & 1) << (at % 32));
            aboves.mark(at / 32, (s >> 1) << (at % 32));
        }
        k += 1;
    }
    straddling
}

/// How many references go below, and in the upper half of a sum above, before each of `words` words: first
/// before those of its block, then before its block.
#[inline(always)]
pub fn scan(
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
#[derive(Clone, Copy, Debug)]
pub struct Marks<'a> {
    /// A bit for each that goes below.
    pub belows: &'a [u32; WORDS],
    /// A bit for each that goes above.
    pub aboves: &'a [u32; WORDS],
    /// See [`scan`].
    pub sums: &'a [u32; WORDS],
}

impl Marks<'_> {
    /// Whether reference `i` goes below, and whether above.
    #[inline(always)]
    pub fn sides(&self, i: u32) -> (bool, bool) {
        let bit = 1 << (i % 32);
        (self.belows.at(i / 32) & bit != 0, self.aboves.at(i / 32) & bit != 0)
    }

    /// How many go below before reference `i`.
    #[inline(always)]
    pub fn below_before(&self, i: u32) -> u32 {
        (self.sums.at(i / 32) & 0xFFFF) + ones_before(self.belows, i)
    }

    /// How many go above.
    #[inline(always)]
    pub fn above_before(&self, i: u32) -> u32 {
        (self.sums.at(i / 32) >> 16) + ones_before(self.aboves, i)
    }

    /// How many of the first `number` go below, and above; after [`scan`].
    #[inline(always)]
    pub fn counts(&self, number: u32) -> (u32, u32) {
        let last = (number - 1) / 32;
        let (below, above) = (self.sums.at(last) & 0xFFFF, self.sums.at(last) >> 16);
        (below + self.belows.at(last).count_ones(), above + self.aboves.at(last).count_ones())
    }
}

/// How many bits are set in the word of bit `at`, before it.
#[inline(always)]
fn ones_before(bits: &[u32; WORDS], at: u32) -> u32 {
    (bits.at(at / 32) & ((1 << (at % 32)) - 1)).count_ones()
}
