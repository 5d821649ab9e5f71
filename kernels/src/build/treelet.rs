//! Builds the whole subtree of a node of at most 32 references in one workgroup.
//!
//! Exact SAH over the box faces of the references, counted one by one (Zhou et al. 2008, section 3.3, whose
//! boxes stay as they are); boxes that a plane cuts are clipped (Wald & Havran 2006, section 4.3).

use super::{
    Costs, Item, STATE_STATUS, STATE_TREELETS, Sah, ahead,
    clip::clip_plane,
    corners_at,
    faces::{Faces, First, Flat, STEP, cheapest, parted},
    is_above, is_below, place, put_corners,
    reference::{Reference, triangle_at},
    tally::BLOCK,
};
use crate::{
    Group, ON_GPU,
    bounds::Bounds,
    glam::{UVec2, UVec4, Vec3},
    kernel::Bits,
    math::ones,
    mem::{Atomics, Buf, PerLane, Slots},
    mesh::triangle,
};
use raykd_shared::{
    BuildParams, Node,
    limits::{MAX_DEPTH, TREELET, treelet_nodes},
    rule,
};

const LANES: usize = TREELET as usize;
/// Faces of a box: on each axis the low one, then the high one.
const FACES: u32 = 6;

/// Room for the references of nodes that wait to be built; the last node's come last. A split that needs more
/// is not made, nor one that lets more nodes wait: the less memory a workgroup takes, the more of them a GPU
/// runs at once.
const POOL: u32 = 56;
/// From one component of their boxes to the next: four are read at a time, beyond the last, too.
const PITCH: u32 = POOL + 4;
/// Where a reference's number in the treelet stands, behind its box's faces.
const NUMBER: u32 = FACES;
/// Words for their boxes and numbers.
const BOXES: usize = (7 * PITCH) as usize;

/// A reference cut by a plane.
#[derive(Clone, Copy, Default)]
struct Halves {
    /// Box of the part below.
    under: Bounds,
    /// Box of the part above.
    over: Bounds,
    /// Its number in the treelet.
    number: u32,
}

// A node waiting to be built: a word of how many references it has, its slot and its depth, a byte each; and
// its box.
const ENTRY: u32 = 7;
const SLOT: u32 = 8;
const DEEP: u32 = 16;
const BYTE: u32 = 255;
const _: () = assert!(treelet_nodes(TREELET) <= BYTE && MAX_DEPTH <= BYTE, "a byte each");
const MOST_WAITING: u32 = 10;
const ENTRIES: usize = (ENTRY * MOST_WAITING) as usize;

// Words of the workgroup's own state.
const WAITING: u32 = 0;
const NODES: u32 = 1;
const REFS: u32 = 2;
const DEPTH: u32 = 3;
/// How much of the pool is taken.
const HELD: u32 = 4;
// Of the node at hand: its cheapest plane's cost and face, which of its references go below and above, and,
// if it becomes a leaf, their numbers in the treelet.
const COST: u32 = 5;
const PICK: u32 = 6;
const BELOW: u32 = 7;
const ABOVE: u32 = 8;
const MASK: u32 = 9;
/// Whether a box of the treelet may be flat on an axis. A CPU does not ask.
const FLATS: u32 = 10;
const OWN: usize = 11;

/// Whether a lane weighs one face of a member, or both on an axis, for which it reads the boxes of four at a time. A
/// CPU's lane weighs all, eight in a vector.
const BY_MEMBER: bool = ON_GPU;

/// Lanes that weigh a node's candidates.
const WEIGHING: u32 = if BY_MEMBER { TREELET } else { 1 };

/// Lanes that finish a node: one, and those that write the pad.
const FINISHING: u32 = if BY_MEMBER { 4 * FACES } else { 1 };

/// No candidate: the node becomes a leaf.
const NONE: u32 = u32::MAX;

/// The first word of a waiting node.
#[inline(always)]
fn head(number: u32, slot: u32, depth: u32) -> u32 {
    number | (slot << SLOT) | (depth << DEEP)
}

#[inline(always)]
fn push(stack: &mut [u32; ENTRIES], at: u32, head: u32, lo: Vec3, hi: Vec3) {
    stack.put(at, head);
    put_corners(stack, at + 1, lo, hi);
}

