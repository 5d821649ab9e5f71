//! Writes wide nodes, see [`WideNode`], and the order of triangles.

use super::{
    Binary, JOB_TRIANGLES, STATE_NODES, children_of,
    open::{NONE, SLOTS},
};
use crate::{
    glam::{UVec2, UVec4, Vec3},
    math::component,
    mem::{Buf, Slots},
    pair::Pair,
};
use raykd_shared::WideNode;

/// The exponent of a face's unit, 127 more than it is, is at least this: with reciprocals of a ray, which are at least
/// `2^-1`, no product of a unit of `2^-90` is subnormal.
const LEAST: u32 = 37;
/// Steps from the lowest face to the highest.
const STEPS: f32 = 255.0;
/// Elements of a node.
const ELEMENTS: u32 = (size_of::<WideNode>() / size_of::<UVec4>()) as u32;

/// The power of two that a field of a float stands for.
#[inline(always)]
fn power(field: u32) -> f32 {
    f32::from_bits(field << 23)
}

/// The exponent of the smallest unit of which 255 reach from `lo` to `hi`.
#[inline(always)]
fn exponent(lo: f32, hi: f32) -> u32 {
    let extent = Pair::sum(hi, -lo);
    let field = extent.hi.to_bits() >> 23;
    // 128 units of it are at most the extent, 256 more.
    let unit = if field < LEAST + 7 { LEAST } else { field - 7 };
    let reach = STEPS * power(unit);
    let is_short = extent.hi > reach || (extent.hi == reach && extent.lo > 0.0);
    unit + is_short as u32
}

/// The last step at or below `x`, and the first at or above it, without rounding.
#[inline(always)]
fn steps(x: f32, lo: f32, exponent: u32) -> (u32, u32) {
    let from = Pair::sum(x, -lo);
    // By a power of two.
    let rounded = from.hi * power(254 - exponent);
    let step = rounded as u32;
    let rest = rounded - step as f32;
    let below = if rest == 0.0 && from.lo < 0.0 { step - 1 } else { step };
    let above = if rest > 0.0 || (rest == 0.0 && from.lo > 0.0) { step + 1 } else { step };
    (below, above)
}

/// Writes the numbers of the triangles in a slot, three at most, to their places.
#[inline(always)]
fn list(
    slot: u32,
    count: u32,
    triangles: u32,
    children: &Buf<UVec2>,
    numbers: &Buf<u32>,
    to: u32,
    order: &mut Buf<u32>,
) {
    // Nodes to come, of at most three triangles: this one, and the one behind it.
    let (mut node, mut behind) = (slot, slot);
    let mut k = 0;
    while k < count {
        if node < triangles {
            order.put(to + k, numbers.at(node));
            k += 1;
            node = behind;
        } else {
            let two = children_of(children, triangles, node);
            // Of two nodes one is a triangle, which comes first.
            let is_first = two.x < triangles;
            let (one, other) = if is_first { (two.x, two.y) } else { (two.y, two.x) };
            node = one;
            behind = other;
        }
    }
}

/// Writes wide node `i`, and the numbers of its triangles to their places.
pub fn encode(
    i: u32,
    job: &Buf<u32>,
    state: &Buf<u32>,
    nodes: &Buf<UVec4>,
    children: &Buf<UVec2>,
    triangles: &Buf<u32>,
    queue: &Buf<UVec4>,
    slots: &Buf<u32>,
    order: &mut Buf<u32>,
    wide: &mut Buf<UVec4>,
) {
    if i < state.at(STATE_NODES) {
        let count = job.at(JOB_TRIANGLES);
        let entry = queue.at(i);
        let Binary { bounds, .. } = Binary::load(nodes, entry.x);
        let exponents = [
            exponent(bounds.lo.x, bounds.hi.x),
            exponent(bounds.lo.y, bounds.hi.y),
            exponent(bounds.lo.z, bounds.hi.z),
        ];
        // The faces of four slots a word: lower ones along each axis, then upper ones.
        let mut faces = [UVec2::new(0, 0); 6];
        let (mut with_triangles, mut with_nodes) = (0, 0);
        let mut to = entry.y;
        let mut slot = 0;
        while slot < SLOTS {
            let child = slots.at(SLOTS * i + slot);
            if child != NONE {
                let node = Binary::load(nodes, child);
                let face = |lower: UVec2, upper: UVec2, axis: u32, exponent: u32| {
                    let lo = component(bounds.lo, axis);
                    let below = steps(component(node.bounds.lo, axis), lo, exponent).0 << (8 * (slot & 3));
                    let above = steps(component(node.bounds.hi, axis), lo, exponent).1 << (8 * (slot & 3));
                    if slot < 4 {
                        (UVec2::new(lower.x | below, lower.y), UVec2::new(upper.x | above, upper.y))
                    } else {
                        (UVec2::new(lower.x, lower.y | below), UVec2::new(upper.x, upper.y | above))
                    }
                };
                (faces[0], faces[3]) = face(faces[0], faces[3], 0, exponents[0]);
                (faces[1], faces[4]) = face(faces[1], faces[4], 1, exponents[1]);
                (faces[2], faces[5]) = face(faces[2], faces[5], 2, exponents[2]);
                if node.is_slot() {
                    with_triangles |= WideNode::triangles(slot, node.count);
                    list(child, node.count, count, children, triangles, to, order);
                    to += node.count;
                } else {
                    with_nodes |= WideNode::node(slot);
                }
            }
            slot += 1;
        }
        let Vec3 { x, y, z } = bounds.lo;
        let units = exponents[0] | exponents[1] << 8 | exponents[2] << 16;
        let [a, b, c, d, e, f] = faces;
        let at = ELEMENTS * i;
        wide.put(at, UVec4::new(x.to_bits(), y.to_bits(), z.to_bits(), units));
        wide.put(at + 1, UVec4::new(entry.z, entry.y, with_triangles, with_nodes));
        wide.put(at + 2, UVec4::new(a.x, a.y, b.x, b.y));
        wide.put(at + 3, UVec4::new(c.x, c.y, d.x, d.y));
        wide.put(at + 4, UVec4::new(e.x, e.y, f.x, f.y));
    }
}

kernel! {
    /// [`encode`] over all wide nodes.
    map ENCODE = encode, threads 64, {
        0 job: read u32, 1 state: read u32, 2 nodes: read UVec4, 3 children: read UVec2, 4 triangles: read u32,
        5 queue: read UVec4, 6 slots: read u32, 7 order: write u32, 8 wide: write UVec4,
    }
}
