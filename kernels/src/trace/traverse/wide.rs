//! Traversal of nodes of eight children (Ylitie, Karras & Laine 2017, "Efficient incoherent ray traversal on GPUs
//! through compressed wide BVHs", section 3; see [`WideNode`]). A ray takes fewer and longer steps than from plane to
//! plane, which suits a GPU if rays are few or incoherent: it waits less often for memory and for its warp.
//!
//! # Why nothing is missed
//! A hit lies within `21 e M` of its triangle on every axis, see [`Frame`], and boxes hold whole triangles. A face of a
//! box is passed at `(lo - origin) * inverse + steps * (unit * inverse)`, where `steps * unit` is at most `2.1 M`. In
//! space, the first term is wrong by `4 e M` (reciprocal, difference, product, pad), the second by `4.2 e M`
//! (reciprocal, product; a product and sum with one rounding are better), their sum by `1.2 e M`: with `21 e M` less
//! than the pad of `32 e M`. A box is left out only if the ray surely passes it by, or meets it beyond the best hit.

use super::{
    Steps,
    leaf::{Every, Filter, LeafTriangle},
    stack::{Apart, at_leaf, lay_aside, with_aside},
};
use crate::{
    ON_GPU,
    glam::{UVec2, UVec4, Vec3, Vec4},
    math::{about, abs, exp2, higher, lower},
    mem::{self, Buf, Slots, scratch},
    trace::{
        frame::Frame,
        intersect::{Best, strict::Strict},
    },
};
use raykd_shared::{WideNode, status};

/// The number of entries of a ray that needs none.
const DONE: u32 = u32::MAX;

/// The bits of slots that lie low along each axis.
const LOW: [u32; 3] = [0o0707_0707, 0o77_0077, 0o7777];

/// What a step needs to know of a ray.
struct Line {
    origin: Vec3,
    inverse: Vec3,
    pad: f32,
    enter: f32,
}

/// All bits if a ray goes down along an axis: by these a GPU chooses without a branch.
#[inline(always)]
fn falls(inverse: f32) -> u32 {
    (inverse.to_bits() as i32 >> 31) as u32
}

impl Line {
    #[inline(always)]
    fn of(ray: &Frame) -> Self {
        Self { origin: ray.origin, inverse: ray.inverse, pad: ray.pad, enter: ray.enter }
    }

    /// Of the lowest bits of some slots, the one that the ray comes to first.
    #[inline(always)]
    fn first(&self, slots: u32) -> u32 {
        let nearer = |slots: u32, low: u32, inverse: f32| {
            let near = slots & (low ^ falls(inverse));
            if near != 0 { near } else { slots }
        };
        let slots = nearer(slots, LOW[2], self.inverse.z);
        let slots = nearer(slots, LOW[1], self.inverse.y);
        nearer(slots, LOW[0], self.inverse.x)
    }
}

/// Where a ray meets the slabs of a node along one axis.
struct Slab {
    /// `t` from one face to the next.
    unit: f32,
    /// Where the ray surely has not passed face 0, and surely has.
    from: f32,
    to: f32,
    /// The faces by which the ray enters and leaves the boxes in slots 0 to 3 and 4 to 7, a byte each.
    near: [u32; 2],
    far: [u32; 2],
}

impl Slab {
    /// Of an axis: the lowest corner, the exponent in the place where floats have theirs, and the faces.
    #[inline(always)]
    fn new(
        (lo, exponent): (u32, u32),
        (origin, inverse): (f32, f32),
        pad: f32,
        lower: [u32; 2],
        upper: [u32; 2],
    ) -> Self {
        let at = (f32::from_bits(lo) - origin) * inverse;
        let wide = abs(pad * inverse);
        let chosen = |up: u32, down: u32| up ^ ((up ^ down) & falls(inverse));
        Self {
            unit: f32::from_bits(exponent & 0x7F80_0000) * inverse,
            from: at - wide,
            to: at + wide,
            near: [chosen(lower[0], upper[0]), chosen(lower[1], upper[1])],
            far: [chosen(upper[0], lower[0]), chosen(upper[1], lower[1])],
        }
    }

    /// From and to which `t` the ray is between the faces of a child's box. If `ALIKE`, rounded alike on
    /// all machines.
    #[inline(always)]
    fn inside<const ALIKE: bool>(&self, half: usize, byte: u32) -> (f32, f32) {
        let sum = |a: f32, b: f32, c: f32| if ALIKE { a * b + c } else { about(a, b, c) };
        // A byte that stays in its place counts 256 times as much as one place below, the unit as much less, which
        // changes no digit. GPUs shift and convert in the units that find bits and minima, which have most to do, and
        // multiply in others; for the highest byte they have an instruction.
        let (place, unit) = if byte == 3 { (24, self.unit) } else { (0, self.unit * exp2(-8 * byte as i32)) };
        let face = |faces: [u32; 2]| ((faces[half] >> place) & (0xFF << (8 * byte - place))) as f32;
        let (near, far) = (face(self.near), face(self.far));
        (sum(near, unit, self.from), sum(far, unit, self.to))
    }
}

