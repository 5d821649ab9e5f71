//! What a dispatch is told and what it answers: the records of job and outcome, rays and hits.

use super::{frame::Frame, intersect::Best};
use crate::{
    ON_GPU,
    glam::{UVec4, Vec4},
    math::{div, ldexp},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{MISS, TreeHeader};

/// Rays a workgroup.
pub const THREADS: u32 = 64;

/// Words of the job record: how many rays this dispatch has.
pub const JOB_RAYS: u32 = 0;
/// Walks through the tree: the logarithm of how far apart the lanes that take rays are.
pub const JOB_APART: u32 = 1;
/// Brute force: where in the list of triangles this dispatch starts.
pub const JOB_FROM: u32 = 1;
/// Brute force: where it ends.
pub const JOB_TO: u32 = 2;
/// Queries of either kind: 1 if any hit will do, 0 for the closest.
pub const JOB_ANY: u32 = 3;
/// All hits: how many of a ray are kept at most, and [`AGAIN`](super::all::AGAIN).
pub const JOB_LIMIT: u32 = 3;
/// Words of the job record.
pub const JOB_WORDS: u32 = 4;

/// Words of the outcome record: status bits, see [`raykd_shared::status`].
pub const OUTCOME_STATUS: u32 = 0;
/// How many rays were invalid: NaN, infinite or zero direction, origin out of range.
pub const OUTCOME_INVALID: u32 = 1;
/// Whether a kernel has left rays to one that follows: 1 if so.
pub const OUTCOME_LEFT: u32 = 2;
/// Words of the outcome record.
pub const OUTCOME_WORDS: u32 = 4;

/// The ray that a lane of a dispatch takes, or a number above all rays for none. Lanes go through the tree in step,
/// each as long as the longest way of its warp: few rays are done sooner with some lanes idle, and more warps.
#[inline(always)]
pub fn ray_of(lane: u32, job: &Buf<u32>) -> u32 {
    let apart = job.at(JOB_APART);
    if lane >> apart << apart == lane { lane >> apart } else { u32::MAX }
}

/// Workgroups that a CPU may run as one: rays that go each on its own take the place of those that are done, and at the
/// end few are left.
pub const SPAN: u32 = 16;

/// The rays of a workgroup that have no answer yet, a bit a lane: a CPU answers some beforehand, eight at once.
#[derive(Clone, Copy, Debug)]
pub struct Left([u32; (SPAN * THREADS / 32) as usize]);

impl Left {
    /// None has.
    pub const ALL: Self = Self([u32::MAX; (SPAN * THREADS / 32) as usize]);

    /// Whether the ray of a lane is left.
    #[inline(always)]
    pub fn has(self, lane: u32) -> bool {
        ON_GPU || self.0.at(lane / 32) >> (lane % 32) & 1 != 0
    }
}

#[cfg(target_arch = "x86_64")]
impl Left {
    /// The first `count` lanes have none.
    #[inline(always)]
    pub(super) fn first(count: u32) -> Self {
        let mut left = Self([0; (SPAN * THREADS / 32) as usize]);
        let (mut word, mut rest) = (0, count);
        while rest > 0 {
            left.0[word] = u32::MAX >> (32 - rest.min(32));
            (word, rest) = (word + 1, rest.saturating_sub(32));
        }
        left
    }

    /// How many they are.
    #[inline(always)]
    pub(super) fn count(&self) -> u32 {
        let (mut count, mut word) = (0, 0);
        while word < self.0.len() {
            count += self.0[word].count_ones();
            word += 1;
        }
        count
    }

    /// Of eight lanes from `first` on, a multiple of eight, some have their answers.
    #[inline(always)]
    pub(super) fn answer(&mut self, first: u32, some: u32) {
        self.0[first as usize / 32] &= !(some << (first % 32));
    }

    /// A lane has no answer after all.
    #[inline(always)]
    pub(super) fn put_back(&mut self, lane: u32) {
        self.0[lane as usize / 32] |= 1 << (lane % 32);
    }

    /// Takes the lowest lane from word `word` on, to which it goes.
    #[inline(always)]
    pub(super) fn take(&mut self, word: &mut usize) -> Option<u32> {
        while *word < self.0.len() {
            let bits = &mut self.0[*word];
            if *bits != 0 {
                let lane = 32 * *word as u32 + bits.trailing_zeros();
                *bits &= *bits - 1;
                return Some(lane);
            }
            *word += 1;
        }
        None
    }
}

/// Loads and prepares ray `i`, and counts it if it is none.
#[inline(always)]
pub fn load(i: u32, rays: &Buf<Vec4>, header: &TreeHeader, outcome: &mut Buf<u32>) -> Frame {
    let ray = Frame::new(rays.at(2 * i), rays.at(2 * i + 1), header);
    if !ray.valid {
        outcome.add(OUTCOME_INVALID, 1);
    }
    ray
}

/// Whether loops still go round as often as they should: a software driver that leaves one early, see
/// [`raykd_shared::status::CUT_SHORT`], leaves all later ones after a round, this too. So asked last, it tells of all
/// loops of an invocation.
#[inline(always)]
pub fn loops_are_whole(job: &Buf<u32>) -> bool {
    // Two or three, which no compiler knows: it would do without the loop.
    let rounds = 2 + (job.at(JOB_RAYS) & 1);
    let (mut i, mut counted) = (0, 0);
    while i < rounds {
        i += 1;
        counted += 1;
    }
    counted == rounds
}

/// The bits of a number, without the sign of a zero.
#[inline(always)]
fn positive_zero(a: f32) -> u32 {
    if a == 0.0 { 0 } else { a.to_bits() }
}

/// The hit record of a finished ray: triangle, `t`, `u`, `v`.
#[inline(always)]
pub fn record(ray: &Frame, best: &Best) -> UVec4 {
    record_with(ray, best, div(best.u, best.det), div(best.v, best.det))
}

/// The same if `det` is 1.
#[inline(always)]
pub fn record_divided(ray: &Frame, best: &Best) -> UVec4 {
    // Subnormal numbers become 0.
    record_with(ray, best, ldexp(best.u, 0), ldexp(best.v, 0))
}

#[inline(always)]
fn record_with(ray: &Frame, best: &Best, u: f32, v: f32) -> UVec4 {
    if best.triangle == MISS {
        UVec4::new(MISS, 0, 0, 0)
    } else {
        let t = ldexp(best.t, -ray.stretch);
        UVec4::new(best.triangle, positive_zero(t), positive_zero(u), positive_zero(v))
    }
}
