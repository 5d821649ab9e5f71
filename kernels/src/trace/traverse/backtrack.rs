//! Climbing from the leaf to the lowest node with something ahead (Foley & Sugerman 2005, "KD-tree acceleration
//! structures for a GPU raytracer", kd-backtrack). Nodes know their parents and boxes.
//!
//! The paper climbs until a node's box contains the ray after the last `t`; a point that rounding put outside
//! all boxes climbs past the root. Here a node is left upwards for good when it was left by its far child, or
//! when its plane is too far ahead: which child that was is a number, not a matter of rounding. A box gives
//! the same interval as the planes on the way down, bit by bit, since both are made of the same numbers.

use super::{
    Steps,
    crossing::Crossing,
    leaf::{self, Every},
};
use crate::{
    glam::{UVec4, Vec4},
    math::{high, low},
    mem::{Buf, Slots},
    trace::{
        frame::{Frame, slab},
        intersect::{Best, strict::Strict},
        place::Place,
    },
};
use raykd_shared::{MISS, status};

/// Bytes that a ray keeps between two leaves, beside its best hit: the leaf's number and where the ray leaves
/// it.
pub const STATE: u32 = 8;

/// Finds the closest hit, or if `any` will do the best one in the first leaf that has one. `boxes` are those of
/// [`node_boxes`](crate::trace::prepare::node_boxes).
#[inline(always)]
pub fn walk(
    ray: &Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    boxes: &Buf<UVec4>,
    any: bool,
    steps: &mut Steps,
) -> Best {
    let mut best = Best::NOTHING;
    let mut here = Place::load(0, pairs);
    let (mut enter, mut exit) = (ray.enter, ray.exit);
    let mut running = ray.valid && enter <= exit;
    // 1 until nothing is left.
    let mut open = running as u32;
    while running {
        while !here.node.is_leaf() && enter <= best.t {
            steps.inner += 1;
            let plane = Crossing::new(ray, here.node, pairs);
            if plane.last < enter {
                here = plane.far;
                enter = high(enter, plane.first);
            } else {
                here = plane.near;
                exit = low(exit, plane.last);
            }
        }
        // Else a hit found since makes this subtree useless.
        if enter <= best.t {
            steps.visit(here.node);
            if !leaf::visit(Strict, ray, here.node, corners, &mut Every, &mut best) {
                steps.status |= status::CUT_SHORT;
            }
        }
        running = !best.is_enough(any);
        // Far children that begin later than this node ends are the business of nodes above.
        let reach = low(exit, best.t);
        let mut climbing = running;
        while climbing {
            let up = boxes.at(2 * here.index).w;
            if up == MISS {
                climbing = false;
                running = false;
                open = 0;
            } else {
                steps.inner += 1;
                let parent = Place::load(up, pairs);
                let plane = Crossing::new(ray, parent.node, pairs);
                if here.index == plane.near.index && plane.first <= reach {
                    let (lo, hi) = (boxes.at(2 * up), boxes.at(2 * up + 1));
                    let (o, i) = (ray.origin, ray.inverse);
                    let side = |a: u32| f32::from_bits(a);
                    (enter, exit) = slab(side(lo.x), side(hi.x), o.x, i.x, ray.pad, ray.enter, ray.exit);
                    (enter, exit) = slab(side(lo.y), side(hi.y), o.y, i.y, ray.pad, enter, exit);
                    (enter, exit) = slab(side(lo.z), side(hi.z), o.z, i.z, ray.pad, enter, exit);
                    enter = high(enter, plane.first);
                    here = plane.far;
                    steps.turns += 1;
                    climbing = false;
                } else {
                    here = parent;
                }
            }
        }
    }
    if open != 0 && !best.is_enough(any) {
        steps.status |= status::CUT_SHORT;
    }
    best
}

query! {
    /// Climbs by parents.
    BACKTRACK counts = |_, ray, pairs, corners, any, _, steps|
        walk(ray, pairs, corners, boxes, any, steps),
    { 8 boxes: UVec4 }
}
