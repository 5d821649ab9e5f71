//! Closest hit without a tree: the oracle every traversal is compared with.

use super::{JOB_RAYS, JOB_REFS, NOTHING, load, record, triangle::test};
use crate::{
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
    triangles: &Buf<Vec4>,
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
            let (a, b, c) = (triangles.at(3 * id), triangles.at(3 * id + 1), triangles.at(3 * id + 2));
            test(&ray, id, a.truncate(), b.truncate(), c.truncate(), &mut best);
            r += 1;
        }
        hits.put(i, record(&ray, &best));
    }
}

kernel! {
    /// [`brute`] over all rays.
    map BRUTE = brute, threads 64, {
        0 job: read u32, 1 header: read TreeHeader, 2 kept: read u32, 3 triangles: read Vec4,
        4 rays: read Vec4, 5 hits: write UVec4, 6 outcome: write u32,
    }
}
