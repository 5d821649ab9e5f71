//! All hits of a ray in order, for counting them or for passing through surfaces.
//!
//! A triangle may be listed in several leaves, and where a hit lies is too uncertain to say which of them owns it.
//! But hits have an order, (`t`, triangle), in which each comes once: so this asks for the closest hit after the
//! last one until there is none. `n` hits take `n + 1` traversals, each from the last hit on.

use super::{
    JOB_LIMIT, JOB_RAYS, OUTCOME_STATUS, Steps, leaf::After, load, record, stack::walk, triangle::Strict,
};
use crate::{
    glam::{UVec4, Vec4},
    math::high,
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{MISS, TreeHeader, status};

/// Answers ray `i`: its first hits, as many as the job's limit, the rest filled with misses; and how many it has.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn all(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    totals: &mut Buf<u32>,
) {
    if i < job.at(JOB_RAYS) {
        let limit = job.at(JOB_LIMIT);
        let mut ray = load(i, rays, &header.at(0), outcome);
        let mut steps = Steps::default();
        let mut after = After::NOTHING;
        let mut total = 0;
        let mut running = true;
        // 1 until there are no more.
        let mut open = 1;
        while running {
            let best = walk::<Strict, After, false>(&ray, pairs, corners, after, false, &mut steps);
            if best.triangle == MISS {
                running = false;
                open = 0;
            } else {
                if total < limit {
                    hits.put(i * limit + total, record(&ray, &best));
                }
                total += 1;
                after = After { t: best.t, triangle: best.triangle };
                ray.enter = high(ray.enter, best.t);
            }
        }
        let mut empty = total;
        while empty < limit {
            hits.put(i * limit + empty, UVec4::new(MISS, 0, 0, 0));
            empty += 1;
        }
        totals.put(i, total);
        if open != 0 {
            steps.status |= status::CUT_SHORT;
        }
        if steps.status != 0 {
            outcome.or(OUTCOME_STATUS, steps.status);
        }
    }
}

kernel! {
    /// [`all`] over all rays.
    map ALL = all, threads 64, {
        0 job: read u32, 1 header: read TreeHeader, 2 pairs: read UVec4, 3 corners: read Vec4,
        4 rays: read Vec4, 5 hits: write UVec4, 6 outcome: write u32, 7 totals: write u32,
    }
}
