//! Closest hit without a tree: the oracle every traversal is compared with.

use super::{JOB_RAYS, JOB_REFS, NOTHING, load, record, triangle::test};
use crate::{
    build::boxes::vertex,
    glam::{UVec4, Vec4},
    mem::{Buf, Slots},
};
use raykd_shared::TreeHeader;

/// Tests ray `i` against every triangle of the list `kept`.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn brute(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    kept: &Buf<u32>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) {
    if i < job.at(JOB_RAYS) {
        let ray = load(i, rays, &header.at(0), outcome);
        let mut best = NOTHING;
        let end = if ray.valid { job.at(JOB_REFS) } else { 0 };
        let mut r = 0;
        while r < end {
            let id = kept.at(r);
            let a = vertex(positions, indices, id, 0);
            let b = vertex(positions, indices, id, 1);
            let c = vertex(positions, indices, id, 2);
            test(&ray, id, a, b, c, &mut best);
            r += 1;
        }
        hits.put(i, record(&ray, &best));
    }
}

kernel! {
    /// [`brute`] over all rays.
    map BRUTE = brute, threads 64, {
        0 job: read u32, 1 header: read TreeHeader, 2 kept: read u32, 3 positions: read f32,
        4 indices: read u32, 5 rays: read Vec4, 6 hits: write UVec4, 7 outcome: write u32,
    }
}
