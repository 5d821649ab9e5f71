//! Hits of the exact test on a GPU, first kernel: it walks the tree and tells by floats which triangles may be the hit,
//! one mostly, a few where a ray passes an edge or a vertex or starts on a surface. The second,
//! [`settle`](super::settle), tests those alone; the third, [`rest`](super::rest), walks where there are too many. So
//! lanes do not wait for each other's exact tests, and the first walk has the registers that it needs. The answer is
//! that of the exact test in a walk of its own, as on a CPU, since that rounds nothing else.

use super::{
    Steps,
    leaf::{Choice, LeafTriangle},
    stack::{ASIDE, walk_keeping},
};
use crate::{
    Group,
    glam::{UVec4, Vec4},
    mem::{Atomics, Buf, Slots, aside, scratch},
    trace::{
        frame::Frame,
        intersect::{Best, exact::Exact},
        job::{JOB_RAYS, OUTCOME_LEFT, OUTCOME_STATUS, load, loops_are_whole, ray_of, record},
        listed::{NONE, four},
        queries::SHARED,
    },
};
use raykd_shared::{TreeHeader, status};

/// How many triangles are kept of a ray.
pub(in crate::trace) const MOST: u32 = 8;
/// How many there are, [`MOST`] and one if there were more.
const COUNT: u32 = 0;
/// Of each its number, the reference that lists it, and the lowest number that `t` may be.
const FIRST: u32 = 1;
/// Words of a triangle.
const EACH: u32 = 3;
/// Words for all that.
pub(in crate::trace) const WORDS: usize = (FIRST + MOST * EACH) as usize;
/// Of any hits, how many there were when a leaf began.
const BEFORE: u32 = WORDS as u32;
/// Marks the references of every other leaf.
pub(super) const OTHER: u32 = 0x8000_0000;

/// Stands beside the fourth of a ray's references, in place of a hit's `v`, which has neither this bit nor [`OTHER`].
pub(super) const LISTED: u32 = 0x4000_0000;
/// Stands beside the third if four more are apart.
pub(super) const LONG: u32 = 0x4000_0000;
/// Stands for the fourth reference if there are too many.
pub(super) const TOO_MANY: u32 = u32::MAX;

/// Keeps the triangles of which one may be the closest hit. `t` of the best is the highest that the closest hit's may
/// be.
///
/// Of any hits that is the closest in the first leaf that has one. Leaves of which nothing is sure are passed, and
/// their triangles kept before those of others.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct Narrow<const ANY: bool = false>;

impl Narrow {
    /// Nothing is kept yet.
    #[inline(always)]
    pub(in crate::trace) fn clear(own: &mut impl Slots<u32>) {
        own.put(COUNT, 0);
    }

    /// How many triangles are kept, more than [`MOST`] if there was no room.
    #[inline(always)]
    pub(in crate::trace) fn count(own: &impl Slots<u32>) -> u32 {
        own.at(COUNT)
    }

    /// The reference that lists the one with this number.
    #[inline(always)]
    pub(in crate::trace) fn reference(own: &impl Slots<u32>, i: u32) -> u32 {
        own.at(FIRST + EACH * i + 1)
    }

    #[inline(always)]
    fn put(own: &mut impl Slots<u32>, i: u32, (id, at, near): (u32, u32, f32)) {
        own.put(FIRST + EACH * i, id);
        own.put(FIRST + EACH * i + 1, at);
        own.put(FIRST + EACH * i + 2, near.to_bits());
    }

    /// Four references that list triangles, from number `first` on.
    #[inline(always)]
    fn four(own: &impl Slots<u32>, first: u32) -> UVec4 {
        four(own, (FIRST + 1, EACH), own.at(COUNT), first)
    }

