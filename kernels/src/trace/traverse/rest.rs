//! Closest hits of the exact test, third kernel: rays for which [`narrow`](super::narrow) had no room walk the tree once
//! more. They meet many triangles at a vertex, or as many on top of each other.

use super::{
    Steps,
    leaf::Every,
    narrow::TOO_MANY,
    stack::{ASIDE, walk},
};
#[cfg(not(target_arch = "spirv"))]
use crate::trace::queries::Query;
use crate::{
    Group,
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots, scratch},
    trace::{
        frame::Frame,
        intersect::exact::Exact,
        job::{JOB_RAYS, OUTCOME_LEFT, OUTCOME_STATUS, THREADS, loops_are_whole, record},
        undecided::{BLOCK, MARKS, marked_after},
    },
};
use raykd_shared::{TreeHeader, status};

/// Answers the rays of block `group.id` that are left.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn rest(
    group: Group,
    marks: &mut [u32; MARKS],
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) {
    let number = if outcome.at(OUTCOME_LEFT) != 0 { job.at(JOB_RAYS) } else { 0 };
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
            if hits.at(first + i).w == TOO_MANY {
                marks.or(i / 32, 1 << (i % 32));
            }
            i += THREADS;
        }
    });
    lanes!(group, |lane| {
        let mut before = lane;
        let mut running = number > 0;
        // 1 until there are no more.
        let mut open = running as u32;
        while running {
            let i = first + marked_after(before, marks);
            if i < first + BLOCK {
                let mut ray = Frame::new(rays.at(2 * i), rays.at(2 * i + 1), &header.at(0));
                let (aside, steps) = (&mut scratch::<u32, ASIDE>(), &mut Steps::default());
                let best = walk::<Exact, Every, false>(&mut ray, pairs, corners, Every, false, aside, steps);
                hits.put(i, record(&ray, &best));
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
        /// [`rest`] over all blocks.
        group REST = rest, threads 64, shared [marks: MARKS], query:
    } { , {} }
}
