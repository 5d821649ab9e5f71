//! Closest hit by stack traversal, with what it cost.

use super::{JOB_RAYS, OUTCOME_STATUS, Steps, leaf::After, load, record, stack::walk};
use crate::{
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::TreeHeader;

/// Answers ray `i` and writes its inner nodes, leaves and tests.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn steps(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    counts: &mut Buf<UVec4>,
) {
    if i < job.at(JOB_RAYS) {
        let ray = load(i, rays, &header.at(0), outcome);
        let mut steps = Steps::default();
        let best = walk::<false, false, true>(&ray, pairs, corners, After::NOTHING, &mut steps);
        hits.put(i, record(&ray, &best));
        counts.put(i, steps.words());
        if steps.status != 0 {
            outcome.or(OUTCOME_STATUS, steps.status);
        }
    }
}

kernel! {
    /// [`steps`] over all rays.
    map STEPS = steps, threads 64, {
        0 job: read u32, 1 header: read TreeHeader, 2 pairs: read UVec4, 3 corners: read Vec4,
        4 rays: read Vec4, 5 hits: write UVec4, 6 outcome: write u32,
        7 counts: write UVec4,
    }
}
