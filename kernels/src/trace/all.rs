//! All hits of rays, in order. A triangle may be listed in several leaves, and where a hit lies is too uncertain to say
//! which of them owns it. But hits have an order, (`t`, triangle), in which each comes once: so a walk finds the
//! [`AT_ONCE`] closest hits after the last one, until there are fewer.
//!
//! A kernel counts the hits of each ray and keeps the first of them. Once the counts tell where each ray's hits begin
//! among all, another puts those there that were kept. For rays that have more the first kernel runs again.

use super::{
    frame::Frame,
    intersect::{Intersector, exact::Exact, strict::Strict},
    job::{JOB_LIMIT, JOB_RAYS, Left, OUTCOME_STATUS, SPAN, load, loops_are_whole, ray_of, record},
    traverse::{
        Steps,
        next::{self, AT_ONCE, After, Next, next_hits},
        stack::ASIDE,
    },
};
use crate::{
    Group,
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots, scratch},
};
use raykd_shared::{TreeHeader, status};

/// How many hits a ray are kept at most: a walk's.
pub const KEPT: u32 = AT_ONCE;
/// In the job, beside how many hits a ray are kept: rays have been counted, and those with more find all again.
pub const AGAIN: u32 = 0x8000_0000;

/// Finds the hits of a ray `after` one, up to which it has had `total`, until there are no more, or `enough`. Writes as
/// many as there is `room` for from `first` on, and returns how many it has had then.
#[inline(always)]
pub(super) fn find<I: Intersector>(
    ray: &mut Frame,
    tree: (&Buf<UVec4>, &Buf<Vec4>),
    hits: &mut Buf<UVec4>,
    (first, room): (u32, u32),
    enough: u32,
    (mut after, mut total): (After, u32),
    steps: &mut Steps,
) -> u32 {
    let (mut aside, mut own) = (scratch::<u32, ASIDE>(), scratch::<u32, { next::WORDS }>());
    let mut running = true;
    while running {
        let count = next_hits::<I>(ray, tree, &mut after, &mut aside, &mut own, steps);
        let mut k = 0;
        while k < count {
            if total < room {
                hits.put(first + total, record(ray, &Next::hit(&own, k)));
            }
            total += 1;
            k += 1;
        }
        running = count == AT_ONCE && total < enough && steps.status == 0;
    }
    total
}

/// Counts the hits of ray `i`, and keeps as many of the first as the job says. Where there are fewer, what lies
/// behind them stays as it is. Or puts those of a ray that has more where they begin.
#[inline(always)]
fn count<I: Intersector>(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    totals: &mut Buf<u32>,
    begins: &Buf<u32>,
) {
    let kept = job.at(JOB_LIMIT) & !AGAIN;
    let again = job.at(JOB_LIMIT) & AGAIN != 0;
    let (mut first, mut room, mut enough) = (i * kept, kept, u32::MAX);
    if again {
        first = begins.at(i);
        room = begins.at(i + 1) - first;
        enough = room;
    }
    if !again || room > kept {
        let mut ray = load(i, rays, &header.at(0), outcome);
        let mut steps = Steps::default();
        let (place, none) = ((first, room), (After::NOTHING, 0));
        let total = find::<I>(&mut ray, (pairs, corners), hits, place, enough, none, &mut steps);
        if !again {
            totals.put(i, total);
        }
        if steps.status != 0 || !loops_are_whole(job) {
            outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
        }
    }
}

/// Puts the hits that were kept of ray `i` where they begin, if these are all that are wanted.
pub fn gather(i: u32, job: &Buf<u32>, begins: &Buf<u32>, kept_hits: &Buf<UVec4>, hits: &mut Buf<UVec4>) {
    if i < job.at(JOB_RAYS) {
        let kept = job.at(JOB_LIMIT) & !AGAIN;
        let first = begins.at(i);
        let wanted = begins.at(i + 1) - first;
        if wanted <= kept {
            let mut k = 0;
            while k < wanted {
                hits.put(first + k, kept_hits.at(i * kept + k));
                k += 1;
            }
        }
    }
}

/// Declares the kernel that counts by a triangle test.
macro_rules! count_hits {
    ($file:ident::$name:ident = $test:ident) => {
        #[doc = concat!("Hits by [`", stringify!($test), "`].")]
        pub mod $file {
            use super::*;

            /// Counts the hits of the rays of a workgroup, or puts them where they begin.
            #[inline(always)]
            pub fn answer(
                group: Group,
                job: &Buf<u32>,
                header: &Buf<TreeHeader>,
                pairs: &Buf<UVec4>,
                corners: &Buf<Vec4>,
                rays: &Buf<Vec4>,
                hits: &mut Buf<UVec4>,
                outcome: &mut Buf<u32>,
                totals: &mut Buf<u32>,
                begins: &Buf<u32>,
            ) {
                let left = by_eight!(
                    group.usual,
                    crate::trace::side_by_side::all::<$test>(
                        &group, job, header, pairs, corners, rays, hits, outcome, totals,
                    ),
                    else Left::ALL
                );
                lanes!(group, |lane| {
                    let i = ray_of(group.id * group.width + lane, job);
                    if i < job.at(JOB_RAYS) && left.has(lane) {
                        count::<$test>(
                            i, job, header, pairs, corners, rays, hits, outcome, totals, begins,
                        );
                    }
                });
            }

            of_query! {
                kernel {
                    /// The hits of all rays.
                    group $name = answer, threads 64, span SPAN, shared [], query:
                } { , { 7 totals: write u32, 8 begins: read u32 } }
            }
        }
    };
}

count_hits!(strict_hits::COUNT_HITS = Strict);
count_hits!(exact_hits::COUNT_EXACT_HITS = Exact);

kernel! {
    /// [`gather`] over all rays.
    map GATHER = gather, threads 64, {
        0 job: read u32, 1 begins: read u32, 2 kept_hits: read UVec4, 3 hits: write UVec4,
    }
}

kernels! {
    /// The kernels of this file.
    strict_hits::COUNT_HITS,
    exact_hits::COUNT_EXACT_HITS,
    GATHER,
}
