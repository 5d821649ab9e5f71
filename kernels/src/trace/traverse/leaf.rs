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
    /// Tests a triangle, given by its number and the reference that lists it; keeps the better of it and `best` if it
    /// counts. False as [`Intersector::test`] is.
    fn test<I: Intersector>(
        &mut self,
        by: I,
        ray: &Frame,
        triangle: (u32, u32),
        corners: (Vec4, Vec4, Vec4),
        best: &mut Best,
    ) -> bool;
}

/// Which hits of a query count.
pub trait Choice: Copy {
    /// Begins a leaf.
    #[inline(always)]
    fn begin(self, _own: &mut impl Slots<u32>) {}

    /// As [`Filter::test`], with words in which a choice may keep something.
    fn test<I: Intersector>(
        self,
        by: I,
        ray: &Frame,
        triangle: (u32, u32),
        corners: (Vec4, Vec4, Vec4),
        best: &mut Best,
        own: &mut impl Slots<u32>,
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
        (id, _): (u32, u32),
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
        (id, _): (u32, u32),
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        _own: &mut impl Slots<u32>,
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
        (id, _): (u32, u32),
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        _own: &mut impl Slots<u32>,
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

    /// Whether a hit comes after this one.
    #[inline(always)]
    pub fn precedes(self, hit: &Best) -> bool {
        hit.t > self.t || (hit.t == self.t && hit.triangle > self.triangle)
    }
}

impl Choice for After {
    #[inline(always)]
    fn test<I: Intersector>(
        self,
        by: I,
        ray: &Frame,
        (id, _): (u32, u32),
        (a, b, c): (Vec4, Vec4, Vec4),
        best: &mut Best,
        _own: &mut impl Slots<u32>,
    ) -> bool {
        let mut hit = *best;
        let whole = by.test(ray, id, a, b, c, &mut hit);
        if self.precedes(&hit) {
            *best = hit;
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
            let done = filter.test(by, ray, (a.w.to_bits() & !NORMAL, r - 1), (a, b, c), best);
            // A test without loops costs nothing here.
            if I::LOOPS {
                whole &= done;
            }
        }
    }
    let through = arrived && r == end;
    if I::LOOPS { through && whole } else { through }
}
