//! The visit of a leaf, the same for every traversal: each triangle it lists is tested.

use crate::{
    ON_GPU,
    glam::Vec4,
    math::high,
    mem::{Buf, Slots},
    trace::{
        frame::Frame,
        intersect::{Best, Intersector, NORMAL},
    },
};
use raykd_shared::Node;

/// Which hits count, by what a traversal makes of them.
pub trait Filter {
    /// Tests triangle `id` by a test; keeps the better of it and `best` if it counts. False as
    /// [`Intersector::test`] is.
    fn test<I: Intersector>(
        &mut self,
        by: I,
        ray: &Frame,
        id: u32,
        corners: (Vec4, Vec4, Vec4),
        best: &mut Best,
    ) -> bool;
}

/// Which hits of a query count. `kept` is memory of the query's own.
pub trait Choice: Copy {
    /// As [`Filter::test`].
    fn test<I: Intersector>(
        self,
        by: I,
        ray: &Frame,
        id: u32,
        corners: (Vec4, Vec4, Vec4),
        best: &mut Best,
        kept: &mut impl Slots<u32>,
    ) -> bool;
}

/// All hits.
#[derive(Clone, Copy, Debug)]
pub struct Every;

impl Filter for Every {
    #[inline(always)]
    fn test<I: Intersector>(
        &mut self,
        by: I,
        ray: &Frame,
        id: u32,
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
    ) -> bool {
        by.test(ray, id, a, b, c, best)
    }
}

impl Choice for Every {
    #[inline(always)]
    fn test<I: Intersector>(
        self,
        by: I,
        ray: &Frame,
        id: u32,
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        _kept: &mut impl Slots<u32>,
    ) -> bool {
        by.test(ray, id, a, b, c, best)
    }
}

/// All hits but those of one triangle.
#[derive(Clone, Copy, Debug)]
pub struct Except(pub u32);

impl Choice for Except {
    #[inline(always)]
    fn test<I: Intersector>(
        self,
        by: I,
        ray: &Frame,
        id: u32,
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        _kept: &mut impl Slots<u32>,
    ) -> bool {
        id == self.0 || by.test(ray, id, a, b, c, best)
    }
}

/// A hit that others come after: by larger `t`, or at the same `t` by a larger triangle number.
#[derive(Clone, Copy, Debug)]
pub struct After {
    /// Its scaled ray parameter.
    pub t: f32,
    /// Its triangle.
    pub triangle: u32,
}

impl After {
    /// Before every hit.
    pub const NOTHING: Self = Self { t: f32::NEG_INFINITY, triangle: 0 };

    /// Goes on behind a hit: nothing before it counts from now on, or is looked for.
    #[inline(always)]
    pub fn pass(&mut self, ray: &mut Frame, (t, triangle): (f32, u32)) {
        *self = Self { t, triangle };
        ray.enter = high(ray.enter, t);
    }

    #[inline(always)]
    fn precedes(self, hit: &Best) -> bool {
        hit.t > self.t || (hit.t == self.t && hit.triangle > self.triangle)
    }
}

impl Choice for After {
    #[inline(always)]
    fn test<I: Intersector>(
        self,
        by: I,
        ray: &Frame,
        id: u32,
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        _kept: &mut impl Slots<u32>,
    ) -> bool {
        let mut hit = *best;
        let whole = by.test(ray, id, a, b, c, &mut hit);
        if self.precedes(&hit) {
            *best = hit;
        }
        whole
    }
}

/// How many hits [`Next`] keeps.
pub const AT_ONCE: u32 = 8;
/// Words that it keeps them in: how many there are, then of each its `t` and triangle.
pub const NEXT_WORDS: usize = 1 + 2 * AT_ONCE as usize;
/// Stands beside a triangle's number if `det` is positive.
const POSITIVE: u32 = 0x8000_0000;

/// Keeps the first [`AT_ONCE`] hits that come after another, in order. A triangle may be listed in several leaves, but of the
/// hits kept each is there once.
#[derive(Clone, Copy, Debug)]
pub struct Next(pub After);

impl Next {
    /// Forgets all hits.
    #[inline(always)]
    pub fn clear(kept: &mut impl Slots<u32>) {
        kept.put(0, 0);
    }