/// Puts a reference, `number` in the treelet, to `at` of the pool.
#[inline(always)]
fn put_reference(boxes: &mut [u32; BOXES], at: u32, bounds: &Bounds, number: u32) {
    boxes.put(at, bounds.lo.x.to_bits());
    boxes.put(at + PITCH, bounds.hi.x.to_bits());
    boxes.put(at + 2 * PITCH, bounds.lo.y.to_bits());
    boxes.put(at + 3 * PITCH, bounds.hi.y.to_bits());
    boxes.put(at + 4 * PITCH, bounds.lo.z.to_bits());
    boxes.put(at + 5 * PITCH, bounds.hi.z.to_bits());
    boxes.put(at + NUMBER * PITCH, number);
}

/// The box at `at` of the pool.
#[inline(always)]
fn box_at(boxes: &[u32; BOXES], at: u32) -> Bounds {
    let f = move |boxes: &[u32; BOXES], face: u32| f32::from_bits(boxes.at(at + face * PITCH));
    Bounds {
        lo: Vec3::new(f(boxes, 0), f(boxes, 2), f(boxes, 4)),
        hi: Vec3::new(f(boxes, 1), f(boxes, 3), f(boxes, 5)),
    }
}

/// How many of the `number` references whose low faces on an axis stand at `from` lie below and above each of
/// `planes`. Read four at a time: what may follow them starts and ends nowhere. The counts are floats: a GPU adds those
/// in other units than it compares in, integers in the same.
#[inline(always)]
fn sides<const N: usize>(
    boxes: &[u32; BOXES],
    from: u32,
    number: u32,
    flats: bool,
    planes: [f32; N],
) -> [(f32, f32); N] {
    if flats {
        sides_if::<N, true>(boxes, from, number, planes)
    } else {
        sides_if::<N, false>(boxes, from, number, planes)
    }
}

/// [`sides`], where boxes may be flat or none is: only a flat one does not lie above a plane where it starts.
#[inline(always)]
fn sides_if<const N: usize, const FLATS: bool>(
    boxes: &[u32; BOXES],
    from: u32,
    number: u32,
    planes: [f32; N],
) -> [(f32, f32); N] {
    let mut sides = [(number as f32, 0.0); N];
    let one_if = |holds: bool| if holds { 1.0 } else { 0.0 };
    let mut count = |lo: u32, hi: u32| {
        let (lo, hi) = (f32::from_bits(lo), f32::from_bits(hi));
        let mut at_plane = |k: usize, at: f32| {
            sides[k].0 -= one_if((lo >= at) & (!FLATS | (hi > at)));
            sides[k].1 += one_if(hi > at);
        };
        at_plane(0, planes[0]);
        if N > 1 {
            at_plane(N - 1, planes[N - 1]);
        }
    };
    let mut i = from;
    while i < from + number {
        let (lo, hi) = (boxes.four(i), boxes.four(i + PITCH));
        count(lo[0], hi[0]);
        count(lo[1], hi[1]);
        count(lo[2], hi[2]);
        count(lo[3], hi[3]);
        i += 4;
    }
    sides
}

/// Where the nodes of a treelet lie while it is built: room for [`treelet_nodes`] and its root.
#[inline(always)]
pub fn scratch_base(first: u32, treelet: u32) -> u32 {
    // The sum of `treelet_nodes + 1` over the treelets before it.
    2 * first + 9 * treelet
}

/// Writes what [`sides`] reads beyond the last box: it starts and ends before every plane.
#[inline(always)]
fn put_pad(boxes: &mut [u32; BOXES], lane: u32, top: u32) {
    if BY_MEMBER && lane < FINISHING {
        boxes.put((lane >> 2) * PITCH + top + (lane & 3), f32::NEG_INFINITY.to_bits());
    }
}

/// Whether a box is flat on an axis.
#[inline(always)]
fn is_flat(bounds: &Bounds) -> bool {
    let Bounds { lo, hi } = bounds;
    (lo.x == hi.x) | (lo.y == hi.y) | (lo.z == hi.z)
}

/// Ready for the next node.
#[inline(always)]
fn clear(own: &mut [u32; OWN]) {
    own.put(COST, u32::MAX);
    own.put(PICK, NONE);
    own.put(BELOW, 0);
    own.put(ABOVE, 0);
    own.put(MASK, 0);
}

