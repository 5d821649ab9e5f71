//! Marks the triangles that have area, counts them by blocks, and bounds them.

use super::{
    BLOCK, FOUND_HI, FOUND_LO, FOUND_SMALLEST, JOB_AGAIN, JOB_DUST, JOB_TRIANGLES, JOB_VERTICES, MARKS,
    area::has_area, corners, size, vertex,
};
use crate::{
    Group,
    build::bin::ordered_bits,
    glam::UVec3,
    mem::{Atomics, Buf, Slots},
};

/// Lanes of a workgroup.
const LANES: u32 = 256;

// What the lanes of a workgroup gather.
const LO: u32 = 0;
const HI: u32 = 3;
const SMALLEST: u32 = 6;
const COUNT: u32 = 7;
const WORDS: usize = 8;

/// A box by the [`ordered_bits`] of its corners, and the least magnitude other than 0.
#[derive(Clone, Copy)]
struct Measure {
    lo: UVec3,
    hi: UVec3,
    smallest: u32,
}

#[inline(always)]
fn least(a: u32, b: u32) -> u32 {
    if b < a { b } else { a }
}

#[inline(always)]
fn most(a: u32, b: u32) -> u32 {
    if b > a { b } else { a }
}

impl Measure {
    /// With a vertex.
    #[inline(always)]
    fn with(self, p: UVec3) -> Self {
        let (x, y, z) = (ordered_bits(p.x), ordered_bits(p.y), ordered_bits(p.z));
        // 0 wraps around.
        let small = move |bits: u32| size(bits).wrapping_sub(1);
        let smallest = least(least(small(p.x), small(p.y)), small(p.z)).wrapping_add(1);
        Self {
            lo: UVec3::new(least(self.lo.x, x), least(self.lo.y, y), least(self.lo.z, z)),
            hi: UVec3::new(most(self.hi.x, x), most(self.hi.y, y), most(self.hi.z, z)),
            smallest: least(self.smallest, if smallest == 0 { u32::MAX } else { smallest }),
        }
    }
}

/// Sifts block `group.id`.
pub fn sift(
    group: Group,
    sums: &mut [u32; WORDS],
    marked: &mut [u32; MARKS as usize],
    job: &Buf<u32>,
    positions: &Buf<u32>,
    indices: &Buf<u32>,
    marks: &mut Buf<u32>,
    counts: &mut Buf<u32>,
    found: &mut Buf<u32>,
) {
    let (number, triangles) = (job.at(JOB_VERTICES), job.at(JOB_TRIANGLES));
    let (dust, again) = (job.at(JOB_DUST), job.at(JOB_AGAIN) != 0);
    lanes!(group, |lane| {
        if lane < WORDS as u32 {
            sums.put(lane, if lane < HI || lane == SMALLEST { u32::MAX } else { 0 });
        }
        if lane < MARKS {
            marked.put(lane, 0);
        }
    });
    lanes!(group, |lane| {
        let mut measure = Measure { lo: UVec3::MAX, hi: UVec3::ZERO, smallest: u32::MAX };
        let mut count = 0;
        let mut i = lane;
        while i < BLOCK {
            let t = group.id * BLOCK + i;
            if t < triangles && (!again || (marks.at(t / 32) >> (t % 32)) & 1 != 0) {
                let v = corners(indices, t);
                // Others are told of by who copied them.
                if v.x < number && v.y < number && v.z < number {
                    let (a, b, c) = (vertex(positions, v.x), vertex(positions, v.y), vertex(positions, v.z));
                    if has_area(a, b, c, dust) {
                        marked.or(i / 32, 1 << (i % 32));
                        measure = measure.with(a).with(b).with(c);
                        count += 1;
                    }
                }
            }
            i += LANES;
        }
        if count > 0 {
            sums.add(COUNT, count);
            sums.lower(LO, measure.lo.x);
            sums.lower(LO + 1, measure.lo.y);
            sums.lower(LO + 2, measure.lo.z);
            sums.raise(HI, measure.hi.x);
            sums.raise(HI + 1, measure.hi.y);
            sums.raise(HI + 2, measure.hi.z);
            sums.lower(SMALLEST, measure.smallest);
        }
    });
    lanes!(group, |lane| {
        // Workgroups come in whole rows.
        let is_one = group.id * BLOCK < triangles;
        if is_one && lane < MARKS {
            marks.put(group.id * MARKS + lane, marked.at(lane));
        }
        if is_one && lane == COUNT {
            counts.put(group.id, sums.at(COUNT));
        }
        if sums.at(COUNT) > 0 && lane < COUNT {
            let word = sums.at(lane);
            if lane < HI {
                found.lower(FOUND_LO + lane, word);
            } else if lane < SMALLEST {
                found.raise(FOUND_HI + lane - HI, word);
            } else {
                found.lower(FOUND_SMALLEST, word);
            }
        }
    });
}

kernel! {
    /// [`sift`] over all blocks.
    group SIFT = sift, threads 256, shared [sums: WORDS, marked: MARKS as usize], {
        0 job: read u32, 1 positions: read u32, 2 indices: read u32, 3 marks: write u32, 4 counts: write u32,
        5 found: write u32,
    }
}
