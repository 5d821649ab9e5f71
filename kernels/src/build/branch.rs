//! Builds a branch, the subtree of a node of at most [`BRANCH`] references, down to its treelets in one workgroup: what
//! [`super::bin`], [`super::count`] and [`super::scatter`] do level by level for larger nodes.
//!
//! The references of a branch, and of the treelets it becomes, have a room of their own, see [`room`]. Those of nodes
//! that wait stand at its end, the last node's first; those of treelets at its beginning. Where they would not fit, or
//! too many nodes wait, the rest is left to another round, in which each such node is a branch.

use super::{
    ARGS_BRANCHES, ARGS_TREELET_BLOCKS, Item, ROUND_EARLIER, ROUND_FROM, ROUND_NUMBER, ROUND_ROOM, ROUND_TOP,
    ROUND_TREELETS, STATE_STATUS, SplitPlane, ahead,
    bin::{TABLE, fill_in_order},
    clip::sides_of_halves,
    corners_at, cut, growth_left,
    marks::{BLOCKS, Marks, WORDS, scan, sides_of},
    put_corners,
    reference::{Reference, Words},
    split::{FOUND, WEIGHING, chosen, find},
    tally::blocks_of,
};
use crate::{
    Group,
    bounds::Bounds,
    glam::{UVec2, UVec4},
    kernel::Bits,
    mem::{Atomics, Buf, PerLane, Slots, scratch},
    put_groups,
};
use raykd_shared::{
    BuildParams, Node,
    limits::{BRANCH, MAX_DEPTH, MOST_CHUNK},
    rule,
};

const LANES: u32 = 128;
const _: () = assert!(
    BRANCH <= MOST_CHUNK && BRANCH == 2 * LANES,
    "a branch has the marks of a chunk, a lane two references"
);
const _: () = assert!(WEIGHING <= LANES, "every border is weighed");

/// References for which there is room in the place of one item that a branch becomes.
pub const SHARE: u32 = 4;
/// And what is left beside twice the references of a branch: small ones grow by more.
const SPARE: u32 = 32;
/// How often the room is doubled, every second round.
const MOST_DOUBLED: u32 = 3;

/// Room for the references of a branch of `count`, and of the treelets it becomes, in the round after so many `earlier`
/// ones: what did not fit before grows by more. It is enough for one split at least.
#[inline(always)]
pub const fn room(count: u32, small: u32, earlier: u32) -> u32 {
    let grows = count > small && count <= BRANCH;
    let doubled = earlier / 2;
    let times = 2 << if doubled < MOST_DOUBLED { doubled } else { MOST_DOUBLED };
    let room = if grows {
        times * count + SPARE
    } else if count == 0 {
        1
    } else {
        count
    };
    room.div_ceil(SHARE) * SHARE
}

/// Where the room of a branch begins: its references come last there.
#[inline(always)]
pub const fn begin(branch: &Item, room: u32) -> u32 {
    branch.first + branch.count - room
}

/// Room in the list of branches, if there is room for so many treelets.
#[inline(always)]
pub const fn branches(treelets: u32) -> u32 {
    treelets / 2
}

/// A round to come.
#[derive(Clone, Copy, Debug)]
pub struct Next {
    /// How many rounds come before it.
    pub earlier: u32,
    /// Number of its first branch.
    pub from: u32,
    /// Number of its branches.
    pub number: u32,
    /// Nodes above branches and treelets so far.
    pub top: u32,
    /// Treelets so far.
    pub treelets: u32,
    /// Room taken by references so far.
    pub room: u32,
}

/// Notes what comes next.
#[inline(always)]
pub fn put_round(round: &mut Buf<u32>, next: Next) {
    round.put(ROUND_EARLIER, next.earlier);
    round.put(ROUND_FROM, next.from);
    round.put(ROUND_NUMBER, next.number);
    round.put(ROUND_TOP, next.top);
    round.put(ROUND_TREELETS, next.treelets);
    round.put(ROUND_ROOM, next.room);
    put_groups(round, ARGS_BRANCHES, next.number);
    put_groups(round, ARGS_TREELET_BLOCKS, blocks_of(next.treelets));
}