    /// How many hits there are.
    #[inline(always)]
    pub fn count(kept: &impl Slots<u32>) -> u32 {
        kept.at(0)
    }

    /// Hit `i`: `t`, triangle, and whether `det` is positive.
    #[inline(always)]
    pub fn hit(kept: &impl Slots<u32>, i: u32) -> (f32, u32, bool) {
        let word = kept.at(2 * i + 2);
        (f32::from_bits(kept.at(2 * i + 1)), word & !POSITIVE, word & POSITIVE != 0)
    }

    /// Puts a hit where it belongs, if it is not there.
    #[inline(always)]
    fn insert(kept: &mut impl Slots<u32>, hit: &Best) {
        let count = Self::count(kept);
        let mut place = 0;
        let mut before = true;
        let mut there = false;
        while place < count && before {
            let (t, triangle, _) = Self::hit(kept, place);
            before = t < hit.t || (t == hit.t && triangle < hit.triangle);
            there |= triangle == hit.triangle;
            place += before as u32;
        }
        if !there {
            let full = count == AT_ONCE;
            let mut i = if full { AT_ONCE - 1 } else { count };
            while i > place {
                let (t, word) = (kept.at(2 * i - 1), kept.at(2 * i));
                kept.put(2 * i + 1, t);
                kept.put(2 * i + 2, word);
                i -= 1;
            }
            kept.put(2 * place + 1, hit.t.to_bits());
            kept.put(2 * place + 2, hit.triangle | if hit.det > 0.0 { POSITIVE } else { 0 });
            kept.put(0, if full { count } else { count + 1 });
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
        kept: &mut impl Slots<u32>,
    ) -> bool {
        let mut hit = Best { t: best.t, triangle: best.triangle, ..Best::NOTHING };
        let whole = by.test(ray, id, a, b, c, &mut hit);
        if hit.triangle != best.triangle && self.0.precedes(&hit) {
            Self::insert(kept, &hit);
            // Of a full list the last is what others must be better than.
            if Self::count(kept) == AT_ONCE {
                let (t, triangle, _) = Self::hit(kept, AT_ONCE - 1);
                *best = Best { t, triangle, ..hit };
            }
        }
        whole
    }
}

/// How far ahead triangles are loaded: on a GPU two at a time, for one wait for memory instead of two.
const AHEAD: u32 = ON_GPU as u32;

/// Tests the triangles of `leaf`, counting the hits that `filter` lets through. Returns whether it got through
/// all: some software drivers leave a loop after so many rounds whatever its condition says.
#[inline(always)]
pub fn visit<I: Intersector, F: Filter>(
    by: I,
    ray: &Frame,
    leaf: Node,
    corners: &Buf<Vec4>,
    filter: &mut F,
    best: &mut Best,
) -> bool {
    // A descent that was cut short did not arrive at a leaf. Compilers take the opposite of a loop's
    // condition for granted after the loop, so what is checked here must not look like it.
    let arrived = (leaf.words().1 | !Node::LEAF) == u32::MAX;
    let mut r = leaf.first();
    let end = if arrived { r + leaf.count() } else { r };
    let mut whole = true;
    while r < end {
        // On a GPU lanes look for a triangle that may be hit, wait for each other, then test theirs together.
        let mut found = false;
        while r < end && !found {
            let next = r + AHEAD;
            let (a, b, c) = corners.three(3 * r);
            let (d, e, f) = corners.three(3 * next);
            let one = by.may_hit(ray, a, b, c);
            // What lies past the leaf's end, or the buffer's, does not count.
            let two = AHEAD == 1 && (by.may_hit(ray, d, e, f) & (next < end));
            found = one | two;
            r = if one | (next == end) { r + 1 } else { next + 1 };
        }
        if found {
            let (a, b, c) = corners.three(3 * (r - 1));
            let done = filter.test(by, ray, a.w.to_bits() & !NORMAL, (a, b, c), best);
            // A test without loops costs nothing here.
            if I::LOOPS {
                whole &= done;
            }
        }
    }
    let through = arrived && r == end;
    if I::LOOPS { through && whole } else { through }
}
