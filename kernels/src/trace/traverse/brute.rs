//! Closest hit without a tree: the oracle every traversal is compared with.
//!
//! A dispatch goes through a slice of the triangles and hands its best hit to the next: no loop gets long
//! enough for a driver to time out or to cut it short.

use crate::{
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
    mesh::triangle,
    trace::{
        intersect::{Best, Intersector},
        job::{JOB_FROM, JOB_RAYS, JOB_TO, OUTCOME_STATUS, load, record},
    },
};
use raykd_shared::{TreeHeader, status};

/// Tests ray `i` against the job's slice of the list `kept`.
pub fn brute<I: Intersector>(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    kept: &Buf<u32>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    bests: &mut Buf<UVec4>,
) {
    if i < job.at(JOB_RAYS) {
        let ray = load(i, rays, &header.at(0), outcome);
        let ray = if I::WHOLE { ray.whole() } else { ray };
        let by = I::new(&ray);
        let from = job.at(JOB_FROM);
        let mut best = Best::NOTHING;
        if from > 0 {
            let (head, tail) = (bests.at(2 * i), bests.at(2 * i + 1));
            best = Best {
                t: f32::from_bits(head.x),
                triangle: head.y,
                u: f32::from_bits(head.z),
                v: f32::from_bits(head.w),
                det: f32::from_bits(tail.x),
            };
        }
        let end = if ray.valid { job.at(JOB_TO) } else { from };
        let mut r = from;
        let mut whole = true;
        while r < end {
            let id = kept.at(r);
            let (a, b, c) = triangle(positions, indices, id);
            let corners = I::lay_out(a, b, c);
            let done = by.test_unseen(&ray, id, corners, &mut best);
            if I::LOOPS {
                whole &= done;
            }
            r += 1;
        }
        // Not `<`: see leaf.rs.
        if r != end || (I::LOOPS && !whole) {
            outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
        }
        bests.put(2 * i, UVec4::new(best.t.to_bits(), best.triangle, best.u.to_bits(), best.v.to_bits()));
        bests.put(2 * i + 1, UVec4::new(best.det.to_bits(), 0, 0, 0));
        hits.put(i, record(&ray, &best));
    }
}