/// Loads the references of a treelet, and has its root wait. A large leaf of the level loop has nothing to
/// build.
#[inline(always)]
fn start(
    group: Group,
    boxes: &mut [u32; BOXES],
    stack: &mut [u32; ENTRIES],
    own: &mut [u32; OWN],
    item: &Item,
    indices: &Buf<u32>,
    refs: &Buf<UVec4>,
) {
    let small = item.count <= TREELET;
    let members = if small { item.count } else { 0 };
    lanes!(group, ..if members > FINISHING { members } else { FINISHING }, |lane| {
        if lane < members {
            put_reference(boxes, lane, &Reference::load(refs, item.first + lane).bounds, lane);
        }
        if lane == 0 {
            push(stack, 0, head(members, 0, item.extra), item.lo, item.hi);
            own.put(WAITING, small as u32);
            own.put(NODES, 0);
            own.put(REFS, if small { 0 } else { item.count });
            own.put(DEPTH, item.extra);
            own.put(HELD, members);
            own.put(FLATS, 0);
            clear(own);
        }
        put_pad(boxes, lane, members);
    });
    ahead::indices(group, indices, ones(members), |i| triangle_at(refs, item.first + i));
    if BY_MEMBER {
        lanes!(group, ..members, |lane| {
            if is_flat(&box_at(boxes, lane)) {
                own.or(FLATS, 1);
            }
        });
    }
}

/// The node at hand: the last one that waits.
#[derive(Clone, Copy)]
struct Last {
    /// Its entry of the stack.
    at: u32,
    /// Where its references begin in the pool.
    from: u32,
    /// How many references it has.
    number: u32,
}

impl Last {
    #[inline(always)]
    fn of(stack: &[u32; ENTRIES], own: &[u32; OWN]) -> Self {
        let at = (own.at(WAITING) - 1) * ENTRY;
        let number = stack.at(at) & BYTE;
        Self { at, from: own.at(HELD) - number, number }
    }
}

/// The cheapest candidate among the faces that a lane weighs, and its cost; none is as cheap as the leaf.
#[inline(always)]
fn candidate(
    group: &Group,
    boxes: &[u32; BOXES],
    own: &[u32; OWN],
    node: Last,
    sah: &Sah,
    lane: u32,
) -> (f32, u32) {
    if !ON_GPU && !BY_MEMBER {
        return of_all(group, boxes, node, sah);
    }
    let _ = group;
    of_member(boxes, own.at(FLATS) != 0, node, sah, lane)
}

/// [`candidate`] where the lanes share out the faces of few members, or else the pairs of a member and an axis, axis by
/// axis.
#[inline(always)]
fn of_member(boxes: &[u32; BOXES], flats: bool, node: Last, sah: &Sah, lane: u32) -> (f32, u32) {
    let mut best = sah.leaf;
    let mut pick = NONE;
    let mut weigh = |cost: f32, face: u32, member: u32| {
        if cost < best {
            best = cost;
            pick = face * TREELET + member;
        }
    };
    let number = node.number;
    if FACES * number <= TREELET {
        let (member, face) = (lane / FACES, lane % FACES);
        if member < number {
            let across = sah.across(face / 2);
            let at = f32::from_bits(boxes.at(face * PITCH + node.from + member));
            if across.holds(at) {
                let [(below, above)] = sides(boxes, (face & !1) * PITCH + node.from, number, flats, [at]);
                weigh(across.cut(at, below, above), face, member);
            }
        }
        return (best, pick);
    }
    let mut pair = lane;
    while pair < 3 * number {
        let axis = (pair >= number) as u32 + (pair >= 2 * number) as u32;
        let member = pair - axis * number;
        let across = sah.across(axis);
        let first = 2 * axis * PITCH + node.from;
        let low = f32::from_bits(boxes.at(first + member));
        let high = f32::from_bits(boxes.at(first + PITCH + member));
        if across.holds(low) | across.holds(high) {
            let [at_low, at_high] = sides(boxes, first, number, flats, [low, high]);
            weigh(across.cut(low, at_low.0, at_low.1), 2 * axis, member);
            weigh(across.cut(high, at_high.0, at_high.1), 2 * axis + 1, member);
        }
        pair += TREELET;
    }
    (best, pick)
}

/// The low and the high faces of boxes on an axis, of which the low ones stand from `start` on.
#[inline(always)]
fn faces_from(boxes: &[u32; BOXES], start: u32, number: u32) -> Faces<'_> {
    let (start, number) = (start as usize, number.next_multiple_of(STEP) as usize);
    (&boxes[start..start + number], &boxes[start + PITCH as usize..start + PITCH as usize + number])
}

