//! Closest hits of the exact test, second kernel: the triangles that [`narrow`](super::narrow) found are tested.

use super::narrow::{LONG, TOO_MANY};
#[cfg(not(target_arch = "spirv"))]
use crate::trace::queries::Query;
use crate::{
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
    trace::{
        intersect::{Best, NORMAL, exact::Exact},
        job::{JOB_RAYS, OUTCOME_STATUS, load, record},
    },
};
use raykd_shared::{MISS, TreeHeader, status};

const NONE: UVec4 = UVec4::new(MISS, MISS, MISS, MISS);

/// Settles which of its triangles is the closest hit of ray `i`.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn settle(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    _pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    more: &Buf<UVec4>,
) {
    if i < job.at(JOB_RAYS) {
        let ray = load(i, rays, &header.at(0), outcome).whole();
        let first = hits.at(i);
        if first.w != TOO_MANY {
            let long = first.x != MISS && first.x & LONG != 0;
            let mut later = if long { more.at(i) } else { NONE };
            let mut left = if long { UVec4::new(first.x & !LONG, first.y, first.z, first.w) } else { first };
            let mut best = Best::NOTHING;
            // 1 until there are no more.
            let mut open = (left.x != MISS) as u32;
            let mut running = open != 0;
            while running {
                let (a, b, c) = corners.three(3 * left.x);
                running = Exact.settle(&ray, a.w.to_bits() & !NORMAL, (a, b, c), &mut best);
                left = UVec4::new(left.y, left.z, left.w, later.x);
                later = UVec4::new(later.y, later.z, later.w, MISS);
                if running && left.x == MISS {
                    running = false;
                    open = 0;
                }
            }
            hits.put(i, record(&ray, &best));
            if open != 0 {
                outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
            }
        }
    }
}

of_query! {
    kernel {
        /// [`settle`] over all rays.
        map SETTLE = settle, threads 64, query:
    } { , { 7 more: read UVec4 } }
}
