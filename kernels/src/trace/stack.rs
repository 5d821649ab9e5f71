//! Traversal with a full private stack (Hapala & Havran 2011, section 3; entries of two values after
//! Zlatuška & Havran 2010).
//!
//! Traps avoided: a direction component of 0 has a large finite reciprocal, so `0 * inf` cannot arise; a plane
//! counts as `2 * pad` thick, so an origin on it, or a hit in it, is in both children; a hit is never rejected
//! for lying outside the leaf; the search goes on while the next entry is not beyond the best hit, so that
//! equal `t` finds the lowest id.

use super::{
    NOTHING, Steps,
    frame::{ByAxis, Frame},
    leaf::{self, After},
    triangle::Best,
};
use crate::{
    glam::{UVec4, Vec4},
    math::{abs, high, low},
    mem::{self, Buf, Slots},
};
use raykd_shared::{MISS, Node, limits::MAX_DEPTH, status};

/// Finds the closest hit of a ray, or with `ANY` the best one in the first leaf that has one; with `AFTER` only
/// among the hits that come after that one. With `COUNT`, says what it did.
#[inline(always)]
pub fn walk<const ANY: bool, const AFTER: bool, const COUNT: bool>(
    ray: &Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    after: After,
    steps: &mut Steps,
) -> Best {
    let mut best = NOTHING;
    // Entries: the node to visit, where its interval ends and where it begins.
    let mut stack = mem::stack::<UVec4, { MAX_DEPTH as usize }>();
    let (origins, inverses) = (ByAxis::new(ray.origin), ByAxis::new(ray.inverse));
    let mut top = 0;
    let root = pairs.at(0);
    let mut node = Node::from_words(root.x, root.y);
    let mut enter = ray.enter;
    let mut exit = ray.exit;
    let mut running = ray.valid && enter <= exit;
    // 1 until the last subtree is done.
    let mut open = running as u32;
    while running {
        // Down to a leaf. On a GPU lanes wait for each other here, then test triangles together.
        while !node.is_leaf() {
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
            // An empty leaf beside another child is not worth a visit.
            if last < enter {
                node = far;
            } else if first > exit || far.is_empty() {
                node = near;
                exit = low(exit, last);
            } else if near.is_empty() {
                node = far;
                enter = high(enter, first);
            } else {
                if top < MAX_DEPTH {
                    let (word0, word1) = far.words();
                    stack.put(top, UVec4::new(word0, word1, exit.to_bits(), first.to_bits()));
                    top += 1;
                } else {
                    steps.status |= status::STACK;
                }
                node = near;
                exit = low(exit, last);
            }
        }
        if COUNT {
            steps.visit(node);
        }
        let whole = leaf::visit::<AFTER>(ray, node, corners, after, &mut best);
        running = !(ANY && best.triangle != MISS);
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
    if top + open != 0 && !(ANY && best.triangle != MISS) {
        steps.status |= status::CUT_SHORT;
    }
    best
}