/// [`candidate`] for a lane that weighs all.
#[inline(always)]
fn of_all(group: &Group, boxes: &[u32; BOXES], node: Last, sah: &Sah) -> (f32, u32) {
    let number = node.number;
    let faces = move |boxes, axis: u32| faces_from(boxes, 2 * axis * PITCH + node.from, number);
    let faces = [faces(boxes, 0), faces(boxes, 1), faces(boxes, 2)];
    let across = [sah.across(0), sah.across(1), sah.across(2)];
    let found = cheapest(group.usual, faces, number, &across, Flat::Below, First::Number);
    let (mut best, mut pick) = (sah.leaf, NONE);
    let mut axis = 0;
    while axis < 3 {
        let (cost, face) = found[axis as usize];
        if cost < best {
            let face = face as u32;
            let high = (face >= number) as u32;
            (best, pick) = (cost, (2 * axis + high) * TREELET + face - high * number);
        }
        axis += 1;
    }
    (best, pick)
}

/// Finds the node's cheapest plane.
#[inline(always)]
fn weigh(
    group: Group,
    boxes: &[u32; BOXES],
    own: &mut [u32; OWN],
    picks: &mut PerLane<(u32, u32), LANES>,
    node: Last,
    sah: &Sah,
) {
    lanes!(group, ..WEIGHING, |lane| {
        let (best, pick) = candidate(&group, boxes, own, node, sah, lane);
        if pick != NONE {
            own.lower(COST, best.to_bits());
        }
        picks.put(lane, (best.to_bits(), pick));
    });
    // Of equally cheap candidates the lowest number; costs are positive, so bits order as numbers do.
    lanes!(group, ..WEIGHING, |lane| {
        let (cost, pick) = picks.at(lane);
        if cost == own.at(COST) {
            own.lower(PICK, pick);
        }
    });
}

/// The node's cheapest plane.
#[derive(Clone, Copy)]
struct Cheapest {
    /// Whether there is one.
    found: bool,
    axis: u32,
    /// The bits of its position.
    place: u32,
}

impl Cheapest {
    #[inline(always)]
    fn of(boxes: &[u32; BOXES], own: &[u32; OWN], node: Last) -> Self {
        let pick = own.at(PICK);
        let found = pick != NONE;
        let face = if found { (pick / TREELET) * PITCH + node.from + pick % TREELET } else { 0 };
        Self { found, axis: pick / (2 * TREELET), place: boxes.at(face) }
    }

    #[inline(always)]
    fn at(self) -> f32 {
        f32::from_bits(self.place)
    }
}

/// Finds which of the node's references go below and above, and what is left of each on either side. Theirs
/// is the triangle of reference `first` and those behind.
#[inline(always)]
fn divide(
    group: Group,
    boxes: &[u32; BOXES],
    own: &mut [u32; OWN],
    halves: &mut PerLane<Halves, LANES>,
    node: Last,
    cheapest: Cheapest,
    clips: bool,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<UVec4>,
    first: u32,
) {
    if !ON_GPU && group.sharers() == 1 {
        return divide_all(group, boxes, own, halves, node, cheapest, clips, positions, indices, refs, first);
    }
    let (axis, plane) = (cheapest.axis, cheapest.at());
    lanes!(group, ..node.number, |lane| {
        let bounds = box_at(boxes, node.from + lane);
        let low = f32::from_bits(boxes.at(2 * axis * PITCH + node.from + lane));
        let high = f32::from_bits(boxes.at((2 * axis + 1) * PITCH + node.from + lane));
        let (mut goes_below, mut goes_above) = (is_below(low, high, plane), is_above(high, plane));
        let (mut under, mut over) = (bounds, bounds);
        let number = boxes.at(NUMBER * PITCH + node.from + lane);
        if clips && goes_below && goes_above {
            let (a, b, c) = triangle(positions, indices, triangle_at(refs, first + number));
            (under, over) = clip_plane(a, b, c, &bounds, axis, plane);
            goes_below = !under.is_empty();
            goes_above = !over.is_empty();
            if is_flat(&under) | is_flat(&over) {
                own.or(FLATS, 1);
            }
        }
        halves.put(lane, Halves { under, over, number });
        if goes_below {
            own.or(BELOW, 1 << lane);
        }
        if goes_above {
            own.or(ABOVE, 1 << lane);
        }
    });
}

