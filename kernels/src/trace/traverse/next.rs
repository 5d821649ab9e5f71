//! The next hits of a ray, several by one walk.

use super::{
    leaf::{After, Choice},
    stack::ASIDE,
};
use crate::{
    glam::Vec4,
    mem::Slots,
    trace::{
        frame::Frame,
        intersect::{Best, Intersector},
    },
};

/// How many hits [`Next`] keeps.
pub const AT_ONCE: u32 = 8;
/// Words that a walk and [`Next`] lay aside.
pub const WORDS: usize = ASIDE + 1 + 2 * AT_ONCE as usize;
/// Behind those of the walk: how many hits there are, then of each its `t` and triangle.
const COUNT: u32 = ASIDE as u32;
const HITS: u32 = COUNT + 1;
/// Stands beside a triangle's number if `det` is positive.
const POSITIVE: u32 = 0x8000_0000;

/// Keeps the first [`AT_ONCE`] hits that come after another, in order. A triangle may be listed in several leaves, but
/// of the hits kept each is there once.
#[derive(Clone, Copy, Debug)]
pub struct Next(pub After);

impl Next {
    /// Forgets all hits.
    #[inline(always)]
    pub fn clear(aside: &mut impl Slots<u32>) {
        aside.put(COUNT, 0);
    }

    /// How many hits there are.
    #[inline(always)]
    pub fn count(aside: &impl Slots<u32>) -> u32 {
        aside.at(COUNT)
    }

    /// Hit `i`: `t`, triangle, and whether `det` is positive.
    #[inline(always)]
    pub fn hit(aside: &impl Slots<u32>, i: u32) -> (f32, u32, bool) {
        let word = aside.at(HITS + 2 * i + 1);
        (f32::from_bits(aside.at(HITS + 2 * i)), word & !POSITIVE, word & POSITIVE != 0)
    }

    /// Puts a hit where it belongs, if it is not there.
    #[inline(always)]
    fn insert(aside: &mut impl Slots<u32>, hit: &Best) {
        let count = Self::count(aside);
        let mut place = 0;
        let mut before = true;
        let mut there = false;
        while place < count && before {
            let (t, triangle, _) = Self::hit(aside, place);
            before = t < hit.t || (t == hit.t && triangle < hit.triangle);
            there |= triangle == hit.triangle;
            place += before as u32;
        }
        if !there {
            let full = count == AT_ONCE;
            let mut i = if full { AT_ONCE - 1 } else { count };
            while i > place {
                let (t, word) = (aside.at(HITS + 2 * i - 2), aside.at(HITS + 2 * i - 1));
                aside.put(HITS + 2 * i, t);
                aside.put(HITS + 2 * i + 1, word);
                i -= 1;
            }
            aside.put(HITS + 2 * place, hit.t.to_bits());
            aside.put(HITS + 2 * place + 1, hit.triangle | if hit.det > 0.0 { POSITIVE } else { 0 });
            aside.put(COUNT, if full { count } else { count + 1 });
        }
    }
}

impl Choice for Next {
    #[inline(always)]
    fn test<I: Intersector>(
        self,
        by: I,
        ray: &Frame,
        id: u32,
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        aside: &mut impl Slots<u32>,
    ) -> bool {
        let mut hit = Best { t: best.t, triangle: best.triangle, ..Best::NOTHING };
        let whole = by.test(ray, id, a, b, c, &mut hit);
        if hit.triangle != best.triangle && self.0.precedes(&hit) {
            Self::insert(aside, &hit);
            // Of a full list the last is what others must be better than.
            if Self::count(aside) == AT_ONCE {
                let (t, triangle, _) = Self::hit(aside, AT_ONCE - 1);
                *best = Best { t, triangle, ..hit };
            }
        }
        whole
    }
}
