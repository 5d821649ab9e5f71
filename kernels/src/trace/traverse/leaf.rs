//! The visit of a leaf, the same for every traversal: each triangle it lists is tested.

use crate::{
    glam::Vec4,
    mem::{Buf, Slots},
    trace::{
        frame::Frame,
        intersect::{Best, Corners, Intersector, NORMAL},
    },
};
use raykd_shared::{MISS, Node};

/// A triangle as a leaf lists it, after a first look.
#[derive(Clone, Copy, Debug)]
pub struct LeafTriangle<I: Intersector> {
    /// Its number.
    pub id: u32,
    /// The reference that lists it.
    pub at: u32,
    /// What leaves keep of it.
    pub corners: Corners,
    /// What the look saw.
    pub seen: I::Seen,
}

impl<I: Intersector> LeafTriangle<I> {
    /// Looks at the triangle of reference `at`: what it is then, and whether it may be hit.
    #[inline(always)]
    pub(super) fn look(by: I, ray: &Frame, at: u32, corners: &Buf<Vec4>) -> (Self, bool) {
        let corners = corners.three(3 * at);
        let (seen, may_hit) = by.look(ray, corners);
        (Self { id: corners.0.w.to_bits() & !NORMAL, at, corners, seen }, may_hit)
    }

    /// No triangle.
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self { id: MISS, at: 0, corners: (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO), seen: I::Seen::default() }
    }

    /// [`Intersector::test`].
    #[inline(always)]
    pub fn test(self, by: I, ray: &Frame, best: &mut Best) -> bool {
        by.test(ray, self.id, self.corners, self.seen, best)
    }
}

/// Which hits count, by what a traversal makes of them.
pub trait Filter<I: Intersector> {
    /// Tests a triangle; keeps the better of it and `best` if it counts. False as [`Intersector::test`] is.
    fn test(&mut self, by: I, ray: &Frame, triangle: LeafTriangle<I>, best: &mut Best) -> bool;
}

/// Which hits of a query count.
pub trait Choice<I: Intersector>: Copy {
    /// Begins a leaf.
    #[inline(always)]
    fn begin(self, _own: &mut impl Slots<u32>) {}

    /// As [`Filter::test`], with words in which a choice may keep something.
    fn test(
        self,
        by: I,
        ray: &Frame,
        triangle: LeafTriangle<I>,
        best: &mut Best,
        own: &mut impl Slots<u32>,
    ) -> bool;
}

/// All hits.
#[derive(Clone, Copy, Debug)]
pub struct Every;

impl<I: Intersector> Filter<I> for Every {
    #[inline(always)]
    fn test(&mut self, by: I, ray: &Frame, triangle: LeafTriangle<I>, best: &mut Best) -> bool {
        triangle.test(by, ray, best)
    }
}

impl<I: Intersector> Choice<I> for Every {
    #[inline(always)]
    fn test(
        self,
        by: I,
        ray: &Frame,
        triangle: LeafTriangle<I>,
        best: &mut Best,
        _own: &mut impl Slots<u32>,
    ) -> bool {
        triangle.test(by, ray, best)
    }
}

/// All hits but those of one triangle.
#[derive(Clone, Copy, Debug)]
pub struct Except(pub u32);

impl<I: Intersector> Choice<I> for Except {
    #[inline(always)]
    fn test(
        self,
        by: I,
        ray: &Frame,
        triangle: LeafTriangle<I>,
        best: &mut Best,
        _own: &mut impl Slots<u32>,
    ) -> bool {
        triangle.id == self.0 || triangle.test(by, ray, best)
    }
}

/// Tests the triangles of `leaf`, counting the hits that `filter` lets through. Returns whether it got through
/// all: some software drivers leave a loop after so many rounds whatever its condition says.
#[inline(always)]
pub fn visit<I: Intersector, F: Filter<I>>(
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
    if r < end {
        // Asked at its end, a loop costs a GPU fewer registers. The one inside has two ends: of what is loaded in a
        // loop with one, llvmpipe keeps nothing for lanes that have left it.
        loop {
            // On a GPU lanes look for a triangle that may be hit, wait for each other, then test theirs together.
            let mut found = LeafTriangle::<I>::none();
            let is_found = loop {
                if r >= end {
                    break false;
                }
                let (triangle, may_hit) = LeafTriangle::look(by, ray, r, corners);
                r += 1;
                if may_hit {
                    found = triangle;
                    break true;
                }
            };
            if is_found {
                let done = filter.test(by, ray, found, best);
                // A test without loops costs nothing here.
                if I::LOOPS {
                    whole &= done;
                }
            }
            if r >= end {
                break;
            }
        }
    }
    let through = arrived && r == end;
    if I::LOOPS { through && whole } else { through }
}
