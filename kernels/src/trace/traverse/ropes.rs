//! Following ropes from leaf to leaf, without a stack and without restarts (Popov, Günther, Seidel &
//! Slusallek 2007, "Stackless kd-tree traversal for high performance GPU ray tracing"). The entry leaf is
//! located from the root.
//!
//! The paper leaves a leaf by the side that the ray reaches first. Near an edge or a corner rounding may
//! choose the wrong one, and the walk goes to and fro between two leaves until a cap ends it. Here a side
//! counts as soon as the ray is inside its thick plane when it leaves. Mostly that is one side, and its rope
//! leads on. If it is several, the leaf's parents tell which of the planes is the deepest in the tree; beyond
//! that one the ray's next leaf lies, and the other planes are crossed later. So every walk goes forward in
//! the ray's order of leaves.
//!
//! *Optimised* ropes are pulled down to the smallest node that lies beyond a whole side. Such a rope skips
//! the children beside it. Those that come before the rope's end in the ray's order would be missed if the
//! ray still were inside the planes between: then, as at corners, the leaf's parents are asked.

use super::{
    Steps,
    crossing::{Crossing, thick},
    leaf::{self, Every},
};
use crate::{
    glam::{UVec4, Vec4},
    math::{high, low},
    mem::{Buf, Slots},
    trace::{
        frame::Frame,
        intersect::{Best, strict::Strict},
        place::Place,
        prepare::climb::NONE,
    },
};
use raykd_shared::status;

/// Bytes that a ray keeps between two leaves, beside its best hit: the leaf's number and where the ray enters
/// it.
pub const STATE: u32 = 8;

/// How a ray passes a leaf along one axis.
struct Passage {
    /// Where it surely is past the side that it enters by.
    past: f32,
    /// Where it may have passed the side that it leaves by.
    first: f32,
    /// Where it surely has.
    last: f32,
    /// What lies beyond that side.
    rope: u32,
    /// Where it may have passed the side that it enters by.
    enter: f32,
}

#[inline(always)]
fn passage(ray: &Frame, axis: u32, back: bool, lo: u32, hi: u32, ropes: (u32, u32)) -> Passage {
    let (to_lo, to_hi) = (thick(ray, axis, f32::from_bits(lo)), thick(ray, axis, f32::from_bits(hi)));
    let (near, far) = if back { (to_hi, to_lo) } else { (to_lo, to_hi) };
    let rope = if back { ropes.0 } else { ropes.1 };
    Passage { past: near.1, first: far.0, last: far.1, rope, enter: near.0 }
}

/// Finds the closest hit, or if `any` will do the best one in the first leaf that has one. `OPTIMISED` ropes
/// skip nodes.
#[inline(always)]
pub fn walk<const OPTIMISED: bool>(
    ray: &Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    parents: &Buf<u32>,
    links: &Buf<UVec4>,
    any: bool,
    steps: &mut Steps,
) -> Best {
    let mut best = Best::NOTHING;
    let mut here = Place::load(0, pairs);
    // What is left of the ray begins here.
    let mut from = ray.enter;
    let mut running = ray.valid && ray.enter <= ray.exit;
    // 1 until nothing is left.
    let mut open = running as u32;
    while running {
        while !here.node.is_leaf() {
            steps.inner += 1;
            let plane = Crossing::new(ray, here.node, pairs);
            if plane.last < from {
                here = plane.far;
                from = high(from, plane.first);
            } else {
                here = plane.near;
            }
        }
        let (a, b, c) = links.three(3 * here.index);
        let x = passage(ray, 0, ray.inverse.x < 0.0, a.x, a.w, (b.z, c.y));
        let y = passage(ray, 1, ray.inverse.y < 0.0, a.y, b.x, (b.w, c.z));
        let z = passage(ray, 2, ray.inverse.z < 0.0, a.z, b.y, (c.x, c.w));
        let enter = high(high(ray.enter, x.enter), high(y.enter, z.enter));
        let exit = low(low(ray.exit, x.last), low(y.last, z.last));
        // Entering by a rope near an edge may lead to a leaf that the ray does not meet.
        if enter <= low(exit, best.t) {
            steps.visit(here.node);
            if !leaf::visit(Strict, ray, here.node, corners, &mut Every, &mut best) {
                steps.status |= status::CUT_SHORT;
            }
        }
        let reach = low(exit, best.t);
        let by_x = x.rope != NONE && x.first <= reach;
        let by_y = y.rope != NONE && y.first <= reach;
        let by_z = z.rope != NONE && z.first <= reach;
        let sides = by_x as u32 + by_y as u32 + by_z as u32;
        if sides == 0 || best.is_enough(any) {
            running = false;
            open = 0;
        } else {
            steps.turns += 1;
            let first = if by_x {
                x.first
            } else if by_y {
                y.first
            } else {
                z.first
            };
            let mut next = if by_x {
                x.rope
            } else if by_y {
                y.rope
            } else {
                z.rope
            };
            // Where the ray surely is past the sides of the other axes.
            let past = if by_x {
                high(y.past, z.past)
            } else if by_y {
                high(x.past, z.past)
            } else {
                high(x.past, y.past)
            };
            from = high(ray.enter, first);
            let mut climbing = sides != 1 || (OPTIMISED && past >= from);
            let mut child = here.index;
            while climbing {
                steps.inner += 1;
                let up = parents.at(child >> 1);
                let parent = Place::load(up, pairs);
                let plane = Crossing::new(ray, parent.node, pairs);
                if child == plane.near.index && plane.first <= reach {
                    next = plane.far.index;
                    from = high(ray.enter, plane.first);
                    climbing = false;
                }
                child = up;
            }
            here = Place::load(next, pairs);
        }
    }
    if open != 0 {
        steps.status |= status::CUT_SHORT;
    }
    best
}

query! {
    /// Follows ropes to the node beyond the whole plane.
    ROPES counts = |_, ray, pairs, corners, any, _, steps|
        walk::<false>(ray, pairs, corners, parents, links, any, steps),
    { 8 parents: u32, 9 links: UVec4 }
}
query! {
    /// Follows ropes to the smallest node beyond a side.
    optimised_ropes::OPTIMISED_ROPES counts = |_, ray, pairs, corners, any, _, steps|
        walk::<true>(ray, pairs, corners, parents, links, any, steps),
    { 8 parents: u32, 9 links: UVec4 }
}
