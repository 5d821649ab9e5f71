//! How often rays cross the surface, and from which sides, by the rule of [`perturbed`](super::intersect::perturbed).
//!
//! A first kernel walks the tree. It counts what floats tell of, and lists what they do not: triangles that the ray
//! passes at an edge or a vertex, or in whose plane it starts. A second kernel decides those; where there were too
//! many, it walks once more, by the exact test.

use super::{
    frame::Frame,
    intersect::{Best, Intersector, NORMAL, exact::Exact, perturbed::Perturbed},
    job::{JOB_RAYS, Left, OUTCOME_STATUS, load, loops_are_whole, ray_of},
    left::MARKS,
    listed::{Listed, NONE},
    queries::SHARED,
    tally::{MOST_OPEN, TOO_MANY, Tally, UNDECIDED, WORDS},
    traverse::{
        Steps,
        next::{self, AT_ONCE, After, Next, next_hits},
        stack::{ASIDE, walk_keeping},
    },
};
use crate::{
    Group,
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots, aside, scratch},
};
use raykd_shared::{Crossings, MISS, TreeHeader, status};

/// Walks the tree, with [`WORDS`] to keep.
#[inline(always)]
fn tally(
    ray: &mut Frame,
    (pairs, corners): (&Buf<UVec4>, &Buf<Vec4>),
    aside: &mut impl Slots<u32>,
    own: &mut impl Slots<u32>,
    steps: &mut Steps,
) {
    Tally::clear(own);
    walk_keeping::<Exact, Tally, false>(ray, pairs, corners, Tally, false, aside, own, steps);
}

/// Decides triangles of a ray that has its whole origin, of which nothing but that they may be crossed is known: what
/// they add. False if a driver left a loop of the test early.
#[inline(always)]
fn decide(ray: &Frame, corners: &Buf<Vec4>, mut listed: Listed) -> (Crossings, bool) {
    let mut found = Crossings { leaving: 0, entering: 0 };
    let mut whole = true;
    while listed.first() != NONE {
        let triangle = corners.three(3 * listed.first());
        let mut best = Best { t: ray.t_max, ..Best::NOTHING };
        whole &= Perturbed::<false>.test(ray, triangle.0.w.to_bits() & !NORMAL, triangle, (), &mut best);
        let crossed = best.triangle != MISS;
        found.leaving += (crossed & (best.det > 0.0)) as u32;
        found.entering += (crossed & (best.det < 0.0)) as u32;
        listed.pass();
    }
    (found, whole)
}

/// Counts by the exact test alone. A walk finds the next [`AT_ONCE`] crossings; mostly the first finds all.
#[inline(always)]
fn walked(ray: &mut Frame, (pairs, corners): (&Buf<UVec4>, &Buf<Vec4>), steps: &mut Steps) -> Crossings {
    let mut after = After::NOTHING;
    let (mut aside, mut own) = (scratch::<u32, ASIDE>(), scratch::<u32, { next::WORDS }>());
    let mut found = Crossings { leaving: 0, entering: 0 };
    let mut running = true;
    while running {
        let count =
            next_hits::<Perturbed<true>>(ray, (pairs, corners), &mut after, &mut aside, &mut own, steps);
        let mut i = 0;
        while i < count {
            let along = Next::hit(&own, i).det > 0.0;
            found.leaving += along as u32;
            found.entering += !along as u32;
            i += 1;
        }
        running = count == AT_ONCE && steps.status == 0;
    }
    found
}

/// The crossings of one ray in its range.
#[inline(always)]
pub(super) fn crossings(ray: &mut Frame, tree: (&Buf<UVec4>, &Buf<Vec4>)) -> Crossings {
    let (own, steps) = (&mut scratch::<u32, WORDS>(), &mut Steps::default());
    tally(ray, tree, &mut [0; ASIDE], own, steps);
    if Tally::open(own) > MOST_OPEN {
        return walked(ray, tree, steps);
    }
    let sure = Tally::sure(own);
    let (more, _) = decide(ray, tree.1, Listed::new(Tally::four(own, 0), Tally::four(own, 4)));
    Crossings { leaving: sure.leaving + more.leaving, entering: sure.entering + more.entering }
}

/// Counts for every ray of a workgroup. Writes how many crossings leave and how many enter; where some are undecided,
/// that is marked, and the references that list their triangles stand in place of a hit and in `more`.
pub fn count(
    group: Group,
    shared: &mut [u32; SHARED],
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    crossings: &mut Buf<u32>,
    more: &mut Buf<UVec4>,
) {
    let left = by_eight!(
        group.usual,
        crate::trace::side_by_side::crossings(
            &group, job, header, pairs, corners, rays, hits, outcome, crossings, more,
        ),
        else Left::ALL
    );
    lanes!(group, |lane| {
        let i = ray_of(group.id * group.width + lane, job);
        if i < job.at(JOB_RAYS) && left.has(lane) {
            let ray = &mut load(i, rays, &header.at(0), outcome);
            let (aside, own) = (&mut aside::<ASIDE, SHARED>(shared, lane), &mut scratch::<u32, WORDS>());
            let steps = &mut Steps::default();
            tally(ray, (pairs, corners), aside, own, steps);
            Tally::put(own, i, hits, outcome, crossings, more);
            if steps.status != 0 || !loops_are_whole(job) {
                outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
            }
        }
    });
}

/// Decides in block `group.id` what [`count`] has left undecided.
pub fn settle(
    group: Group,
    marks: &mut [u32; MARKS],
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &Buf<UVec4>,
    outcome: &mut Buf<u32>,
    crossings: &mut Buf<u32>,
    more: &Buf<UVec4>,
) {
    answer_left!(group, marks, job, outcome, |i| crossings.at(2 * i) & UNDECIDED != 0, |i| {
        let mut ray = Frame::new(rays.at(2 * i), rays.at(2 * i + 1), &header.at(0));
        let (leaving, entering) = (crossings.at(2 * i), crossings.at(2 * i + 1));
        if leaving == TOO_MANY {
            let steps = &mut Steps::default();
            let found = walked(&mut ray, (pairs, corners), steps);
            crossings.put(2 * i, found.leaving);
            crossings.put(2 * i + 1, found.entering);
            if steps.status != 0 {
                outcome.or(OUTCOME_STATUS, steps.status);
            }
        } else {
            let (found, whole) = decide(&ray.whole(), corners, Listed::new(hits.at(i), more.at(i)));
            crossings.put(2 * i, (leaving & !UNDECIDED) + found.leaving);
            crossings.put(2 * i + 1, entering + found.entering);
            if !whole {
                outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
            }
        }
    });
}

/// The first kernel.
pub mod count_crossings {
    use super::*;

    of_query! {
        kernel {
            /// [`count`] over all rays.
            group COUNT = count, threads 64, shared [shared: SHARED], query:
        } { , { 7 crossings: write u32, 8 more: write UVec4 } }
    }
}

/// The second.
pub mod settle_crossings {
    use super::*;

    of_query! {
        kernel {
            /// [`settle`] over all blocks.
            group SETTLE = settle, threads 64, shared [marks: MARKS], query:
        } { , { 7 crossings: write u32, 8 more: read UVec4 } }
    }
}

kernels! {
    /// The kernels of this file.
    count_crossings::COUNT,
    settle_crossings::SETTLE,
    super::locate::LOCATE,
}