/// [`divide`] by the one lane of a CPU.
#[inline(always)]
fn divide_all(
    group: Group,
    boxes: &[u32; BOXES],
    own: &mut [u32; OWN],
    halves: &mut PerLane<Halves, LANES>,
    node: Last,
    cheapest: Cheapest,
    clips: bool,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<UVec4>,
    first: u32,
) {
    let (axis, plane) = (cheapest.axis, cheapest.at());
    let row = 2 * axis * PITCH + node.from;
    let (mut belows, mut aboves) =
        parted(group.usual, faces_from(boxes, row, node.number), node.number, plane);
    for i in 0..node.number {
        let (bounds, at) = (box_at(boxes, node.from + i), NUMBER * PITCH + node.from + i);
        halves.put(i, Halves { under: bounds, over: bounds, number: boxes.at(at) });
    }
    let straddling = if clips { belows & aboves } else { 0 };
    ahead::corners(group, positions, indices, straddling, |i| triangle_at(refs, first + halves.at(i).number));
    for i in Bits(straddling) {
        let Halves { under: bounds, number, .. } = halves.at(i);
        let (a, b, c) = triangle(positions, indices, triangle_at(refs, first + number));
        let (under, over) = clip_plane(a, b, c, &bounds, axis, plane);
        halves.put(i, Halves { under, over, number });
        belows &= !((under.is_empty() as u32) << i);
        aboves &= !((over.is_empty() as u32) << i);
    }
    own.put(BELOW, belows);
    own.put(ABOVE, aboves);
}

/// What becomes of the node.
#[derive(Clone, Copy)]
struct Children {
    /// Whether it has any; else it is a leaf.
    splits: bool,
    /// A bit for each of its references that goes below.
    belows: u32,
    /// A bit for each that goes above.
    aboves: u32,
}

impl Children {
    #[inline(always)]
    fn of(own: &[u32; OWN], node: Last, cheapest: Cheapest) -> Self {
        let (belows, aboves) = (own.at(BELOW), own.at(ABOVE));
        let held = node.from + belows.count_ones() + aboves.count_ones();
        Self { splits: cheapest.found && held <= POOL && own.at(WAITING) < MOST_WAITING, belows, aboves }
    }
}

/// Puts the children's references in the place of the node's, those above first; notes a leaf's.
#[inline(always)]
fn replace(
    group: Group,
    boxes: &mut [u32; BOXES],
    own: &mut [u32; OWN],
    halves: &PerLane<Halves, LANES>,
    node: Last,
    children: Children,
) {
    let Children { splits, belows, aboves } = children;
    if !ON_GPU && group.sharers() == 1 && splits {
        for (before, i) in (0..).zip(Bits(aboves)) {
            put_reference(boxes, node.from + before, &halves.at(i).over, halves.at(i).number);
        }
        for (before, i) in (aboves.count_ones()..).zip(Bits(belows)) {
            put_reference(boxes, node.from + before, &halves.at(i).under, halves.at(i).number);
        }
        return;
    }
    lanes!(group, ..node.number, |lane| {
        if splits {
            let Halves { under, over, number } = halves.at(lane);
            if (aboves >> lane) & 1 == 1 {
                put_reference(boxes, node.from + (aboves & ones(lane)).count_ones(), &over, number);
            }
            if (belows >> lane) & 1 == 1 {
                let before = aboves.count_ones() + (belows & ones(lane)).count_ones();
                put_reference(boxes, node.from + before, &under, number);
            }
        } else {
            own.or(MASK, 1 << boxes.at(NUMBER * PITCH + node.from + lane));
        }
    });
}

