//! Builds the whole subtree of a node of at most 32 references in one workgroup, one bit a reference.
//!
//! Exact SAH over the box faces of the references (Zhou et al. 2008, section 3.3): which references lie on
//! either side of each face is found once, as masks; after that counting is a population count.

use super::{Item, STATE_STATUS, STATE_TREELETS, Sah, extent, is_above, is_below};
use crate::{
    Group,
    glam::{UVec2, UVec4, Vec3, Vec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{
    BuildParams, Node,
    limits::{MAX_DEPTH, TREELET, treelet_nodes},
};

const LANES: usize = TREELET as usize;
/// Faces of a reference's box.
const FACES: u32 = 6;
const CANDIDATES: usize = LANES * FACES as usize;

// A node waiting to be built: its references, box, depth and slot.
const ENTRY: u32 = 9;
const ENTRIES: usize = (ENTRY * (MAX_DEPTH + 2)) as usize;

// Words of the workgroup's own state.
const WAITING: u32 = 0;
const NODES: u32 = 1;
const REFS: u32 = 2;
const DEPTH: u32 = 3;
const COST: u32 = 4;
const PICK: u32 = 5;
const OWN: usize = 6;

/// No candidate: the node becomes a leaf.
const NONE: u32 = u32::MAX;

#[inline(always)]
fn load_box(stack: &[u32; ENTRIES], at: u32) -> (Vec3, Vec3) {
    let f = move |stack: &[u32; ENTRIES], i: u32| f32::from_bits(stack.at(at + i));
    (Vec3::new(f(stack, 1), f(stack, 2), f(stack, 3)), Vec3::new(f(stack, 4), f(stack, 5), f(stack, 6)))
}

#[inline(always)]
fn push(stack: &mut [u32; ENTRIES], at: u32, mask: u32, lo: Vec3, hi: Vec3, depth: u32, slot: u32) {
    stack.put(at, mask);
    stack.put(at + 1, lo.x.to_bits());
    stack.put(at + 2, lo.y.to_bits());
    stack.put(at + 3, lo.z.to_bits());
    stack.put(at + 4, hi.x.to_bits());
    stack.put(at + 5, hi.y.to_bits());
    stack.put(at + 6, hi.z.to_bits());
    stack.put(at + 7, depth);
    stack.put(at + 8, slot);
}

/// A mask of the lowest `n` bits, `n <= 32`.
#[inline(always)]
fn ones(n: u32) -> u32 {
    if n >= 32 { u32::MAX } else { (1 << n) - 1 }
}

/// Where the nodes of a treelet lie while it is built: room for [`treelet_nodes`] and its root.
#[inline(always)]
pub fn scratch_base(first: u32, treelet: u32) -> u32 {
    // The sum of `treelet_nodes + 1` over the treelets before it.
    4 * first + 9 * treelet
}

/// Builds treelet `group.id`. Its nodes go to `scratch`, numbered from 0, the root; a leaf is its mask
/// and `local first << 2 | 3`. `sizes` gets nodes without the root, references, and depth.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn treelet(
    group: Group,
    faces: &mut [u32; CANDIDATES],
    belows: &mut [u32; CANDIDATES],
    aboves: &mut [u32; CANDIDATES],
    stack: &mut [u32; ENTRIES],
    costs: &mut [u32; LANES],
    picks: &mut [u32; LANES],
    members: &mut [u32; LANES],
    own: &mut [u32; OWN],
    params: &Buf<BuildParams>,
    state: &Buf<u32>,
    treelets: &Buf<UVec4>,
    refs: &Buf<u32>,
    boxes: &Buf<Vec4>,
    scratch: &mut Buf<UVec2>,
    sizes: &mut Buf<UVec4>,
) {
    if group.id < state.at(STATE_TREELETS) && state.at(STATE_STATUS) == 0 {
        let params = params.at(0);
        let item = Item::load(treelets, group.id);
        let base = scratch_base(item.first, group.id);
        // A large leaf of the level loop has nothing to build.
        let small = item.count <= TREELET;
        lanes!(group, |lane| {
            if lane < item.count && small {
                let id = refs.at(item.first + lane);
                let mut axis = 0;
                while axis < 3 {
                    let (lo, hi) = extent(boxes, id, axis);
                    faces.put((axis * 2) * TREELET + lane, lo.to_bits());
                    faces.put((axis * 2 + 1) * TREELET + lane, hi.to_bits());
                    axis += 1;
                }
            }
            if lane == 0 {
                push(stack, 0, ones(item.count), item.lo, item.hi, item.extra, 0);
                own.put(WAITING, small as u32);
                own.put(NODES, 0);
                own.put(REFS, if small { 0 } else { item.count });
                own.put(DEPTH, item.extra);
            }
        });
        lanes!(group, |lane| {
            if lane < item.count && small {
                let mut face = 0;
                while face < FACES {
                    let at = f32::from_bits(faces.at(face * TREELET + lane));
                    let axis_lo = (face & !1) * TREELET;
                    let (mut below, mut above) = (0, 0);
                    let mut i = 0;
                    while i < item.count {
                        let lo = f32::from_bits(faces.at(axis_lo + i));
                        let hi = f32::from_bits(faces.at(axis_lo + TREELET + i));
                        below |= (is_below(lo, hi, at) as u32) << i;
                        above |= (is_above(hi, at) as u32) << i;
                        i += 1;
                    }
                    belows.put(face * TREELET + lane, below);
                    aboves.put(face * TREELET + lane, above);
                    face += 1;
                }
            }
        });
        while own.at(WAITING) > 0 {
            let at = (own.at(WAITING) - 1) * ENTRY;
            let mask = stack.at(at);
            let (lo, hi) = load_box(stack, at);
            let depth = stack.at(at + 7);
            let number = mask.count_ones();
            let sah = Sah::new(lo, hi, &params);
            let as_leaf = sah.leaf(number);
            let nodes = own.at(NODES);
            // A cut costs a step in any case; with few references it cannot pay, whatever the plane.
            let may_pay = as_leaf > sah.step_cost();
            if may_pay && depth < params.max_depth && nodes + 2 <= treelet_nodes(item.count) {
                lanes!(group, |lane| {
                    if (mask >> lane) & 1 == 1 {
                        members.put((mask & ones(lane)).count_ones(), lane);
                    }
                    if lane == 0 {
                        // Just below: only what is cheaper counts.
                        own.put(COST, as_leaf.to_bits() - 1);
                        own.put(PICK, NONE);
                    }
                });
                // Several faces side by side: as many as members fit the group's width.
                let width = 32 - (number - 1).leading_zeros();
                lanes!(group, |lane| {
                    let member = lane & ones(width);
                    let mut best = f32::INFINITY;
                    let mut pick = NONE;
                    if member < number {
                        let member = members.at(member);
                        let mut face = lane >> width;
                        while face < FACES {
                            let candidate = face * TREELET + member;
                            let below = (belows.at(candidate) & mask).count_ones();
                            let above = (aboves.at(candidate) & mask).count_ones();
                            let at = f32::from_bits(faces.at(candidate));
                            let cost = sah.cut(face >> 1, at, below, above);
                            if cost < best {
                                best = cost;
                                pick = candidate;
                            }
                            face += TREELET >> width;
                        }
                        own.lower(COST, best.to_bits());
                    }
                    costs.put(lane, best.to_bits());
                    picks.put(lane, pick);
                });
                // Of equally cheap candidates the lowest number; costs are positive, so bits order as numbers do.
                lanes!(group, |lane| {
                    if costs.at(lane) == own.at(COST) {
                        own.lower(PICK, picks.at(lane));
                    }
                });
            } else {
                lanes!(group, |lane| {
                    if lane == 0 {
                        own.put(PICK, NONE);
                    }
                });
            }
            lanes!(group, |lane| {
                if lane == 0 {
                    let slot = stack.at(at + 8);
                    let pick = own.at(PICK);
                    if pick == NONE {
                        let first = own.at(REFS);
                        scratch.put(base + slot, UVec2::new(mask, (first << 2) | Node::LEAF));
                        own.put(REFS, first + number);
                        own.put(WAITING, own.at(WAITING) - 1);
                        own.raise(DEPTH, depth);
                    } else {
                        let axis = pick / (2 * TREELET);
                        let plane = f32::from_bits(faces.at(pick));
                        let child = nodes + 1;
                        let (word0, word1) = Node::inner(axis, plane, child).words();
                        scratch.put(base + slot, UVec2::new(word0, word1));
                        let (below, above) = (belows.at(pick) & mask, aboves.at(pick) & mask);
                        // The entry itself becomes the child above, cut off below; the child below comes next.
                        push(stack, at + ENTRY, below, lo, hi, depth + 1, child);
                        stack.put(at + ENTRY + 4 + axis, plane.to_bits());
                        stack.put(at, above);
                        stack.put(at + 1 + axis, plane.to_bits());
                        stack.put(at + 7, depth + 1);
                        stack.put(at + 8, child + 1);
                        own.put(WAITING, own.at(WAITING) + 1);
                        own.put(NODES, nodes + 2);
                    }
                }
            });
        }
        lanes!(group, |lane| {
            if lane == 0 {
                sizes.put(group.id, UVec4::new(own.at(NODES), own.at(REFS), own.at(DEPTH), 0));
            }
        });
    }
}

kernel! {
    /// [`treelet`] over all treelets.
    group TREELETS = treelet, threads 32,
        shared [faces: CANDIDATES, belows: CANDIDATES, aboves: CANDIDATES, stack: ENTRIES, costs: LANES,
                picks: LANES, members: LANES, own: OWN], {
        0 params: read BuildParams, 1 state: read u32, 2 treelets: read UVec4, 3 refs: read u32,
        4 boxes: read Vec4, 5 scratch: write UVec2, 6 sizes: write UVec4,
    }
}