    /// Forgets the triangles that are surely behind `t`, but the first ones, and adds one if it is not there.
    #[inline(always)]
    pub(in crate::trace) fn add(own: &mut impl Slots<u32>, first: u32, triangle: (u32, u32, f32), t: f32) {
        let count = own.at(COUNT);
        let mut kept = 0;
        let mut there = false;
        let mut i = 0;
        while i < count {
            let id = own.at(FIRST + EACH * i);
            let near = f32::from_bits(own.at(FIRST + EACH * i + 2));
            if (i < first) | (near <= t) {
                let at = own.at(FIRST + EACH * i + 1);
                Self::put(own, kept, (id, at, near));
                there |= id == triangle.0;
                kept += 1;
            }
            i += 1;
        }
        if !there && kept < MOST {
            Self::put(own, kept, triangle);
        }
        own.put(COUNT, if there { kept } else { kept + 1 });
    }
}

impl<const ANY: bool> Choice<Exact> for Narrow<ANY> {
    #[inline(always)]
    fn begin(self, own: &mut impl Slots<u32>) {
        if ANY {
            own.put(BEFORE, own.at(COUNT));
        }
    }

    #[inline(always)]
    fn test(
        self,
        by: Exact,
        ray: &Frame,
        triangle: LeafTriangle<Exact>,
        best: &mut Best,
        own: &mut impl Slots<u32>,
    ) -> bool {
        let LeafTriangle { id, at, corners, seen: sheared } = triangle;
        let seen = by.glance(ray, corners, sheared);
        let open = own.at(COUNT) <= MOST;
        let passed = seen.later < ray.t_min || seen.near > best.t || id == best.triangle;
        if open && !passed {
            if seen.sure & (seen.near >= ray.t_min) & (seen.later < best.t) {
                best.t = seen.later;
                best.triangle = id;
            }
            let (mut before, mut mark) = (0, 0);
            if ANY {
                before = own.at(BEFORE);
                if before > 0 {
                    mark = (own.at(FIRST + EACH * (before - 1) + 1) & OTHER) ^ OTHER;
                }
            }
            Narrow::add(own, before, (id, at | mark, seen.near), best.t);
            if ANY && own.at(COUNT) > MOST {
                // Ends the walk.
                best.triangle = id;
            }
        }
        true
    }
}

/// Writes of every ray of a workgroup which references list the triangles that may be the closest hit: four in place of
/// the hit, four more apart; a miss where there are none.
pub fn narrow<const ANY: bool>(
    group: Group,
    shared: &mut [u32; SHARED],
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    more: &mut Buf<UVec4>,
) {
    lanes!(group, |lane| {
        let i = ray_of(group.id * group.width + lane, job);
        if i < job.at(JOB_RAYS) {
            let ray = &mut load(i, rays, &header.at(0), outcome);
            let (aside, own) =
                (&mut aside::<ASIDE, SHARED>(shared, lane), &mut scratch::<u32, { WORDS + 1 }>());
            let steps = &mut Steps::default();
            Narrow::clear(own);
            walk_keeping::<Exact, _, false>(ray, pairs, corners, Narrow::<ANY>, ANY, aside, own, steps);
            let count = Narrow::count(own);
            if count == 0 {
                hits.put(i, record(ray, &Best::NOTHING));
            } else if count <= MOST {
                let first = Narrow::four(own, 0);
                let long = if count > 4 { LONG } else { 0 };
                hits.put(i, UVec4::new(first.x, first.y, first.z | long, first.w | LISTED));
                if count > 4 {
                    more.put(i, Narrow::four(own, 4));
                }
            } else {
                hits.put(i, UVec4::new(NONE, NONE, NONE, TOO_MANY));
                outcome.or(OUTCOME_LEFT, 1);
            }
            if steps.status != 0 || !loops_are_whole(job) {
                outcome.or(OUTCOME_STATUS, status::CUT_SHORT);
            }
        }
    });
}

of_query! {
    kernel {
        /// [`narrow`] over all rays, for closest hits.
        group NARROW = narrow::<false>, threads 64, shared [shared: SHARED], query:
    } { , { 7 more: write UVec4 } }
}

/// For any hits.
pub mod any {
    use super::*;

    of_query! {
        kernel {
            /// [`narrow`] over all rays.
            group NARROW_ANY = narrow::<true>, threads 64, shared [shared: SHARED], query:
        } { , { 7 more: write UVec4 } }
    }
}