/// Writes the node to `scratch`, from `base` on, and has its children wait.
#[inline(always)]
fn finish(
    group: Group,
    boxes: &mut [u32; BOXES],
    stack: &mut [u32; ENTRIES],
    own: &mut [u32; OWN],
    node: Last,
    cheapest: Cheapest,
    children: Children,
    scratch: &mut Buf<UVec2>,
    base: u32,
) {
    let at = node.at;
    let (number_below, number_above) = (children.belows.count_ones(), children.aboves.count_ones());
    let held = if children.splits { node.from + number_below + number_above } else { node.from };
    lanes!(group, ..FINISHING, |lane| {
        put_pad(boxes, lane, held);
        if lane == 0 {
            // Read again, or a GPU would keep it in registers until here.
            let (lo, hi) = corners_at(stack, at + 1);
            let (slot, depth) = (stack.at(at) >> SLOT & BYTE, stack.at(at) >> DEEP);
            if children.splits {
                let nodes = own.at(NODES);
                let child = nodes + 1;
                let (word0, word1) = Node::inner(cheapest.axis, cheapest.at(), child).words();
                scratch.put(base + slot, UVec2::new(word0, word1));
                // The entry itself becomes the child above, cut off below; the child below comes next. A child without
                // references is a leaf at once.
                let mut waiting = own.at(WAITING) - 1;
                let empty = UVec2::new(0, (own.at(REFS) << 2) | Node::LEAF);
                if number_above > 0 {
                    stack.put(at, head(number_above, child + 1, depth + 1));
                    stack.put(at + 1 + cheapest.axis, cheapest.place);
                    waiting += 1;
                } else {
                    scratch.put(base + child + 1, empty);
                    own.raise(DEPTH, depth + 1);
                }
                if number_below > 0 {
                    let next = waiting * ENTRY;
                    push(stack, next, head(number_below, child, depth + 1), lo, hi);
                    stack.put(next + 4 + cheapest.axis, cheapest.place);
                    waiting += 1;
                } else {
                    scratch.put(base + child, empty);
                    own.raise(DEPTH, depth + 1);
                }
                own.put(WAITING, waiting);
                own.put(NODES, nodes + 2);
            } else {
                let first = own.at(REFS);
                scratch.put(base + slot, UVec2::new(own.at(MASK), (first << 2) | Node::LEAF));
                own.put(REFS, first + node.number);
                own.put(WAITING, own.at(WAITING) - 1);
                own.raise(DEPTH, depth);
            }
            own.put(HELD, held);
            clear(own);
        }
    });
}

/// Builds treelet `group.id`. Its nodes go to `scratch`, numbered from 0, the root; a leaf is the mask of its
/// references and `local first << 2 | 3`. `sizes` gets nodes without the root and references, and [`place`]'s
/// blocks their sums.
#[inline(always)]
pub fn treelet(
    group: Group,
    boxes: &mut [u32; BOXES],
    stack: &mut [u32; ENTRIES],
    own: &mut [u32; OWN],
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    state: &Buf<u32>,
    treelets: &Buf<UVec4>,
    refs: &Buf<UVec4>,
    scratch: &mut Buf<UVec2>,
    sizes: &mut Buf<UVec2>,
    blocks: &mut Buf<u32>,
) {
    if group.id < state.at(STATE_TREELETS) && state.at(STATE_STATUS) == 0 {
        let rule = params.at(0).rule;
        let item = Item::load(treelets, group.id);
        let base = scratch_base(item.first, group.id);
        let clips = (rule & rule::CLIP) != 0;
        let leaves = (rule & rule::LEAVES) != 0;
        start(group, boxes, stack, own, &item, indices, refs);
        let mut picks = PerLane::<(u32, u32), LANES>::default();
        let mut halves = PerLane::<Halves, LANES>::default();
        while own.at(WAITING) > 0 {
            picks.forget();
            halves.forget();
            let node = Last::of(stack, own);
            let (lo, hi) = corners_at(stack, node.at + 1);
            let sah = Sah::new(lo, hi, node.number, f32::INFINITY, Costs::of(&params.at(0)));
            let may_split = sah.may_pay & !leaves
                && stack.at(node.at) >> DEEP < params.at(0).max_depth
                && own.at(NODES) + 2 <= treelet_nodes(item.count);
            if may_split {
                weigh(group, boxes, own, &mut picks, node, &sah);
            }
            let cheapest = Cheapest::of(boxes, own, node);
            if cheapest.found {
                divide(
                    group,
                    boxes,
                    own,
                    &mut halves,
                    node,
                    cheapest,
                    clips,
                    positions,
                    indices,
                    refs,
                    item.first,
                );
            }
            let children = Children::of(own, node, cheapest);
            replace(group, boxes, own, &halves, node, children);
            finish(group, boxes, stack, own, node, cheapest, children, scratch, base);
        }
        lanes!(group, ..1, |_lane| {
            sizes.put(group.id, UVec2::new(own.at(NODES), own.at(REFS)));
            let block = group.id / BLOCK * place::KINDS;
            blocks.add(block + place::NODES, own.at(NODES));
            blocks.add(block + place::REFS, own.at(REFS));
            blocks.raise(block + place::DEPTH, own.at(DEPTH));
        });
    }
}

kernel! {
    /// [`treelet`] over all treelets.
    group TREELETS = treelet, threads 32,
        shared [boxes: BOXES, stack: ENTRIES, own: OWN], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 state: read u32,
        4 treelets: read UVec4, 5 refs: read UVec4, 6 scratch: write UVec2, 7 sizes: write UVec2,
        8 blocks: write u32,
    }
}
