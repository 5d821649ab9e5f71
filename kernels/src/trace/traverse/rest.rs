//! Hits of the exact test, third kernel: rays for which [`narrow`](super::narrow) had no room walk the tree once more.
//! They meet many triangles at a vertex, or as many on top of each other.

use super::{
    Steps,
    leaf::Every,
    narrow::TOO_MANY,
    stack::{ASIDE, walk},
};
use crate::{
    Group,
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots, scratch},
    trace::{
        frame::Frame,
        intersect::exact::Exact,
        job::{JOB_ANY, OUTCOME_STATUS, record},
        left::MARKS,
    },
};
use raykd_shared::TreeHeader;

/// Answers the rays of block `group.id` that are left.
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
    answer_left!(group, marks, job, outcome, |i| hits.at(i).w == TOO_MANY, |i| {
        let mut ray = Frame::new(rays.at(2 * i), rays.at(2 * i + 1), &header.at(0));
        let (aside, steps) = (&mut scratch::<u32, ASIDE>(), &mut Steps::default());
        let any = job.at(JOB_ANY) != 0;
        let best = walk::<Exact, Every, false>(&mut ray, pairs, corners, Every, any, aside, steps);
        hits.put(i, record(&ray, &best));
        if steps.status != 0 {
            outcome.or(OUTCOME_STATUS, steps.status);
        }
    });
}

of_query! {
    kernel {
        /// [`rest`] over all blocks.
        group REST = rest, threads 64, shared [marks: MARKS], query:
    } { , {} }
}