// A node waiting to be split: a word of how many references it has, its slot and its depth; the growth left to it; and
// its box.
const ENTRY: u32 = 8;
const SLOT: u32 = 10;
const DEEP: u32 = 26;
const COUNT: u32 = (1 << SLOT) - 1;
const SLOTS: u32 = (1 << (DEEP - SLOT)) - 1;
const _: () = assert!(
    BRANCH <= COUNT && 2 * room(BRANCH, 0, 2 * MOST_DOUBLED) / SHARE <= SLOTS && MAX_DEPTH < 1 << (32 - DEEP),
    "there are bits enough"
);
const MOST_WAITING: u32 = 12;
/// Splits in a round: while one workgroup goes on for long, others have nothing to do.
const MOST_SPLITS: u32 = 64;
const ENTRIES: usize = (ENTRY * MOST_WAITING) as usize;

// Words of the workgroup's own state.
const WAITING: u32 = 0;
/// Where the references of the last node that waits begin.
const LAST: u32 = 1;
/// Where the next treelet's go.
const FREE: u32 = 2;
const ITEMS: u32 = 3;
const SPLITS: u32 = 4;
/// Whether the rest is left to another round.
const STOPPED: u32 = 5;
const OWN: usize = 6;

/// A node that waits, as an item: its slot in the branch, its references and its depth.
#[inline(always)]
fn waiting(stack: &[u32; ENTRIES], at: u32, first: u32) -> Item {
    let at = at * ENTRY;
    let head = stack.at(at);
    let (node, count, extra) = (head >> SLOT & SLOTS, head & COUNT, head >> DEEP);
    let (lo, hi) = corners_at(stack, at + 2);
    Item { node, first, count, extra, lo, hi, growth: f32::from_bits(stack.at(at + 1)) }
}

/// The node that is split next.
#[inline(always)]
fn next_node(stack: &[u32; ENTRIES], own: &[u32; OWN]) -> Item {
    waiting(stack, own.at(WAITING) - 1, own.at(LAST))
}

#[inline(always)]
fn push(stack: &mut [u32; ENTRIES], at: u32, item: &Item) {
    let at = at * ENTRY;
    stack.put(at, item.count | item.node << SLOT | item.extra << DEEP);
    stack.put(at + 1, item.growth.to_bits());
    put_corners(stack, at + 2, item.lo, item.hi);
}

/// Where the children of the node at hand go.
#[derive(Clone, Copy)]
struct Children {
    plane: SplitPlane,
    below: u32,
    above: u32,
    /// Where their references go.
    first_below: u32,
    first_above: u32,
    /// Whether they wait to be split.
    below_waits: bool,
    above_waits: bool,
    /// Whether the one above is next.
    above_is_next: bool,
    /// Where the references of the next node begin.
    last: u32,
    /// Whether there is room for them.
    fit: bool,
}

impl Children {
    #[inline(always)]
    fn of(
        own: &[u32; OWN],
        node: &Item,
        plane: SplitPlane,
        (below, above): (u32, u32),
        small: u32,
        items: u32,
    ) -> Self {
        let is_leaf = plane.axis == Node::LEAF;
        let below_waits = !is_leaf && below > small;
        let above_waits = above > small;
        let if_waits = |waits: bool, count: u32| if waits { count } else { 0 };
        let (waiting_below, waiting_above) = (if_waits(below_waits, below), if_waits(above_waits, above));
        let free = own.at(FREE);
        let end = node.first + node.count;
        let done_below = below - waiting_below;
        let done = free + done_below + above - waiting_above;
        let waiting = own.at(WAITING) - 1 + below_waits as u32 + above_waits as u32;
        // One item each for what is done and what waits.
        let all = own.at(ITEMS) + own.at(WAITING) + !is_leaf as u32;
        let fit = (done + waiting_below + waiting_above <= end) & (waiting <= MOST_WAITING) & (all <= items);
        let last = if fit { end - waiting_above - waiting_below } else { free };
        // The smaller of two that wait is next, so few wait; its references come first.
        let above_is_next = above_waits & (!below_waits | (above < below));
        let first_below =
            if below_waits { last + if above_is_next { waiting_above } else { 0 } } else { free };
        let if_last = if above_is_next { last } else { last + waiting_below };
        let first_above = if above_waits { if_last } else { free + done_below };
        Self {
            plane,
            below,
            above,
            first_below,
            first_above,
            below_waits,
            above_waits,
            above_is_next,
            last,
            fit,
        }
    }
}