/// The bits of a slot, if the ray meets its box in `enter..=exit`.
#[inline(always)]
fn met<const ALIKE: bool>(slabs: &[Slab; 3], (half, byte): (usize, u32), (enter, exit): (f32, f32)) -> u32 {
    let (x, y, z) = (
        slabs[0].inside::<ALIKE>(half, byte),
        slabs[1].inside::<ALIKE>(half, byte),
        slabs[2].inside::<ALIKE>(half, byte),
    );
    let first = higher(higher(x.0, y.0), higher(z.0, enter));
    let last = lower(lower(x.1, y.1), lower(z.1, exit));
    (first <= last) as u32 * WideNode::triangles(4 * half as u32 + byte, 3)
}

/// [`met`] of the children in four slots.
#[inline(always)]
fn four<const ALIKE: bool>(slabs: &[Slab; 3], half: usize, range: (f32, f32)) -> u32 {
    met::<ALIKE>(slabs, (half, 0), range)
        | met::<ALIKE>(slabs, (half, 1), range)
        | met::<ALIKE>(slabs, (half, 2), range)
        | met::<ALIKE>(slabs, (half, 3), range)
}

/// Where a ray is: what it still has to visit of the last node, and how many entries its stack has.
struct Place {
    /// A group of nodes: the number of the first one, and [`WideNode::nodes`], with [`WideNode::LOWEST`] bits only for
    /// those to visit. So is an entry of the stack, which has one at most for each level.
    nodes: UVec2,
    /// The number of a node's first triangle, a bit for each to test, and for each that it has.
    first_triangle: u32,
    triangles: u32,
    all_triangles: u32,
    top: u32,
}

impl Place {
    /// Before the root, the only node of its group; or [`DONE`] if not `running`.
    #[inline(always)]
    fn new(running: bool) -> Self {
        Self {
            nodes: UVec2::new(0, 1),
            first_triangle: 0,
            triangles: 0,
            all_triangles: 0,
            top: if running { 0 } else { DONE },
        }
    }

    /// Whether there is a node to visit, perhaps one from the stack.
    #[inline(always)]
    fn goes_on(&mut self, stack: &impl Slots<UVec2>) -> bool {
        if self.nodes.y & WideNode::LOWEST != 0 {
            return true;
        }
        if self.top == 0 {
            return false;
        }
        self.top -= 1;
        self.nodes = stack.at(self.top);
        true
    }

    /// Visits the next node of the group. Nothing beyond the best hit, at `t`, matters.
    #[inline(always)]
    fn down<const ALIKE: bool>(
        &mut self,
        line: &Line,
        nodes: &Buf<UVec4>,
        stack: &mut impl Slots<UVec2>,
        t: f32,
    ) {
        let bit = line.first(self.nodes.y & WideNode::LOWEST);
        let left = self.nodes.y ^ bit;
        if left & WideNode::LOWEST != 0 {
            stack.put(self.top, UVec2::new(self.nodes.x, left));
            self.top += 1;
        }
        let before = left & WideNode::SECOND & bit.wrapping_sub(1);
        let at = 5 * (self.nodes.x + before.count_ones());
        let [a, b, c, d] = nodes.four(at);
        let e = nodes.at(at + 4);
        let (o, i, pad) = (line.origin, line.inverse, line.pad);
        let slabs = [
            Slab::new((a.x, a.w << 23), (o.x, i.x), pad, [c.x, c.y], [d.z, d.w]),
            Slab::new((a.y, a.w << 15), (o.y, i.y), pad, [c.z, c.w], [e.x, e.y]),
            Slab::new((a.z, a.w << 7), (o.z, i.z), pad, [d.x, d.y], [e.z, e.w]),
        ];
        let range = (line.enter, t);
        let met = four::<ALIKE>(&slabs, 0, range) | four::<ALIKE>(&slabs, 1, range);
        self.nodes = UVec2::new(b.x, b.w & (met | WideNode::SECOND));
        self.first_triangle = b.y;
        self.triangles = b.z & met;
        self.all_triangles = b.z;
    }
}

