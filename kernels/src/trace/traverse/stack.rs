//! Traversal with a full private stack (Hapala & Havran 2011, section 3; entries of two values after
//! Zlatuška & Havran 2010).
//!
//! Traps avoided: a direction component of 0 has a large finite reciprocal, so `0 * inf` cannot arise; a plane
//! counts as `2 * pad` thick, so an origin on it, or a hit in it, is in both children; a hit is never rejected
//! for lying outside the leaf; the search goes on while the next entry is not beyond the best hit, so that
//! equal `t` finds the lowest id.

use super::{
    Steps,
    crossing::crossed,
    leaf::{self, Choice, Filter, LeafTriangle},
};
use crate::{
    ON_GPU,
    glam::{UVec4, Vec4},
    math::{ByAxis, high, low},
    mem::{self, Buf, Slots, scratch},
    trace::{
        frame::Frame,
        intersect::{Best, Intersector},
    },
};
use raykd_shared::{Node, limits::MAX_DEPTH, status};

/// A lane in an empty leaf takes the next entry at once while it has gone fewer rounds of steps than this since
/// lanes tested triangles together: two of three leaves on a ray's way are empty, but a lane that never stops
/// makes the others wait. Found by trying on an H200 and an H100. On a CPU nobody waits.
const IN_A_ROW: u32 = 8;

/// Whether a ray goes to the far child first, and whether it goes to both; by whether its interval is `past`
/// the near child, ends `before` the far one, and which of them is empty: such a leaf is not worth a visit
/// beside another child.
#[inline(always)]
fn way(past: bool, before: bool, near_empty: bool, far_empty: bool) -> (bool, bool) {
    if ON_GPU {
        chosen(past, before, near_empty, far_empty)
    } else {
        taken(past, before, near_empty, far_empty)
    }
}

/// [`way`] without branches: lanes of a GPU go different ways at every step.
#[inline(always)]
fn chosen(past: bool, before: bool, near_empty: bool, far_empty: bool) -> (bool, bool) {
    let only = before | far_empty;
    let over = past | (!only & near_empty);
    (over, !(over | only))
}

/// [`way`] by branches: a CPU guesses them, and goes on before it knows.
#[inline(always)]
fn taken(past: bool, before: bool, near_empty: bool, far_empty: bool) -> (bool, bool) {
    if past {
        (true, false)
    } else if before || far_empty {
        (false, false)
    } else if near_empty {
        (true, false)
    } else {
        (false, true)
    }
}

/// What a step needs to know of a ray.
#[derive(Clone, Copy)]
struct Line {
    origins: ByAxis,
    inverses: ByAxis,
    pad: f32,
}

/// Where a ray is: the node to visit, the ray's interval in it, and how many entries its stack has.
///
/// An entry is a node to visit, where its interval ends and where it begins. There is at most one for each
/// node above, so [`MAX_DEPTH`] are enough, and no push asks: builders make no deeper tree, and files and other
/// hosts' trees are validated before a GPU gets them. A CPU's stack asserts it.
#[derive(Clone, Copy)]
struct Place {
    node: Node,
    enter: f32,
    exit: f32,
    top: u32,
}

impl Place {
    /// Goes from an inner node to the child that comes first, and leaves the other one for later. If `MASKED`,
    /// the node may be a leaf, and stays; its interval is lost, which nothing asks for.
    #[inline(always)]
    fn down<const MASKED: bool, const COUNT: bool>(
        &mut self,
        line: &Line,
        pairs: &Buf<UVec4>,
        stack: &mut impl Slots<UVec4>,
        steps: &mut Steps,
    ) {
        let Self { node, enter, exit, .. } = *self;
        let inner = !MASKED || !node.is_leaf();
        if COUNT {
            steps.inner += inner as u32;
        }
        // One load brings both children. A leaf's brings some pair or none, which does not count.
        let pair = pairs.at(node.below() >> 1);
        let axis = node.axis();
        let inverse = line.inverses.on(axis);
        let (at, wide) = crossed(node.split(), line.origins.on(axis), inverse, line.pad);
        let (below, above) = (Node::from_words(pair.x, pair.y), Node::from_words(pair.z, pair.w));
        // Where the far child begins and the near one ends.
        let (first, last) = (at - wide, at + wide);
        let back = inverse < 0.0;
        let near = if back { above } else { below };
        let far = if back { below } else { above };
        let (over, both) = way(last < enter, first > exit, near.is_empty(), far.is_empty());
        if both & inner {
            let (word0, word1) = far.words();
            stack.put(self.top, UVec4::new(word0, word1, exit.to_bits(), first.to_bits()));
            self.top += 1;
        }
        let next = if over { far } else { near };
        self.node = if inner { next } else { node };
        let (begins, ends) = (high(enter, first), low(exit, last));
        self.enter = if over { begins } else { enter };
        self.exit = if over { exit } else { ends };
    }

