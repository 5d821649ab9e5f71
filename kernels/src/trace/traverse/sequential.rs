//! Locating leaf after leaf from the root (Kaplan 1985, "The uses of spatial coherence in ray tracing"), the
//! teaching baseline: a point just past the last leaf is located in the tree, and so on.
//!
//! No distance is "just past": an absolute one vanishes in a large `t` (an endless loop) or jumps over a thin
//! leaf. Here the next leaf is located relative to the last, whose place is known by its [`Trail`]: the
//! descent goes down to it again, remembers the deepest plane that the ray crosses before it leaves the leaf
//! for good, and goes on from that plane's other side.

use super::{
    Steps,
    crossing::Crossing,
    leaf::{self, Every},
    restart::Base,
    trail::Trail,
};
use crate::{
    glam::{UVec4, Vec4},
    math::{high, low},
    mem::Buf,
    trace::{
        frame::Frame,
        intersect::{Best, strict::Strict},
    },
};
use raykd_shared::{limits::MAX_DEPTH, status};

/// Bytes that a ray keeps between two leaves, beside its best hit: the last leaf's trail and depth, and where
/// the ray leaves it.
pub const STATE: u32 = 16;

/// Finds the closest hit, or if `any` will do the best one in the first leaf that has one.
#[inline(always)]
pub fn walk(ray: &Frame, pairs: &Buf<UVec4>, corners: &Buf<Vec4>, any: bool, steps: &mut Steps) -> Best {
    let mut best = Best::NOTHING;
    let root = Base::root(ray, pairs);
    let mut at = root;
    let mut trail = Trail::ROOT;
    let mut running = ray.valid && ray.enter <= ray.exit;
    // 1 until nothing is left.
    let mut open = running as u32;
    while running {
        while !at.node.is_leaf() {
            steps.inner += 1;
            let plane = Crossing::new(ray, at.node, pairs);
            if plane.last < at.enter {
                trail = trail.turned(at.level);
                at.node = plane.far.node;
                at.enter = high(at.enter, plane.first);
            } else {
                at.node = plane.near.node;
                at.exit = low(at.exit, plane.last);
            }
            at.level += 1;
        }
        steps.visit(at.node);
        if !leaf::visit(Strict, ray, at.node, corners, &mut Every, &mut best) {
            steps.status |= status::CUT_SHORT;
        }
        if at.level > MAX_DEPTH {
            steps.status |= status::STACK;
        }
        // From the root to the leaf once more. A far child that begins later than the leaf ends is another's.
        let reach = low(at.exit, best.t);
        let depth = at.level;
        let mut turn = root;
        let mut turned = false;
        at = root;
        while at.level < depth {
            steps.inner += 1;
            let plane = Crossing::new(ray, at.node, pairs);
            let enter = high(at.enter, plane.first);
            if trail.is_far(at.level) {
                at.node = plane.far.node;
                at.enter = enter;
            } else {
                if plane.first <= reach {
                    turn = Base { node: plane.far.node, level: at.level + 1, enter, exit: at.exit };
                    turned = true;
                }
                at.node = plane.near.node;
                at.exit = low(at.exit, plane.last);
            }
            at.level += 1;
        }
        // Not `<`: see leaf.rs.
        if at.level != depth {
            steps.status |= status::CUT_SHORT;
        }
        at = turn;
        if !turned || best.is_enough(any) {
            running = false;
            open = 0;
        } else {
            trail = trail.turned(turn.level - 1);
            steps.turns += 1;
        }
    }
    if open != 0 {
        steps.status |= status::CUT_SHORT;
    }
    best
}

query! {
    /// Locates every leaf from the root.
    SEQUENTIAL counts = |_, ray, pairs, corners, any, _, steps|
        walk(ray, pairs, corners, any, steps)
}
