//! Traversal with a full private stack (Hapala & Havran 2011, section 3; entries of two values after
//! Zlatuška & Havran 2010).
//!
//! Traps avoided: a direction component of 0 has a large finite reciprocal, so `0 * inf` cannot arise; a plane
//! counts as `2 * pad` thick, so an origin on it, or a hit in it, is in both children; a hit is never rejected
//! for lying outside the leaf; the search goes on while the next entry is not beyond the best hit, so that
//! equal `t` finds the lowest id.

use super::{
    NOTHING,
    frame::{Frame, component},
    triangle::{Best, test},
};
use crate::{
    glam::{UVec2, Vec4},
    math::{abs, low},
    mem::{Buf, Slots},
};
use raykd_shared::{MISS, Node, limits::MAX_DEPTH, status};

/// What a ray did on its way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steps {
    /// Inner nodes passed.
    pub inner: u32,
    /// Leaves visited.
    pub leaves: u32,
    /// Triangles tested.
    pub tests: u32,
    /// Status bits raised on the way.
    pub status: u32,
}

/// Finds the closest hit of a ray, or with `ANY` the best one in the first leaf that has one.
#[inline(always)]
pub fn walk<const ANY: bool>(
    ray: &Frame,
    nodes: &Buf<UVec2>,
    corners: &Buf<Vec4>,
    steps: &mut Steps,
) -> Best {
    let mut best = NOTHING;
    // Entries: node not yet visited with the axis of the plane before it, and where its interval ends.
    let mut stack = [UVec2::ZERO; MAX_DEPTH as usize];
    let mut top = 0;
    let mut node = 0;
    let mut enter = ray.enter;
    let mut exit = ray.exit;
    let mut running = ray.valid && enter <= exit;
    while running {
        let word = nodes.at(node);
        let here = Node::from_words(word.x, word.y);
        if here.is_leaf() {
            steps.leaves += 1;
            let mut r = here.first();
            let end = r + here.count();
            steps.tests += here.count();
            while r < end {
                let (a, b, c) = (corners.at(3 * r), corners.at(3 * r + 1), corners.at(3 * r + 2));
                test(ray, a.w.to_bits(), a.truncate(), b.truncate(), c.truncate(), &mut best);
                r += 1;
            }
            running = !(ANY && best.triangle != MISS);
            let mut searching = running;
            while searching {
                if top == 0 {
                    running = false;
                    searching = false;
                } else {
                    top -= 1;
                    let entry = stack.at(top);
                    // The subtree just left ended half a plane beyond the plane, the next begins half before.
                    let wide = ray.pad * abs(component(ray.inverse, entry.x & 3));
                    enter = exit - (wide + wide);
                    exit = f32::from_bits(entry.y);
                    node = entry.x >> 2;
                    searching = enter > best.t;
                }
            }
        } else {
            steps.inner += 1;
            let axis = here.axis();
            let inverse = component(ray.inverse, axis);
            let at = (here.split() - component(ray.origin, axis)) * inverse;
            let wide = ray.pad * abs(inverse);
            let back = (inverse < 0.0) as u32;
            let near = here.below() + back;
            let far = here.below() + 1 - back;
            if at - wide > exit {
                node = near;
            } else if at + wide < enter {
                node = far;
            } else {
                if top < MAX_DEPTH {
                    stack.put(top, UVec2::new((far << 2) | axis, exit.to_bits()));
                    top += 1;
                } else {
                    steps.status |= status::STACK;
                }
                node = near;
                exit = low(exit, at + wide);
            }
        }
    }
    if running {
        // Some software drivers leave a loop after so many rounds whatever its condition says.
        steps.status |= status::CUT_SHORT;
    }
    best
}