    /// Goes down to a leaf. Nothing beyond the best hit, at `t`, matters. On a GPU lanes wait for each other here, then
    /// test triangles together.
    #[inline(always)]
    fn descend<const COUNT: bool>(
        &mut self,
        line: &Line,
        pairs: &Buf<UVec4>,
        stack: &mut impl Slots<UVec4>,
        t: f32,
        steps: &mut Steps,
    ) {
        if self.node.is_leaf() {
            return;
        }
        let mut passed = 0;
        // Asked at its end, a loop costs a GPU fewer registers.
        loop {
            passed += 1;
            self.down::<false, COUNT>(line, pairs, stack, steps);
            // Lanes that have arrived lose less by a step in which they do nothing than all lose by asking after each
            // step whether any has not. Found by trying on an H200 and an H100.
            if ON_GPU {
                self.down::<true, COUNT>(line, pairs, stack, steps);
            }
            // See [`IN_A_ROW`].
            if ON_GPU && self.node.is_empty() & (self.top != 0) & (passed < IN_A_ROW) {
                let entry = stack.at(self.top - 1);
                // What lies beyond the best hit is left to `next`.
                if f32::from_bits(entry.w) <= t {
                    if COUNT {
                        steps.visit(self.node);
                    }
                    self.take(entry, t);
                }
            }
            if self.node.is_leaf() {
                break;
            }
        }
    }

    /// Goes to the next entry that begins no farther than `t`; false if there is none.
    #[inline(always)]
    fn next(&mut self, stack: &impl Slots<UVec4>, t: f32) -> bool {
        loop {
            if self.top == 0 {
                self.top = DONE;
                break false;
            }
            self.take(stack.at(self.top - 1), t);
            if self.enter <= t {
                break true;
            }
        }
    }

    /// Goes to the entry on top of the stack. Nothing beyond the best hit, at `t`, matters.
    #[inline(always)]
    fn take(&mut self, entry: UVec4, t: f32) {
        self.top -= 1;
        self.enter = f32::from_bits(entry.w);
        self.exit = low(f32::from_bits(entry.z), t);
        self.node = Node::from_words(entry.x, entry.y);
    }
}

/// The number of entries of a ray that needs none.
const DONE: u32 = u32::MAX;

/// Words that a walk lays aside, see [`mem::aside`]: what only leaves and the hit's record need.
pub const ASIDE: usize = 7;
const SHEAR_X: u32 = 0;
const SHEAR_Y: u32 = 1;
const T_MIN: u32 = 2;
const STRETCH: u32 = 3;
const U: u32 = 4;
const V: u32 = 5;
const DET: u32 = 6;

/// Lays aside what only leaves need of a ray.
#[inline(always)]
pub(super) fn lay_aside(ray: &Frame, aside: &mut impl Slots<u32>) {
    aside.put(SHEAR_X, ray.shear_x.to_bits());
    aside.put(SHEAR_Y, ray.shear_y.to_bits());
    aside.put(T_MIN, ray.t_min.to_bits());
    aside.put(STRETCH, ray.stretch as u32);
}

/// A ray at a leaf, with what lies aside.
#[inline(always)]
pub(super) fn at_leaf(ray: &Frame, aside: &impl Slots<u32>) -> Frame {
    Frame {
        shear_x: f32::from_bits(aside.at(SHEAR_X)),
        shear_y: f32::from_bits(aside.at(SHEAR_Y)),
        t_min: f32::from_bits(aside.at(T_MIN)),
        t_max: f32::INFINITY,
        ..*ray
    }
}