/// A reference of the node at hand, on either side of the plane.
#[derive(Clone, Copy, Default)]
struct Halves {
    /// Box of the part below.
    under: Bounds,
    /// Box of the part above.
    over: Bounds,
    triangle: u32,
    /// Bit 0: something goes below, bit 1: something goes above.
    sides: u32,
}

impl Halves {
    #[inline(always)]
    fn of(
        positions: &Buf<f32>,
        indices: &Buf<u32>,
        whole: &Reference,
        plane: SplitPlane,
        clips: bool,
    ) -> Self {
        let Reference { bounds, triangle, .. } = *whole;
        let mut sides = whole.sides(plane);
        let (mut under, mut over) = (bounds, bounds);
        if clips && sides == 3 {
            (under, over) = whole.halves(positions, indices, plane);
            sides = sides_of_halves(&under, &over);
        }
        Self { under, over, triangle, sides }
    }
}

/// What each lane holds of a node: every 128th reference, from its own number on.
type Held = PerLane<[Halves; 2], { LANES as usize }>;

/// Most references of a node.
const MOST: usize = BRANCH as usize;

/// Lanes that hold any of `count` references.
#[inline(always)]
const fn holders(count: u32) -> u32 {
    if count < LANES { count } else { LANES }
}

/// Divides the references of the node at hand, and marks where they go.
#[inline(always)]
fn divide(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    held: &mut Held,
    words: &mut [Words; MOST],
    node: &Item,
    plane: SplitPlane,
    clips: bool,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<UVec4>,
) {
    #[cfg(not(target_arch = "spirv"))]
    if group.sharers() == 1 {
        return divide_words(
            group, belows, aboves, held, words, node, plane, clips, positions, indices, refs,
        );
    }
    let _ = words;
    lanes!(group, ..node.count.div_ceil(32), |word| {
        belows.put(word, 0);
        aboves.put(word, 0);
    });
    lanes!(group, ..holders(node.count), |lane| {
        let mut both = [Halves::default(); 2];
        let reference = Reference::load(refs, node.first + lane);
        both[0] = Halves::of(positions, indices, &reference, plane, clips);
        belows.mark(lane / 32, (both[0].sides & 1) << (lane % 32));
        aboves.mark(lane / 32, (both[0].sides >> 1) << (lane % 32));
        let other = lane + LANES;
        if other < node.count {
            let reference = Reference::load(refs, node.first + other);
            both[1] = Halves::of(positions, indices, &reference, plane, clips);
            belows.mark(other / 32, (both[1].sides & 1) << (other % 32));
            aboves.mark(other / 32, (both[1].sides >> 1) << (other % 32));
        }
        held.put(lane, both);
    });
}

/// [`divide`] on a CPU, whose one lane takes the references by words of marks. Only of what goes both ways it holds
/// halves; of the others all, or what clipping has left, stands in `words`.
#[cfg(not(target_arch = "spirv"))]
#[inline(always)]
fn divide_words(
    group: Group,
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    held: &mut Held,
    words: &mut [Words; MOST],
    node: &Item,
    plane: SplitPlane,
    clips: bool,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &Buf<UVec4>,
) {
    let mut i = 0;
    while i < node.count {
        let (below, above) = sides_of(refs, node.first + i, node.count - i, plane);
        belows.put(i / 32, below);
        aboves.put(i / 32, above);
        for at in i..if node.count < i + 32 { node.count } else { i + 32 } {
            words.put(at, Words::load(refs, node.first + at));
        }
        if clips {
            ahead::indices(group, indices, below & above, |k| words.at(i + k).lo.w);
        }
        i += 32;
    }
    if !clips {
        return;
    }
    i = 0;
    while i < node.count {
        let (mut below, mut above) = (belows.at(i / 32), aboves.at(i / 32));
        ahead::corners(group, positions, indices, below & above, |k| words.at(i + k).lo.w);
        for k in Bits(below & above) {
            let whole = words.at(i + k).read();
            let (under, over) = whole.halves(positions, indices, plane);
            let sides = sides_of_halves(&under, &over);
            if sides != 3 {
                words
                    .put(i + k, Reference { bounds: if sides == 2 { over } else { under }, ..whole }.words());
            }
            *held.one(i + k) = Halves { under, over, triangle: whole.triangle, sides };
            below &= !((!sides & 1) << k);
            above &= !((!sides >> 1 & 1) << k);
        }
        belows.put(i / 32, below);
        aboves.put(i / 32, above);
        i += 32;
    }
}

