//! The next hits of a ray, several by one walk.

use super::leaf::{After, Choice, LeafTriangle};
use crate::{
    mem::Slots,
    trace::{
        frame::Frame,
        intersect::{Best, Intersector},
    },
};

/// How many hits [`Next`] keeps.
pub const AT_ONCE: u32 = 8;
/// Words that [`Next`] keeps.
pub const WORDS: usize = 1 + 2 * AT_ONCE as usize;
/// How many hits there are, then of each its `t` and triangle.
const COUNT: u32 = 0;
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
    pub fn clear(own: &mut impl Slots<u32>) {
        own.put(COUNT, 0);
    }

    /// How many hits there are.
    #[inline(always)]
    pub fn count(own: &impl Slots<u32>) -> u32 {
        own.at(COUNT)
    }

    /// Hit `i`: `t`, triangle, and whether `det` is positive.
    #[inline(always)]
    pub fn hit(own: &impl Slots<u32>, i: u32) -> (f32, u32, bool) {
        let word = own.at(HITS + 2 * i + 1);
        (f32::from_bits(own.at(HITS + 2 * i)), word & !POSITIVE, word & POSITIVE != 0)
    }

    /// Puts a hit where it belongs, if it is not there.
    #[inline(always)]
    fn insert(own: &mut impl Slots<u32>, hit: &Best) {
        let count = Self::count(own);
        let mut place = 0;
        let mut before = true;
        let mut there = false;
        while place < count && before {
            let (t, triangle, _) = Self::hit(own, place);
            before = t < hit.t || (t == hit.t && triangle < hit.triangle);
            there |= triangle == hit.triangle;
            place += before as u32;
        }
        if !there {
            let full = count == AT_ONCE;
            let mut i = if full { AT_ONCE - 1 } else { count };
            while i > place {
                let (t, word) = (own.at(HITS + 2 * i - 2), own.at(HITS + 2 * i - 1));
                own.put(HITS + 2 * i, t);
                own.put(HITS + 2 * i + 1, word);
                i -= 1;
            }
            own.put(HITS + 2 * place, hit.t.to_bits());
            own.put(HITS + 2 * place + 1, hit.triangle | if hit.det > 0.0 { POSITIVE } else { 0 });
            own.put(COUNT, if full { count } else { count + 1 });
        }
    }
}

impl<I: Intersector> Choice<I> for Next {
    #[inline(always)]
    fn test(
        self,
        by: I,
        ray: &Frame,
        triangle: LeafTriangle<I>,
        best: &mut Best,
        own: &mut impl Slots<u32>,
    ) -> bool {
        let mut hit = Best { t: best.t, triangle: best.triangle, ..Best::NOTHING };
        let whole = triangle.test(by, ray, &mut hit);
        if hit.triangle != best.triangle && self.0.precedes(&hit) {
            Self::insert(own, &hit);
            // Of a full list the last is what others must be better than.
            if Self::count(own) == AT_ONCE {
                let (t, triangle, _) = Self::hit(own, AT_ONCE - 1);
                *best = Best { t, triangle, ..hit };
            }
        }
        whole
    }
}