/// The best hit with its weights, and the ray with its stretch, which lay aside.
#[inline(always)]
pub(super) fn with_aside(best: Best, ray: &mut Frame, aside: &impl Slots<u32>) -> Best {
    ray.stretch = aside.at(STRETCH) as i32;
    Best {
        u: f32::from_bits(aside.at(U)),
        v: f32::from_bits(aside.at(V)),
        det: f32::from_bits(aside.at(DET)),
        ..best
    }
}

/// Lays the weights of hits aside.
pub(super) struct Apart<'a, C, A, O> {
    pub(super) choice: C,
    pub(super) aside: &'a mut A,
    pub(super) own: &'a mut O,
}

impl<I: Intersector, C: Choice<I>, A: Slots<u32>, O: Slots<u32>> Filter<I> for Apart<'_, C, A, O> {
    #[inline(always)]
    fn test(&mut self, by: I, ray: &Frame, triangle: LeafTriangle<I>, best: &mut Best) -> bool {
        let mut hit = Best { t: best.t, triangle: best.triangle, ..Best::NOTHING };
        let whole = self.choice.test(by, ray, triangle, &mut hit, self.own);
        if hit.triangle != best.triangle {
            best.t = hit.t;
            best.triangle = hit.triangle;
            self.aside.put(U, hit.u.to_bits());
            self.aside.put(V, hit.v.to_bits());
            self.aside.put(DET, hit.det.to_bits());
        }
        whole
    }
}

/// Finds the closest hit of a ray by one triangle test, or if `any` will do the best one in the first leaf
/// that has one, among those that `choice` lets through. With `COUNT`, says what it did.
#[inline(always)]
pub fn walk<I: Intersector, C: Choice<I>, const COUNT: bool>(
    ray: &mut Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    choice: C,
    any: bool,
    aside: &mut impl Slots<u32>,
    steps: &mut Steps,
) -> Best {
    walk_keeping::<I, C, COUNT>(ray, pairs, corners, choice, any, aside, &mut scratch::<u32, 1>(), steps)
}

/// [`walk`] with words in which `choice` keeps something.
#[inline(always)]
pub(in crate::trace) fn walk_keeping<I: Intersector, C: Choice<I>, const COUNT: bool>(
    ray: &mut Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    choice: C,
    any: bool,
    aside: &mut impl Slots<u32>,
    own: &mut impl Slots<u32>,
    steps: &mut Steps,
) -> Best {
    if I::WHOLE {
        *ray = ray.whole();
    }
    let by = I::new(ray);
    let line = Line { origins: ByAxis::new(ray.origin), inverses: ByAxis::new(ray.inverse), pad: ray.pad };
    lay_aside(ray, aside);
    let mut filter = Apart { choice, aside, own };
    // A hit as far as the ray goes is taken, and none beyond: the same as if the best one were there.
    let mut best = Best { t: ray.t_max, ..Best::NOTHING };
    let mut running = ray.valid & (ray.enter <= ray.exit);
    let mut stack = mem::stack::<UVec4, { MAX_DEPTH as usize }>();
    let root = pairs.at(0);
    let mut place = Place {
        node: Node::from_words(root.x, root.y),
        enter: ray.enter,
        exit: ray.exit,
        top: if running { 0 } else { DONE },
    };
    while running {
        place.descend::<COUNT>(&line, pairs, &mut stack, best.t, steps);
        if COUNT {
            steps.visit(place.node);
        }
        let at_leaf = at_leaf(ray, filter.aside);
        choice.begin(filter.own);
        let whole = leaf::visit(by, &at_leaf, place.node, corners, &mut filter, &mut best);
        // Where a loop was cut short the number of entries stays what it is.
        let enough = best.is_enough(any);
        if whole & enough {
            place.top = DONE;
        }
        running = whole & !enough;
        if running {
            running = place.next(&stack, best.t);
        }
    }
    if place.top != DONE {
        steps.status |= status::CUT_SHORT;
    }
    with_aside(best, ray, filter.aside)
}

#[cfg(test)]
mod tests {
    use super::{chosen, taken};

    #[test]
    fn both_ways_to_tell_are_one() {
        for bits in 0..16u32 {
            let [a, b, c, d] = [1, 2, 4, 8].map(|bit| bits & bit != 0);
            assert_eq!(chosen(a, b, c, d), taken(a, b, c, d), "{bits:04b}");
        }
    }
}