/// Moves the references of the node at hand to its children's places, which may be among those of the node's own.
#[inline(always)]
fn replace(
    group: Group,
    held: &mut Held,
    words: &[Words; MOST],
    node: &Item,
    children: Children,
    clips: bool,
    marks: Marks,
    refs: &mut Buf<UVec4>,
) {
    let (first_below, first_above) = (children.first_below, children.first_above);
    #[cfg(not(target_arch = "spirv"))]
    if group.sharers() == 1 {
        for first in (0..node.count).step_by(32) {
            let (below, above) = (marks.belows.at(first / 32), marks.aboves.at(first / 32));
            let straddling = if clips { below & above } else { 0 };
            for i in Bits(below & !straddling).map(|k| first + k) {
                words.at(i).store(refs, first_below + marks.below_before(i));
            }
            for i in Bits(above & !straddling).map(|k| first + k) {
                words.at(i).store(refs, first_above + marks.above_before(i));
            }
            for i in Bits(straddling).map(|k| first + k) {
                let Halves { under, over, triangle, .. } = *held.one(i);
                let half = |bounds| Reference { triangle, cell: 0, bounds };
                half(under).store(refs, first_below + marks.below_before(i));
                half(over).store(refs, first_above + marks.above_before(i));
            }
        }
        return;
    }
    let _ = (words, clips);
    let put = move |refs: &mut Buf<UVec4>, marks: Marks, at: u32, halves: Halves| {
        let Halves { under, over, triangle, sides } = halves;
        if sides & 1 != 0 {
            let reference = Reference { triangle, cell: 0, bounds: under };
            reference.store(refs, first_below + marks.below_before(at));
        }
        if sides & 2 != 0 {
            let reference = Reference { triangle, cell: 0, bounds: over };
            reference.store(refs, first_above + marks.above_before(at));
        }
    };
    lanes!(group, ..holders(node.count), |lane| {
        let [first, other] = held.at(lane);
        put(refs, marks, lane, first);
        if lane + LANES < node.count {
            put(refs, marks, lane + LANES, other);
        }
    });
    group.meet_at_buffers();
}

/// Notes the node at hand, and has its children wait or become treelets.
#[inline(always)]
fn finish(
    group: Group,
    stack: &mut [u32; ENTRIES],
    own: &mut [u32; OWN],
    children: Children,
    base: u32,
    items: &mut Buf<UVec4>,
    nodes: &mut Buf<UVec2>,
) {
    lanes!(group, ..1, |_lane| {
        // Read again: kept, it would take registers, which limit occupancy.
        let node = next_node(stack, own);
        let mut waiting = own.at(WAITING) - 1;
        let mut item = own.at(ITEMS);
        let (splits, mut free) = (own.at(SPLITS), own.at(FREE));
        let Children { plane, below, above, first_below, first_above, below_waits, above_waits, .. } =
            children;
        if plane.axis == Node::LEAF {
            Item { first: first_below, ..node }.store(items, base + item);
            item += 1;
            free += below;
        } else {
            let slot = 1 + 2 * splits;
            let (word0, word1) = Node::inner(plane.axis, plane.at, slot).words();
            nodes.put(2 * base + node.node, UVec2::new(word0, word1));
            let growth = growth_left(node.growth, node.count, below + above, plane.pays);
            let (hi_below, lo_above) = cut(node.lo, node.hi, plane);
            let child = Item { extra: node.extra + 1, growth, ..node };
            let child_below = Item { node: slot, first: first_below, count: below, hi: hi_below, ..child };
            let child_above =
                Item { node: slot + 1, first: first_above, count: above, lo: lo_above, ..child };
            if !below_waits {
                child_below.store(items, base + item);
                item += 1;
                free += below;
            }
            if !above_waits {
                child_above.store(items, base + item);
                item += 1;
                free += above;
            }
            // The next one comes last.
            if above_waits && !children.above_is_next {
                push(stack, waiting, &child_above);
                waiting += 1;
            }
            if below_waits {
                push(stack, waiting, &child_below);
                waiting += 1;
            }
            if children.above_is_next {
                push(stack, waiting, &child_above);
                waiting += 1;
            }
            own.put(SPLITS, splits + 1);
            own.put(STOPPED, (splits + 1 == MOST_SPLITS) as u32);
        }
        own.put(WAITING, waiting);
        own.put(LAST, children.last);
        own.put(FREE, free);
        own.put(ITEMS, item);
    });
}

