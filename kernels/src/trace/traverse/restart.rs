//! Restarting at the root after every leaf (Foley & Sugerman 2005, "KD-tree acceleration structures for a GPU
//! raytracer", kd-restart).
//!
//! The paper goes on at the `t` where the last leaf ended, and so may find that leaf again for ever, or skip
//! a thin one. Here a [`Trail`] says which leaf was last: a new descent follows it to the deepest node whose
//! far child is still ahead, and turns there. The trail rises with every turn, so each leaf comes once, in
//! the order of `stack`, and the turns end without an epsilon or a limit on their number. There is none to
//! what lies beyond the best hit, nor to an empty leaf beside another child.

use super::{
    Steps,
    crossing::Crossing,
    leaf::{self, Every},
    trail::Trail,
};
use crate::{
    glam::{UVec4, Vec4},
    math::{high, low},
    mem::Buf,
    trace::{
        frame::Frame,
        intersect::{Best, strict::Strict},
        place::Place,
    },
};
use raykd_shared::{Node, limits::MAX_DEPTH, status};

/// Bytes that a ray keeps between two leaves, beside its best hit: the trail, and how far to follow it.
pub const STATE: u32 = 12;

/// A node with the part of the ray in it.
#[derive(Clone, Copy, Debug)]
pub struct Base {
    /// The node.
    pub node: Node,
    /// Its depth.
    pub level: u32,
    /// Where the ray enters it.
    pub enter: f32,
    /// Where the ray leaves it.
    pub exit: f32,
}

impl Base {
    /// The root.
    #[inline(always)]
    pub fn root(ray: &Frame, pairs: &Buf<UVec4>) -> Self {
        Self { node: Place::load(0, pairs).node, level: 0, enter: ray.enter, exit: ray.exit }
    }
}

/// Finds the closest hit, or if `any` will do the best one in the first leaf that has one. With `PUSHDOWN` a
/// descent starts at the lowest node that holds all that is left of the ray.
#[inline(always)]
pub fn walk<const PUSHDOWN: bool>(
    ray: &Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    any: bool,
    steps: &mut Steps,
) -> Best {
    let mut best = Best::NOTHING;
    let mut base = Base::root(ray, pairs);
    let mut trail = Trail::ROOT;
    // Levels above this one follow the trail.
    let mut fixed = 0;
    let mut running = ray.valid && ray.enter <= ray.exit;
    // 1 until nothing is left.
    let mut open = running as u32;
    while running {
        let Base { mut node, mut level, mut enter, mut exit } = base;
        // One more than the level of the deepest node whose far child is to be visited later; 0 for none.
        let mut waiting = 0;
        // The first `t` in any of them.
        let mut first_waiting = f32::INFINITY;
        while !node.is_leaf() && enter <= best.t {
            steps.inner += 1;
            let plane = Crossing::new(ray, node, pairs);
            let reached = plane.first <= low(exit, best.t);
            let far = if level < fixed { trail.is_far(level) } else { plane.skips_near(enter, reached) };
            if far {
                trail = if level < fixed { trail } else { trail.turned(level) };
                node = plane.far.node;
                enter = high(enter, plane.first);
            } else {
                if reached && !plane.far.node.is_empty() {
                    waiting = level + 1;
                    first_waiting = low(first_waiting, high(enter, plane.first));
                }
                node = plane.near.node;
                exit = low(exit, plane.last);
            }
            level += 1;
            if PUSHDOWN && waiting == 0 {
                base = Base { node, level, enter, exit };
            }
        }
        // Else a hit found since makes this subtree useless.
        if enter <= best.t {
            steps.visit(node);
            if !leaf::visit(Strict, ray, node, corners, &mut Every, &mut best) {
                steps.status |= status::CUT_SHORT;
            }
        }
        if level > MAX_DEPTH {
            steps.status |= status::STACK;
        }
        // What waits beyond the best hit is not worth a visit.
        if waiting == 0 || first_waiting > best.t || best.is_enough(any) {
            running = false;
            open = 0;
        } else {
            trail = trail.turned(waiting - 1);
            fixed = waiting;
            steps.turns += 1;
        }
    }
    if open != 0 {
        steps.status |= status::CUT_SHORT;
    }
    best
}

query! {
    /// Restarts at the root.
    RESTART counts = |_, ray, pairs, corners, any, _, steps|
        walk::<false>(ray, pairs, corners, any, steps)
}
