//! Builds the whole subtree of a node of at most 32 references in one workgroup, one bit a reference.
//!
//! Exact SAH over the box faces of the references (Zhou et al. 2008, section 3.3): which references lie on
//! either side of each face is found once, as masks; after that counting is a population count.

#[cfg(not(target_arch = "spirv"))]
use super::ahead;
use super::{
    Across, Costs, Item, Plane, STATE_STATUS, STATE_TREELETS, Sah,
    clip::{Bounds, clip},
    cut,
    overlap::overlaps,
};
#[cfg(target_arch = "spirv")]
use super::{is_above, is_below};
#[cfg(not(target_arch = "spirv"))]
use crate::glam::Vec4;
use crate::{
    Group,
    glam::{UVec2, UVec4, Vec3},
    mem::{Atomics, Buf, Slots},
    mesh::triangle,
};
use raykd_shared::{
    BuildParams, Node,
    limits::{MAX_DEPTH, TREELET, treelet_nodes},
    rule,
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
// References that do not reach into the children, though their boxes do.
const DROP_BELOW: u32 = 6;
const DROP_ABOVE: u32 = 7;
const OWN: usize = 8;
/// Coordinates of a triangle.
const CORNERS: usize = LANES * 9;

/// Lanes that find what lies on either side of faces: on a CPU one for each face of a box.
const FACING: u32 = if cfg!(target_arch = "spirv") { TREELET } else { FACES };
/// Lanes that weigh a node's candidates: on a CPU one an axis.
const WEIGHING: u32 = if cfg!(target_arch = "spirv") { TREELET } else { 3 };

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

#[inline(always)]
fn put_face(faces: &mut [u32; CANDIDATES], lane: u32, axis: u32, lo: f32, hi: f32) {
    faces.put((axis * 2) * TREELET + lane, lo.to_bits());
    faces.put((axis * 2 + 1) * TREELET + lane, hi.to_bits());
}

/// Stores a vertex of a lane's triangle.
#[inline(always)]
fn keep(corners: &mut [u32; CORNERS], lane: u32, corner: u32, v: Vec3) {
    let at = corner * 3 * TREELET + lane;
    corners.put(at, v.x.to_bits());
    corners.put(at + TREELET, v.y.to_bits());
    corners.put(at + 2 * TREELET, v.z.to_bits());
}

#[inline(always)]
fn kept(corners: &[u32; CORNERS], lane: u32, corner: u32) -> Vec3 {
    let f =
        move |corners: &[u32; CORNERS], i: u32| f32::from_bits(corners.at(corner * 3 * TREELET + lane + i));
    Vec3::new(f(corners, 0), f(corners, TREELET), f(corners, 2 * TREELET))
}

/// Which of the first `count` references lie below and above a plane at `at`, one bit each, on the axis whose faces
/// stand at `from`.
#[cfg(target_arch = "spirv")]
#[inline(always)]
fn sides(faces: &[u32; CANDIDATES], from: u32, count: u32, at: f32) -> (u32, u32) {
    let (mut below, mut above) = (0, 0);
    let mut i = 0;
    while i < count {
        let lo = f32::from_bits(faces.at(from + i));
        let hi = f32::from_bits(faces.at(from + TREELET + i));
        below |= (is_below(lo, hi, at) as u32) << i;
        above |= (is_above(hi, at) as u32) << i;
        i += 1;
    }
    (below, above)
}

/// The same four references at a time, and which of them start and end there. Bits above `count` may be set, too: they
/// are in no mask.
#[cfg(not(target_arch = "spirv"))]
#[inline(always)]
fn sides(faces: &[u32; CANDIDATES], from: u32, count: u32, at: f32) -> (u32, u32, u32, u32) {
    let (mut below, mut above, mut starts, mut ends) = (0, 0, 0, 0);
    let at = Vec4::splat(at);
    let mut i = 0;
    while i < count {
        let (lo, hi) = (four(faces, from + i), four(faces, from + TREELET + i));
        below |= (lo.cmplt(at) | hi.cmple(at)).bitmask() << i;
        above |= hi.cmpgt(at).bitmask() << i;
        starts |= lo.cmpeq(at).bitmask() << i;
        ends |= hi.cmpeq(at).bitmask() << i;
        i += 4;
    }
    (below, above, starts, ends)
}

/// Which of the first `count` faces that stand at `from` the node holds.
#[cfg(not(target_arch = "spirv"))]
#[inline(always)]
fn held(faces: &[u32; CANDIDATES], from: u32, count: u32, across: &Across) -> u32 {
    let (lo, hi) = (Vec4::splat(across.lo), Vec4::splat(across.hi));
    let mut held = 0;
    let mut i = 0;
    while i < count {
        let at = four(faces, from + i);
        held |= (at.cmpgt(lo) & at.cmplt(hi)).bitmask() << i;
        i += 4;
    }
    held
}

/// Four faces.
#[cfg(not(target_arch = "spirv"))]
#[inline(always)]
fn four(faces: &[u32; CANDIDATES], from: u32) -> Vec4 {
    let from = from as usize;
    let four: [u32; 4] = faces[from..from + 4].try_into().unwrap_or_default();
    Vec4::from_array(four.map(f32::from_bits))
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
#[inline(always)]
pub fn treelet(
    group: Group,
    faces: &mut [u32; CANDIDATES],
    belows: &mut [u32; CANDIDATES],
    aboves: &mut [u32; CANDIDATES],
    stack: &mut [u32; ENTRIES],
    costs: &mut [u32; LANES],
    picks: &mut [u32; LANES],
    #[cfg_attr(not(target_arch = "spirv"), allow(unused_variables, reason = "a CPU goes by bits"))]
    members: &mut [u32; LANES],
    corners: &mut [u32; CORNERS],
    own: &mut [u32; OWN],
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    state: &Buf<u32>,
    treelets: &Buf<UVec4>,
    refs: &Buf<u32>,
    scratch: &mut Buf<UVec2>,
    sizes: &mut Buf<UVec4>,
) {
    if group.id < state.at(STATE_TREELETS) && state.at(STATE_STATUS) == 0 {
        let params = params.at(0);
        let item = Item::load(treelets, group.id);
        let base = scratch_base(item.first, group.id);
        // A large leaf of the level loop has nothing to build.
        let small = item.count <= TREELET;
        let clips = (params.rule & rule::CLIP) != 0;
        #[cfg(not(target_arch = "spirv"))]
        let (mut same_lows, mut same_highs) = ([0; CANDIDATES], [0; CANDIDATES]);
        let leaves = (params.rule & rule::LEAVES) != 0;
        let members_of_root = if small && !leaves { item.count } else { 0 };
        #[cfg(not(target_arch = "spirv"))]
        ahead::triangles(group, positions, indices, ones(members_of_root), |k| refs.at(item.first + k));
        lanes!(group, ..members_of_root, |lane| {
            let id = refs.at(item.first + lane);
            let (a, b, c) = triangle(positions, indices, id);
            keep(corners, lane, 0, a);
            keep(corners, lane, 1, b);
            keep(corners, lane, 2, c);
            let cell = Bounds { lo: item.lo, hi: item.hi };
            let held = if clips { clip(a, b, c, &cell) } else { Bounds::of(a, b, c) };
            put_face(faces, lane, 0, held.lo.x, held.hi.x);
            put_face(faces, lane, 1, held.lo.y, held.hi.y);
            put_face(faces, lane, 2, held.lo.z, held.hi.z);
        });
        lanes!(group, ..FACING, |lane| {
            #[cfg(target_arch = "spirv")]
            if lane < members_of_root {
                let mut face = 0;
                while face < FACES {
                    let candidate = face * TREELET + lane;
                    let at = f32::from_bits(faces.at(candidate));
                    let (below, above) = sides(faces, (face & !1) * TREELET, item.count, at);
                    belows.put(candidate, below);
                    aboves.put(candidate, above);
                    face += 1;
                }
            }
            // Faces in one plane share all.
            #[cfg(not(target_arch = "spirv"))]
            {
                let mut left = ones(members_of_root);
                while left != 0 {
                    let at = f32::from_bits(faces.at(lane * TREELET + left.trailing_zeros()));
                    let (below, above, starts, ends) = sides(faces, (lane & !1) * TREELET, item.count, at);
                    let mut same = left & if lane & 1 == 0 { starts } else { ends };
                    left &= (left - 1) & !same;
                    while same != 0 {
                        let candidate = lane * TREELET + same.trailing_zeros();
                        belows.put(candidate, below);
                        aboves.put(candidate, above);
                        same_lows.put(candidate, starts);
                        same_highs.put(candidate, ends);
                        same &= same - 1;
                    }
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
        while own.at(WAITING) > 0 {
            let at = (own.at(WAITING) - 1) * ENTRY;
            let mask = stack.at(at);
            let (lo, hi) = load_box(stack, at);
            let depth = stack.at(at + 7);
            let number = mask.count_ones();
            let sah = Sah::new(lo, hi, number, Costs::of(&params));
            let nodes = own.at(NODES);
            let may_pay = sah.may_pay && !leaves;
            if may_pay && depth < params.max_depth && nodes + 2 <= treelet_nodes(item.count) {
                lanes!(group, ..WEIGHING, |lane| {
                    #[cfg(target_arch = "spirv")]
                    if (mask >> lane) & 1 == 1 {
                        members.put((mask & ones(lane)).count_ones(), lane);
                    }
                    if lane == 0 {
                        // Just below: only what is cheaper counts.
                        own.put(COST, sah.leaf.to_bits() - 1);
                        own.put(PICK, NONE);
                        own.put(DROP_BELOW, 0);
                        own.put(DROP_ABOVE, 0);
                    }
                });
                lanes!(group, ..WEIGHING, |lane| {
                    let mut best = f32::INFINITY;
                    let mut pick = NONE;
                    let mut weigh = |across: &Across, candidate: u32| {
                        let at = f32::from_bits(faces.at(candidate));
                        if across.holds(at) {
                            let below = (belows.at(candidate) & mask).count_ones();
                            let above = (aboves.at(candidate) & mask).count_ones();
                            let cost = across.cut(at, below, above);
                            if cost < best {
                                best = cost;
                                pick = candidate;
                            }
                        }
                    };
                    // Several faces side by side: as many as members fit the group's width.
                    #[cfg(target_arch = "spirv")]
                    {
                        let width = 32 - (number - 1).leading_zeros();
                        let member = lane & ones(width);
                        if member < number {
                            let member = members.at(member);
                            let mut face = lane >> width;
                            while face < FACES {
                                weigh(&sah.across(face >> 1), face * TREELET + member);
                                face += TREELET >> width;
                            }
                        }
                    }
                    // An axis a lane. Of faces in one plane, which cost the same, the first is enough.
                    #[cfg(not(target_arch = "spirv"))]
                    {
                        let across = sah.across(lane);
                        let (starts, ends) = (2 * lane * TREELET, (2 * lane + 1) * TREELET);
                        let mut lows = mask & held(faces, starts, item.count, &across);
                        let mut highs = mask & held(faces, ends, item.count, &across);
                        while lows != 0 {
                            let candidate = starts + lows.trailing_zeros();
                            weigh(&across, candidate);
                            lows &= (lows - 1) & !same_lows.at(candidate);
                            highs &= !same_highs.at(candidate);
                        }
                        while highs != 0 {
                            let candidate = ends + highs.trailing_zeros();
                            weigh(&across, candidate);
                            highs &= (highs - 1) & !same_highs.at(candidate);
                        }
                    }
                    if pick != NONE {
                        own.lower(COST, best.to_bits());
                    }
                    costs.put(lane, best.to_bits());
                    picks.put(lane, pick);
                });
                // Of equally cheap candidates the lowest number; costs are positive, so bits order as numbers do.
                lanes!(group, ..WEIGHING, |lane| {
                    if costs.at(lane) == own.at(COST) {
                        own.lower(PICK, picks.at(lane));
                    }
                });
                if clips && own.at(PICK) != NONE {
                    lanes!(group, ..item.count, |lane| {
                        let pick = own.at(PICK);
                        let both = belows.at(pick) & aboves.at(pick) & mask;
                        if (both >> lane) & 1 == 1 {
                            let plane =
                                Plane { axis: pick / (2 * TREELET), at: f32::from_bits(faces.at(pick)) };
                            let (hi_below, lo_above) = cut(lo, hi, plane);
                            let (a, b, c) =
                                (kept(corners, lane, 0), kept(corners, lane, 1), kept(corners, lane, 2));
                            if !overlaps(a, b, c, lo, hi_below) {
                                own.or(DROP_BELOW, 1 << lane);
                            }
                            if !overlaps(a, b, c, lo_above, hi) {
                                own.or(DROP_ABOVE, 1 << lane);
                            }
                        }
                    });
                }
            } else {
                lanes!(group, ..1, |_lane| {
                    own.put(PICK, NONE);
                });
            }
            lanes!(group, ..1, |_lane| {
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
                    let below = belows.at(pick) & mask & !own.at(DROP_BELOW);
                    let above = aboves.at(pick) & mask & !own.at(DROP_ABOVE);
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
            });
        }
        lanes!(group, ..1, |_lane| {
            sizes.put(group.id, UVec4::new(own.at(NODES), own.at(REFS), own.at(DEPTH), 0));
        });
    }
}

kernel! {
    /// [`treelet`] over all treelets.
    group TREELETS = treelet, threads 32,
        shared [faces: CANDIDATES, belows: CANDIDATES, aboves: CANDIDATES, stack: ENTRIES, costs: LANES,
                picks: LANES, members: LANES, corners: CORNERS, own: OWN], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 state: read u32,
        4 treelets: read UVec4, 5 refs: read u32, 6 scratch: write UVec2, 7 sizes: write UVec4,
    }
}