/// Builds branch `group.id` of the round. What it becomes, treelets and then what is left, goes to `items`, its nodes
/// to `nodes`, numbered from 0, the root; `sizes` gets how many items are treelets, how many splits there are, how many
/// items are left, and the room for their references.
#[inline(always)]
pub fn branch(
    group: Group,
    table: &mut [u32; TABLE],
    rate: &mut [u32; 3],
    found: &mut [u32; FOUND],
    belows: &mut [u32; WORDS],
    aboves: &mut [u32; WORDS],
    sums: &mut [u32; WORDS],
    blocks: &mut [u32; BLOCKS],
    stack: &mut [u32; ENTRIES],
    own: &mut [u32; OWN],
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    state: &Buf<u32>,
    round: &Buf<u32>,
    branches: &Buf<UVec4>,
    refs: &mut Buf<UVec4>,
    items: &mut Buf<UVec4>,
    nodes: &mut Buf<UVec2>,
    sizes: &mut Buf<UVec4>,
) {
    if group.id < round.at(ROUND_NUMBER) && state.at(STATE_STATUS) == 0 {
        let params = params.at(0);
        let small = params.small;
        let clips = (params.rule & rule::CLIP) != 0;
        let earlier = round.at(ROUND_EARLIER);
        let branch = Item::load(branches, round.at(ROUND_FROM) + group.id);
        let room_here = room(branch.count, small, earlier);
        let begin = begin(&branch, room_here);
        let base = begin / SHARE;
        let grows = branch.count > small && branch.count <= BRANCH;
        lanes!(group, ..1, |_lane| {
            own.put(WAITING, grows as u32);
            own.put(LAST, branch.first);
            own.put(FREE, begin);
            own.put(ITEMS, !grows as u32);
            own.put(SPLITS, 0);
            own.put(STOPPED, 0);
            let root = Item { node: 0, ..branch };
            if grows {
                push(stack, 0, &root);
            } else {
                root.store(items, base);
            }
        });
        let mut held = Held::default();
        let mut words = scratch::<Words, MOST>();
        while own.at(WAITING) > 0 && own.at(STOPPED) == 0 {
            held.forget();
            let node = next_node(stack, own);
            let (first, count) = (node.first, node.count);
            fill_in_order(group, table, rate, &node, refs, first, count);
            find(group, table, found, &params, node.extra, &node);
            let plane = chosen(found);
            divide(
                group, belows, aboves, &mut held, &mut words, &node, plane, clips, positions, indices, refs,
            );
            scan(group, belows, aboves, sums, blocks, count.div_ceil(32));
            let marks = Marks { belows, aboves, sums };
            let children = Children::of(own, &node, plane, marks.counts(count), small, room_here / SHARE);
            if children.fit {
                replace(group, &mut held, &words, &node, children, clips, marks, refs);
                finish(group, stack, own, children, base, items, nodes);
            } else {
                lanes!(group, ..1, |_lane| {
                    own.put(STOPPED, 1);
                });
            }
        }
        lanes!(group, ..1, |_lane| {
            let (left, item) = (own.at(WAITING), own.at(ITEMS));
            let (mut first, mut room_left) = (own.at(LAST), 0);
            let mut i = 0;
            while i < left {
                let node = waiting(stack, left - 1 - i, first);
                node.store(items, base + item + i);
                first += node.count;
                room_left += room(node.count, small, earlier + 1);
                i += 1;
            }
            sizes.put(group.id, UVec4::new(item, own.at(SPLITS), left, room_left));
        });
    }
}

kernel! {
    /// [`branch`] over all branches of a round.
    group BRANCHES = branch, threads 128, shared [
        table: TABLE, rate: 3, found: FOUND, belows: WORDS, aboves: WORDS, sums: WORDS, blocks: BLOCKS, stack: ENTRIES,
        own: OWN
    ], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 state: read u32, 4 round: read u32,
        5 branches: read UVec4, 6 refs: write UVec4, 7 items: write UVec4, 8 nodes: write UVec2, 9 sizes: write UVec4,
    }
}
