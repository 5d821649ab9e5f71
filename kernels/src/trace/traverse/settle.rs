//! Hits of the exact test, second kernel: the triangles that [`narrow`](super::narrow) found are tested. On GPUs whose
//! doubles are quick, [`by_doubles`] takes its place, with the same answers.

use super::narrow::{LISTED, LONG, OTHER, TOO_MANY};
use crate::{
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
    trace::{
        frame::Frame,
        intersect::{Best, NORMAL, exact::Exact},
        job::{JOB_RAYS, OUTCOME_STATUS, record_divided},
        listed::{Listed, NONE},
    },
};
use raykd_shared::{MISS, TreeHeader, status};

/// Settles which of its triangles is the hit of ray `i`.
pub fn settle<const DOUBLES: bool>(
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
        let first = hits.at(i);
        if (first.w & LISTED != 0) & (first.w != TOO_MANY) {
            let ray = Frame::new(rays.at(2 * i), rays.at(2 * i + 1), &header.at(0)).whole();
            let mut later = UVec4::new(NONE, NONE, NONE, NONE);
            if first.z & LONG != 0 {
                later = more.at(i);
            }
            let now = UVec4::new(first.x, first.y, first.z & !LONG, first.w & !LISTED);
            let mut listed = Listed::new(now, later);
            let mut best = Best::NOTHING;
            let mut running = true;
            // 1 until there are no more.
            let mut open = 1;
            while running {
                let at = listed.first();
                let (a, b, c) = corners.three(3 * (at & !OTHER));
                let id = a.w.to_bits() & !NORMAL;
                running = if DOUBLES {
                    Exact.settle_by_doubles(&ray, id, (a, b, c), &mut best)
                } else {
                    Exact.settle(&ray, id, (a, b, c), &mut best)
                };
                listed.pass();
                // Any hits are those of one leaf.
                let enough = (best.triangle != MISS) & ((listed.first() ^ at) & OTHER != 0);
                if running && (listed.first() == NONE) | enough {
                    running = false;
                    open = 0;
                }
            }
            hits.put(i, record_divided(&ray, &best));
            if open != 0 {
                outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
            }
        }
    }
}

of_query! {
    kernel {
        /// [`settle`] over all rays.
        map SETTLE = settle::<false>, threads 64, query:
    } { , { 7 more: read UVec4 } }
}

/// By doubles.
pub mod by_doubles {
    use super::*;

    of_query! {
        kernel {
            /// [`settle`] over all rays.
            map_by_doubles SETTLE_BY_DOUBLES = settle::<true>, threads 64, query:
        } { , { 7 more: read UVec4 } }
    }
}