/// Tests triangles of the last node, if `any` hit will do until there is one. Returns whether it got that far, as
/// [`super::leaf::visit`] does.
#[inline(always)]
fn visit<F: Filter<Strict>>(
    ray: &Frame,
    place: &Place,
    corners: &Buf<Vec4>,
    filter: &mut F,
    best: &mut Best,
    any: bool,
) -> bool {
    let mut left = place.triangles;
    let mut looked = 0;
    if left != 0 {
        // As there: lanes look for a triangle that may be hit, wait for each other, then test theirs together.
        loop {
            let mut found = LeafTriangle::<Strict>::none();
            let is_found = loop {
                if left == 0 {
                    break false;
                }
                let bit = left & left.wrapping_neg();
                left ^= bit;
                looked |= bit;
                let before = place.all_triangles & (bit - 1);
                let at = place.first_triangle + before.count_ones();
                let (triangle, may_hit) = LeafTriangle::look(Strict, ray, at, corners);
                if may_hit {
                    found = triangle;
                    break true;
                }
            };
            if is_found {
                filter.test(Strict, ray, found, best);
            }
            if left == 0 || best.is_enough(any) {
                break;
            }
        }
    }
    looked == place.triangles || best.is_enough(any)
}

/// Finds the closest hit of a ray, or if `any` will do the first one found. With `COUNT`, says what it did, the same on
/// all machines.
///
/// A CPU has one piece of code for all kernels, which counts: it would do nothing else without.
#[cfg_attr(target_arch = "spirv", inline(always))]
pub fn walk<const COUNT: bool>(
    ray: &mut Frame,
    nodes: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    any: bool,
    aside: &mut impl Slots<u32>,
    steps: &mut Steps,
) -> Best {
    let line = Line::of(ray);
    lay_aside(ray, aside);
    let mut filter = Apart { choice: Every, aside, own: &mut scratch::<u32, 1>() };
    // A hit as far as the ray goes is taken, and none beyond: the same as if the best one were there.
    let mut best = Best { t: ray.t_max, ..Best::NOTHING };
    let mut running = ray.valid & (ray.enter <= ray.exit);
    let mut stack = mem::stack::<UVec2, { WideNode::MAX_DEPTH as usize }>();
    let mut place = Place::new(running);
    while running {
        place.down::<COUNT>(&line, nodes, &mut stack, best.t);
        if COUNT {
            steps.inner += 1;
        }
        // Lanes without triangles take a second step while others wait: found by trying on an H200.
        if !COUNT && place.triangles == 0 && place.goes_on(&stack) {
            place.down::<COUNT>(&line, nodes, &mut stack, best.t);
        }
        if COUNT && place.triangles != 0 {
            steps.leaves += 1;
            steps.tests += place.triangles.count_ones();
        }
        let at_leaf = at_leaf(ray, filter.aside);
        let whole = visit(&at_leaf, &place, corners, &mut filter, &mut best, any);
        // Where a loop was cut short the number of entries stays what it is.
        let goes_on = whole & !best.is_enough(any) && place.goes_on(&stack);
        if whole & !goes_on {
            place.top = DONE;
        }
        running = goes_on;
    }
    if place.top != DONE {
        steps.status |= status::CUT_SHORT;
    }
    with_aside(best, ray, filter.aside)
}

query! {
    /// The closest hit through nodes of eight children.
    WIDE = |_, ray, pairs, corners, _, aside, steps| walk::<{ !ON_GPU }>(ray, pairs, corners, false, aside, steps)
}
query! {
    /// Any hit through nodes of eight children.
    wide_any::WIDE_ANY = |_, ray, pairs, corners, _, aside, steps|
        walk::<{ !ON_GPU }>(ray, pairs, corners, true, aside, steps)
}
query! {
    /// The closest or any hit through nodes of eight children, counting steps.
    wide_steps::WIDE_STEPS counts = |_, ray, pairs, corners, any, aside, steps|
        walk::<true>(ray, pairs, corners, any, aside, steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slots are numbered by where they lie, so that a ray comes to those first whose bits differ least from its own
    /// signs, along z before y before x.
    #[test]
    fn a_ray_comes_to_near_slots_first() {
        for down in 0..8_u32 {
            let sign = |axis: u32| if down >> axis & 1 == 1 { -2.0 } else { 2.0 };
            let inverse = Vec3::new(sign(0), sign(1), sign(2));
            let line = Line { origin: Vec3::ZERO, inverse, pad: 0.0, enter: 0.0 };
            for some in 1..256_u32 {
                let there = (0..8).filter(|slot| some >> slot & 1 == 1);
                let bits = there.clone().fold(0, |bits, slot| bits | WideNode::triangles(slot, 1));
                let nearest = there.min_by_key(|slot| slot ^ down).unwrap();
                assert_eq!(
                    line.first(bits),
                    WideNode::triangles(nearest, 1),
                    "{some:08b} of a ray with {down:03b}"
                );
            }
        }
    }
}
