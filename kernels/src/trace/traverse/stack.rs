//! Traversal with a full private stack (Hapala & Havran 2011, section 3; entries of two values after
//! Zlatuška & Havran 2010).
//!
//! Traps avoided: a direction component of 0 has a large finite reciprocal, so `0 * inf` cannot arise; a plane
//! counts as `2 * pad` thick, so an origin on it, or a hit in it, is in both children; a hit is never rejected
//! for lying outside the leaf; the search goes on while the next entry is not beyond the best hit, so that
//! equal `t` finds the lowest id.

use super::{
    Steps,
    leaf::{self, Filter},
};
use crate::{
    ON_GPU,
    glam::{UVec4, Vec4},
    math::{ByAxis, abs, high, low},
    mem::{self, Buf, Slots},
    trace::{
        frame::Frame,
        intersect::{Best, Intersector},
    },
};
use raykd_shared::{MISS, Node, limits::MAX_DEPTH, status};

/// A lane in an empty leaf takes the next entry at once while it has passed fewer nodes than this since lanes
/// tested triangles together: two of three leaves on a ray's way are empty, but a lane that never stops makes
/// the others wait. Found by trying on an H200. On a CPU nobody waits.
const IN_A_ROW: u32 = 12;

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

/// Finds the closest hit of a ray by one triangle test, or if `any` will do the best one in the first leaf
/// that has one, among those that `filter` lets through. With `COUNT`, says what it did.
#[inline(always)]
pub fn walk<I: Intersector, F: Filter, const COUNT: bool>(
    ray: &Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    filter: F,
    any: bool,
    steps: &mut Steps,
) -> Best {
    let mut best = Best::NOTHING;
    let by = I::new(ray);
    // Entries: the node to visit, where its interval ends and where it begins.
    let mut stack = mem::stack::<UVec4, { MAX_DEPTH as usize }>();
    let (origins, inverses) = (ByAxis::new(ray.origin), ByAxis::new(ray.inverse));
    let mut top = 0;
    let root = pairs.at(0);
    let mut node = Node::from_words(root.x, root.y);
    let (mut enter, mut exit) = (ray.enter, ray.exit);
    let mut running = ray.valid && enter <= exit;
    // 1 until the last subtree is done.
    let mut open = running as u32;
    while running {
        // Down to a leaf. On a GPU lanes wait for each other here, then test triangles together.
        let mut passed = 0;
        while !node.is_leaf() {
            passed += 1;
            if COUNT {
                steps.inner += 1;
            }
            // One load brings both children.
            let pair = pairs.at(node.below() >> 1);
            let axis = node.axis();
            let inverse = inverses.on(axis);
            let at = (node.split() - origins.on(axis)) * inverse;
            let wide = ray.pad * abs(inverse);
            let (below, above) = (Node::from_words(pair.x, pair.y), Node::from_words(pair.z, pair.w));
            // Where the far child begins and the near one ends.
            let (first, last) = (at - wide, at + wide);
            let back = inverse < 0.0;
            let near = if back { above } else { below };
            let far = if back { below } else { above };
            let (over, both) = way(last < enter, first > exit, near.is_empty(), far.is_empty());
            if both {
                if top < MAX_DEPTH {
                    let (word0, word1) = far.words();
                    stack.put(top, UVec4::new(word0, word1, exit.to_bits(), first.to_bits()));
                    top += 1;
                } else {
                    steps.status |= status::STACK;
                }
            }
            node = if over { far } else { near };
            let (begins, ends) = (high(enter, first), low(exit, last));
            enter = if over { begins } else { enter };
            exit = if over { exit } else { ends };
            // See [`IN_A_ROW`].
            if ON_GPU && node.is_empty() & (top != 0) & (passed < IN_A_ROW) {
                let entry = stack.at(top - 1);
                let begin = f32::from_bits(entry.w);
                // What lies beyond the best hit is left to the search below.
                if begin <= best.t {
                    if COUNT {
                        steps.visit(node);
                    }
                    top -= 1;
                    enter = begin;
                    exit = low(f32::from_bits(entry.z), best.t);
                    node = Node::from_words(entry.x, entry.y);
                }
            }
        }
        if COUNT {
            steps.visit(node);
        }
        let whole = leaf::visit(by, ray, node, corners, filter, &mut best);
        running = !(any && best.triangle != MISS);
        let mut searching = running;
        while searching {
            if top == 0 {
                running = false;
                searching = false;
                open = 0;
            } else {
                top -= 1;
                let entry = stack.at(top);
                enter = f32::from_bits(entry.w);
                // Nothing beyond the best hit matters.
                exit = low(f32::from_bits(entry.z), best.t);
                node = Node::from_words(entry.x, entry.y);
                searching = enter > best.t;
            }
        }
        if !whole {
            steps.status |= status::CUT_SHORT;
        }
    }
    if top + open != 0 && !(any && best.triangle != MISS) {
        steps.status |= status::CUT_SHORT;
    }
    best
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
