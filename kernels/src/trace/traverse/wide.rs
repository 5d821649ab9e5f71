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
    math::{about, abs, higher, lower},
    mem::{self, Buf, Slots, scratch},
    trace::{
        frame::Frame,
        intersect::{Best, strict::Strict},
    },
};
use raykd_shared::{MISS, WideNode, status};

/// The number of entries of a ray that needs none.
const DONE: u32 = u32::MAX;

/// Groups of children have those that are nodes from this bit on, and triangles below.
const NODES: u32 = 24;

/// What a step needs to know of a ray.
struct Line {
    origin: Vec3,
    inverse: Vec3,
    pad: f32,
    enter: f32,
    /// A bit for each axis along which the ray goes up: such a ray comes to slots without that bit first.
    up: u32,
}

impl Line {
    #[inline(always)]
    fn of(ray: &Frame) -> Self {
        let up = |axis: u32, inverse: f32| ((inverse > 0.0) as u32) << axis;
        let (origin, inverse) = (ray.origin, ray.inverse);
        let up = up(0, inverse.x) | up(1, inverse.y) | up(2, inverse.z);
        Self { origin, inverse, pad: ray.pad, enter: ray.enter, up }
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
        // All bits where the ray goes up. Chosen by bits, a GPU does not branch.
        let up = 0u32.wrapping_sub((inverse > 0.0) as u32);
        let chosen = |a: u32, b: u32| b ^ ((a ^ b) & up);
        Self {
            unit: f32::from_bits((exponent & 0xFF) << 23) * inverse,
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
        let face = |faces: [u32; 2]| ((faces[half] >> (8 * byte)) & 0xFF) as f32;
        let (near, far) = (face(self.near), face(self.far));
        if ALIKE {
            (near * self.unit + self.from, far * self.unit + self.to)
        } else {
            (about(near, self.unit, self.from), about(far, self.unit, self.to))
        }
    }
}

/// The bit of a group's child, if the ray meets its box in `enter..=exit`; of triangles one each.
#[inline(always)]
fn met<const ALIKE: bool>(
    slabs: &[Slab; 3],
    (half, byte): (usize, u32),
    slots: u32,
    bits: u32,
    (enter, exit): (f32, f32),
) -> u32 {
    let (x, y, z) = (
        slabs[0].inside::<ALIKE>(half, byte),
        slabs[1].inside::<ALIKE>(half, byte),
        slabs[2].inside::<ALIKE>(half, byte),
    );
    let first = higher(higher(x.0, y.0), higher(z.0, enter));
    let last = lower(lower(x.1, y.1), lower(z.1, exit));
    let children = (slots >> (8 * byte + 5)) & 7;
    (children * (first <= last) as u32) << ((bits >> (8 * byte)) & 31)
}

/// [`met`] of the children in four slots.
#[inline(always)]
fn four<const ALIKE: bool>(slabs: &[Slab; 3], half: usize, slots: u32, up: u32, range: (f32, f32)) -> u32 {
    // A bit for each slot with a node: triangles come at less than 24.
    let node = (slots & (slots << 1) & 0x1010_1010) >> 4;
    // The sooner a ray comes to a node's slot, the higher its bit.
    let bits = slots ^ (node * up);
    met::<ALIKE>(slabs, (half, 0), slots, bits, range)
        | met::<ALIKE>(slabs, (half, 1), slots, bits, range)
        | met::<ALIKE>(slabs, (half, 2), slots, bits, range)
        | met::<ALIKE>(slabs, (half, 3), slots, bits, range)
}

/// The highest bit that is set.
#[inline(always)]
const fn highest(bits: u32) -> u32 {
    31 - bits.leading_zeros()
}

/// Where a ray is: what it still has to visit of the last node, and how many entries its stack has.
///
/// A group of nodes is the number of the first one, and bits: from [`NODES`] on those to visit, below 8 the slots of
/// all. A group of triangles is the number of the first one and a bit for each to test. An entry of the stack is a
/// group of nodes, at most one for each level.
struct Place {
    nodes: UVec2,
    triangles: UVec2,
    top: u32,
}

impl Place {
    /// Whether there is a node to visit, perhaps one from the stack.
    #[inline(always)]
    fn goes_on(&mut self, stack: &impl Slots<UVec2>) -> bool {
        if self.nodes.y >> NODES != 0 {
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
        let bit = highest(self.nodes.y);
        let left = self.nodes.y & !(1 << bit);
        if left >> NODES != 0 {
            stack.put(self.top, UVec2::new(self.nodes.x, left));
            self.top += 1;
        }
        let slot = (bit - NODES) ^ line.up;
        let before = left & 0xFF & !(u32::MAX << slot);
        let at = 5 * (self.nodes.x + before.count_ones());
        let [a, b, c, d] = nodes.four(at);
        let e = nodes.at(at + 4);
        let (o, i, pad) = (line.origin, line.inverse, line.pad);
        let slabs = [
            Slab::new((a.x, a.w), (o.x, i.x), pad, [c.x, c.y], [d.z, d.w]),
            Slab::new((a.y, a.w >> 8), (o.y, i.y), pad, [c.z, c.w], [e.x, e.y]),
            Slab::new((a.z, a.w >> 16), (o.z, i.z), pad, [d.x, d.y], [e.z, e.w]),
        ];
        let range = (line.enter, t);
        let met =
            four::<ALIKE>(&slabs, 0, b.z, line.up, range) | four::<ALIKE>(&slabs, 1, b.w, line.up, range);
        self.nodes = UVec2::new(b.x, (met & (0xFF << NODES)) | (a.w >> 24));
        self.triangles = UVec2::new(b.y, met & !(0xFF << NODES));
    }
}

/// Tests triangles of a group. Returns whether it got through all, as [`super::leaf::visit`] does.
#[inline(always)]
fn visit<F: Filter<Strict>>(
    ray: &Frame,
    group: UVec2,
    corners: &Buf<Vec4>,
    filter: &mut F,
    best: &mut Best,
) -> bool {
    let mut left = group.y;
    let mut looked = 0;
    if left != 0 {
        // As there: lanes look for a triangle that may be hit, wait for each other, then test theirs together.
        loop {
            let mut found = LeafTriangle::<Strict>::none();
            let is_found = loop {
                if left == 0 {
                    break false;
                }
                let bit = highest(left);
                left &= !(1 << bit);
                looked |= 1 << bit;
                let (triangle, may_hit) = LeafTriangle::look(Strict, ray, group.x + bit, corners);
                if may_hit {
                    found = triangle;
                    break true;
                }
            };
            if is_found {
                filter.test(Strict, ray, found, best);
            }
            if left == 0 {
                break;
            }
        }
    }
    looked == group.y
}

/// Finds the closest hit of a ray, or if `any` will do the best one among the triangles of the first node that has one.
/// With `COUNT`, says what it did, the same on all machines.
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
    // The root is the only one of its group.
    let mut place = Place {
        nodes: UVec2::new(0, 1 << 31),
        triangles: UVec2::new(0, 0),
        top: if running { 0 } else { DONE },
    };
    while running {
        place.down::<COUNT>(&line, nodes, &mut stack, best.t);
        if COUNT {
            steps.inner += 1;
        }
        // Lanes without triangles take a second step while others wait: found by trying on an H200.
        if !COUNT && place.triangles.y == 0 && place.goes_on(&stack) {
            place.down::<COUNT>(&line, nodes, &mut stack, best.t);
        }
        if COUNT && place.triangles.y != 0 {
            steps.leaves += 1;
            steps.tests += place.triangles.y.count_ones();
        }
        let at_leaf = at_leaf(ray, filter.aside);
        let whole = visit(&at_leaf, place.triangles, corners, &mut filter, &mut best);
        // Where a loop was cut short the number of entries stays what it is.
        let enough = any && best.triangle != MISS;
        let goes_on = whole & !enough && place.goes_on(&stack);
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
