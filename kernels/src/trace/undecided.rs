//! Crossings where nobody reads between two kernels: those that floats did not tell of are counted again, and all are
//! packed.

use super::{
    frame::Frame,
    job::{JOB_RAYS, OUTCOME_STATUS, THREADS, loops_are_whole},
    queries::crossed,
    traverse::Steps,
};
use crate::{
    Group,
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{TreeHeader, status};

#[cfg(not(target_arch = "spirv"))]
use super::queries::Query;

/// Rays of a workgroup. About one in a hundred is undecided, so that a workgroup has some for its lanes to share.
pub const BLOCK: u32 = 1024;
/// Words of its marks.
pub(super) const MARKS: usize = BLOCK as usize / 32;

/// The ray of a block that is marked with so many before it, or [`BLOCK`] if there are no more.
#[inline(always)]
pub(super) fn marked_after(before: u32, marks: &[u32; MARKS]) -> u32 {
    let (mut rest, mut word, mut found) = (before, 0, BLOCK);
    while word < MARKS as u32 && found == BLOCK {
        let mut bits = marks.at(word);
        let count = bits.count_ones();
        if rest < count {
            while rest > 0 {
                bits &= bits - 1;
                rest -= 1;
            }
            found = 32 * word + bits.trailing_zeros();
        } else {
            rest -= count;
        }
        word += 1;
    }
    found
}

/// Counts what [`quick_crossings`](super::queries::quick_crossings) left undecided in block `group.id`. Writes of each
/// ray how many crossings leave and how many enter.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn settle(
    group: Group,
    marks: &mut [u32; MARKS],
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    crossings: &mut Buf<u32>,
) {
    let number = job.at(JOB_RAYS);
    // There may be more workgroups than blocks.
    let first = if group.id > number / BLOCK { number } else { group.id * BLOCK };
    lanes!(group, |lane| {
        if lane < MARKS as u32 {
            marks.put(lane, 0);
        }
    });
    lanes!(group, |lane| {
        let mut i = lane;
        while i < BLOCK && first + i < number {
            let found = hits.at(first + i);
            if found.z != 0 {
                marks.or(i / 32, 1 << (i % 32));
            } else {
                crossings.put(2 * (first + i), found.x);
                crossings.put(2 * (first + i) + 1, found.y);
            }
            i += THREADS;
        }
    });
    lanes!(group, |lane| {
        let mut before = lane;
        let mut running = true;
        // 1 until there are no more.
        let mut open = 1;
        while running {
            let i = first + marked_after(before, marks);
            if i < first + BLOCK {
                let mut ray = Frame::new(rays.at(2 * i), rays.at(2 * i + 1), &header.at(0));
                let mut steps = Steps::default();
                let found = crossed::<false>(&mut ray, pairs, corners, &mut steps);
                crossings.put(2 * i, found.leaving);
                crossings.put(2 * i + 1, found.entering);
                if steps.status != 0 {
                    outcome.or(OUTCOME_STATUS, steps.status);
                }
                before += THREADS;
            } else {
                running = false;
                open = 0;
            }
        }
        if open != 0 || !loops_are_whole(job) {
            outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
        }
    });
}

of_query! {
    kernel {
        /// [`settle`] over all blocks.
        group UNDECIDED = settle, threads 64, shared [marks: MARKS], query:
    } { , { 7 crossings: write u32 } }
}
