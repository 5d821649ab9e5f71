//! What is kept of a ray whose crossings are counted: how many floats tell of, and which triangles they do not.

use super::{
    frame::Frame,
    intersect::{Best, exact::Exact},
    job::OUTCOME_LEFT,
    listed::four,
    traverse::leaf::{Choice, LeafTriangle},
};
use crate::{
    glam::UVec4,
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::Crossings;

/// How many triangles are kept of a ray, so that each counts once.
const MOST: u32 = 28;
/// How many of them may be undecided.
pub(super) const MOST_OPEN: u32 = 8;
/// How many there are.
const KEPT: u32 = 0;
/// By how many the ray surely leaves.
const LEAVING: u32 = 1;
/// By how many it surely enters.
const ENTERING: u32 = 2;
/// How many are undecided.
const OPEN: u32 = 3;
/// The references that list those.
const REFERENCES: u32 = 4;
/// Numbers of all.
const IDS: u32 = REFERENCES + MOST_OPEN;
/// Words for all that.
pub(super) const WORDS: usize = (IDS + MOST) as usize;

/// Stands beside how many crossings leave while some are undecided.
pub const UNDECIDED: u32 = 0x8000_0000;
/// Stands for how many leave if the ray must walk once more.
pub(super) const TOO_MANY: u32 = u32::MAX;

/// Counts the triangles that floats tell of, and lists the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tally;

impl Tally {
    /// Nothing is kept yet.
    #[inline(always)]
    pub(super) fn clear(own: &mut impl Slots<u32>) {
        own.put(KEPT, 0);
        own.put(LEAVING, 0);
        own.put(ENTERING, 0);
        own.put(OPEN, 0);
    }

    /// How many triangles are undecided, more than [`MOST_OPEN`] if there was no room.
    #[inline(always)]
    pub(super) fn open(own: &impl Slots<u32>) -> u32 {
        own.at(OPEN)
    }

    /// How many the ray surely leaves and enters by.
    #[inline(always)]
    pub(super) fn sure(own: &impl Slots<u32>) -> Crossings {
        Crossings { leaving: own.at(LEAVING), entering: own.at(ENTERING) }
    }

    /// Whether a triangle is kept.
    #[inline(always)]
    pub(super) fn has(own: &impl Slots<u32>, id: u32) -> bool {
        let count = own.at(KEPT);
        let (mut i, mut there) = (0, false);
        while i < count {
            there |= own.at(IDS + i) == id;
            i += 1;
        }
        there
    }

    /// Keeps a triangle, given by its number and the reference that lists it, that floats have `told` of, or have not.
    /// False if there is no room.
    #[inline(always)]
    pub(super) fn keep(own: &mut impl Slots<u32>, (id, at): (u32, u32), told: bool, leaving: bool) -> bool {
        let (count, open) = (own.at(KEPT), own.at(OPEN));
        let fits = (count < MOST) & (told | (open < MOST_OPEN));
        if fits {
            own.put(KEPT, count + 1);
            own.put(IDS + count, id);
            if told {
                let way = if leaving { LEAVING } else { ENTERING };
                own.put(way, own.at(way) + 1);
            } else {
                own.put(OPEN, open + 1);
                own.put(REFERENCES + open, at);
            }
        } else {
            own.put(OPEN, MOST_OPEN + 1);
        }
        fits
    }

    /// Writes what is kept of ray `i`.
    #[inline(always)]
    pub(super) fn put(
        own: &impl Slots<u32>,
        i: u32,
        hits: &mut Buf<UVec4>,
        outcome: &mut Buf<u32>,
        crossings: &mut Buf<u32>,
        more: &mut Buf<UVec4>,
    ) {
        let (leaving, open) = (own.at(LEAVING), own.at(OPEN));
        let many = open > MOST_OPEN;
        let marked = if open > 0 { leaving | UNDECIDED } else { leaving };
        crossings.put(2 * i, if many { TOO_MANY } else { marked });
        crossings.put(2 * i + 1, own.at(ENTERING));
        if open > 0 {
            outcome.or(OUTCOME_LEFT, 1);
        }
        if open > 0 && !many {
            hits.put(i, Self::four(own, 0));
            more.put(i, Self::four(own, 4));
        }
    }

    /// Four references that list undecided triangles, from number `first` on.
    #[inline(always)]
    pub(super) fn four(own: &impl Slots<u32>, first: u32) -> UVec4 {
        four(own, (REFERENCES, 1), own.at(OPEN), first)
    }
}

impl Choice<Exact> for Tally {
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
        let passed = seen.later < ray.t_min || seen.near > best.t;
        if !passed && !Self::has(own, id) {
            let told = seen.sure & (seen.near > ray.t_min) & (seen.later < best.t);
            if !Self::keep(own, (id, at), told, seen.leaving) {
                // Nothing lies before this, so the walk ends.
                best.t = f32::NEG_INFINITY;
                best.triangle = id;
            }
        }
        true
    }
}
