//! Any hit by stack traversal, for shadows.

use super::{JOB_RAYS, OUTCOME_STATUS, Steps, leaf::After, load, record, stack::walk};
use crate::{
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::TreeHeader;

/// Answers ray `i`.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn any(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) {
    if i < job.at(JOB_RAYS) {
        let ray = load(i, rays, &header.at(0), outcome);
        let mut steps = Steps::default();
        let best = walk::<true, false, false>(&ray, pairs, corners, After::NOTHING, &mut steps);
        hits.put(i, record(&ray, &best));
        if steps.status != 0 {
            outcome.or(OUTCOME_STATUS, steps.status);
        }
    }
}

kernel! {
    /// [`any`] over all rays.
    map ANY = any, threads 64, {
        0 job: read u32, 1 header: read TreeHeader, 2 pairs: read UVec4, 3 corners: read Vec4,
        4 rays: read Vec4, 5 hits: write UVec4, 6 outcome: write u32,
    }
}
