//! Building the tree, in pipeline order.
//!
//! Large nodes are split level by level, every node of a level in parallel: [`bin`] counts the root's references per
//! bin; [`count`] chooses planes by [`split`], and sizes the children; [`tally`] and [`alloc`] give every child its
//! place; [`scatter`] moves the references there, and counts them per bin. Nodes of a few hundred references become
//! branches, each built by one workgroup: by [`branch`], in rounds, to which [`assign`] gives places where [`join`]
//! puts what they become. Nodes of at most 32 references become treelets, each finished by one workgroup, too:
//! [`treelet`] builds, [`place`] gives it its place, [`emit`] writes nodes and references.
//!
//! [`sweep`] is another builder, `exact`, with kernels of its own. [`survey`] comes first if the mesh is on the device.

mod ahead;
pub mod alloc;
pub mod assign;
pub mod bin;
pub mod boxes;
pub mod branch;
pub mod clip;
pub mod count;
pub mod emit;
pub mod faces;
pub mod join;
pub mod marks;
pub mod place;
pub mod radix;
pub mod reference;
mod scan;
pub mod scatter;
pub mod split;
pub mod survey;
pub mod sweep;
pub mod tally;
pub mod top;
pub mod treelet;
pub mod wide;

kernels! {
    /// The kernels of the level loop, in pipeline order.
    boxes::BOXES,
    bin::BIN,
    count::COUNT,
    tally::TALLY,
    alloc::ALLOC,
    scatter::SCATTER,
    branch::BRANCHES,
    assign::ASSIGN,
    join::JOIN,
    treelet::TREELETS,
    place::PLACE,
    top::TOP,
    emit::EMIT,
}

use crate::{
    glam::{UVec2, UVec4, Vec3},
    math::{Number, abs, component, cycle, high, low, ratio},
    mem::{Buf, Slots},
};
use raykd_shared::{
    BuildParams, Node,
    limits::{self, TREELET},
};

words! {
    /// A level's record.
    Level {
        /// Active nodes.
        LEVEL_ACTIVE active: u32,
        /// Workgroups over the level's references.
        LEVEL_CHUNKS chunks: u32,
        /// References in the level's list.
        LEVEL_REFS refs: u32,
        /// Depth of the level's nodes.
        LEVEL_DEPTH depth: u32,
        /// Tree slots given away in the levels above.
        LEVEL_TOP top: u32,
        /// Branches there.
        LEVEL_BRANCHES branches: u32,
        /// Room taken by their references.
        LEVEL_BRANCH_ROOM branch_room: u32,
        /// Whether the lists have room for it.
        LEVEL_FITS fits: u32,
    }
}

words! {
    /// What is done in one round over branches.
    Round {
        /// The first of them.
        ROUND_FROM from: u32,
        /// How many there are.
        ROUND_NUMBER number: u32,
        /// Nodes above branches and treelets so far.
        ROUND_TOP top: u32,
        /// Treelets of earlier rounds.
        ROUND_TREELETS treelets: u32,
        /// Room taken by references of branches so far.
        ROUND_ROOM room: u32,
        /// How many rounds came before.
        ROUND_EARLIER earlier: u32,
        /// Indirect arguments over branches.
        ROUND_GROUPS groups: [u32; 3],
        /// Indirect arguments over blocks of treelets.
        ROUND_BLOCKS blocks: [u32; 3],
    }
}

/// Among the words of a round, the entry with the indirect arguments over its branches.
pub const ARGS_BRANCHES: u32 = ROUND_GROUPS / 3;
/// That over blocks of treelets.
pub const ARGS_TREELET_BLOCKS: u32 = ARGS_BRANCHES + 1;

words! {
    /// The build's state.
    State {
        /// Status bits, see [`raykd_shared::status`].
        STATE_STATUS status: u32,
        /// Nodes above the treelets.
        STATE_TOP top: u32,
        /// Treelets, single large leaves included.
        STATE_TREELETS treelets: u32,
        /// Rounds over branches.
        STATE_ROUNDS rounds: u32,
        /// Nodes of the whole tree.
        STATE_NODES nodes: u32,
        /// References of the whole tree.
        STATE_REFS refs: u32,
        /// Depth of the deepest leaf.
        STATE_DEPTH depth: u32,
        /// Active nodes that the level loop left, or branches that the rounds did.
        STATE_LEFT left: u32,
        /// Levels of large nodes.
        STATE_LEVELS levels: u32,
        /// Indirect arguments over treelets, of which there are none before no active node and no branch is left.
        STATE_GROUPS groups: [u32; 3],
        /// Indirect arguments of what writes the tree out, of which there are none before it is known to have the room.
        STATE_OUT out: [[u32; 3]; 3],
        /// How many nodes and references there is room for.
        STATE_ROOM room: [u32; 2],
    }
}

impl State {
    /// Whether what writes the tree out had the room to.
    pub const fn is_written(&self) -> bool {
        self.out[(ARGS_EMIT - ARGS_TOP) as usize][0] > 0
    }
}

/// Among the words of the state, the entry with the indirect arguments over treelets.
pub const ARGS_TREELETS: u32 = STATE_GROUPS / 3;
/// That over the nodes above the treelets, once the tree is to be written.
pub const ARGS_TOP: u32 = STATE_OUT / 3;
/// That over treelets.
pub const ARGS_EMIT: u32 = ARGS_TOP + 1;
/// That over references.
pub const ARGS_CORNERS: u32 = ARGS_TOP + 2;
const _: () = assert!(
    3 * ARGS_TREELETS == STATE_GROUPS && 3 * ARGS_TOP == STATE_OUT && 3 * ARGS_BRANCHES == ROUND_GROUPS,
    "arguments begin at a multiple of three words"
);

/// Entries of the indirect arguments of a level: a workgroup per active node.
pub const ARGS_ACTIVE: u32 = 0;
/// A workgroup per chunk.
pub const ARGS_CHUNKS: u32 = 1;
/// A workgroup per block of active nodes.
pub const ARGS_BLOCKS: u32 = 2;
/// Words of the indirect arguments of a level.
pub const ARGS_WORDS: u32 = 9;

/// Extents below `2^-60` count as flat: areas stay clear of subnormals, and nothing is split there.
const FLAT: f32 = crate::math::exp2(-60);

/// What part of its price a reference has in a long node: without any, nodes around a vertex that many
/// triangles share are cut again and again, as deep as the tree may be.
const LONG: f32 = crate::math::exp2(-7);

/// No reference costs more tests of the rays through its own node than this in a long one, or in another one
/// than it could save there. Without that limit nothing pays in an object that is a millionth of the scene: a
/// price is for rays through the scene.
const DEAREST: f32 = 0.5;
/// The least that it is in others.
const DEAREST_SHORT: u32 = 16;

/// Larger nodes are not split where they are thinner than this part of the scene, on every axis: traversal
/// counts planes as thicker than a dozen such nodes, so a ray that enters one would visit all leaves in it.
const THIN: f32 = crate::math::exp2(-24);

/// Nodes longer than so many times [`Costs::long`] may be cut by [`Sah::middle`].
const MUCH_LONGER: u32 = 4;

/// A plane that does not pay takes so many times the growth of another one.
const DEAR: f32 = 2.0;

/// Of what each reference of a node may become, what is left to its children's: its `count` became `now`.
#[inline(always)]
pub fn growth_left(growth: f32, count: u32, now: u32, pays: bool) -> f32 {
    // Without references any number will do, but NaN is not the same bits on every device.
    let now = if now == 0 { 1 } else { now };
    ratio(growth * count as f32, now as f32 * if pays { 1.0 } else { DEAR })
}

/// A node or treelet in a list: three words of four.
#[derive(Clone, Copy, Debug)]
pub struct Item {
    /// Its slot in the tree.
    pub node: u32,
    /// Where its references start.
    pub first: u32,
    /// How many it has.
    pub count: u32,
    /// Active node: its first chunk. Treelet: its depth.
    pub extra: u32,
    /// Lower corner of its box.
    pub lo: Vec3,
    /// Upper corner of its box.
    pub hi: Vec3,
    /// How many each of its references may become: see [`Costs::most`].
    pub growth: f32,
}

impl Item {
    /// Elements of a list that one takes.
    pub const ELEMENTS: u32 = 3;

    /// Reads item `i` of a list.
    #[inline(always)]
    pub fn load(list: &Buf<UVec4>, i: u32) -> Self {
        let (head, lo, hi) = (list.at(3 * i), list.at(3 * i + 1), list.at(3 * i + 2));
        Self {
            node: head.x,
            first: head.y,
            count: head.z,
            extra: head.w,
            lo: from_bits(lo),
            hi: from_bits(hi),
            growth: f32::from_bits(lo.w),
        }
    }

    /// Writes item `i` of a list.
    #[inline(always)]
    pub fn store(&self, list: &mut Buf<UVec4>, i: u32) {
        list.put(3 * i, UVec4::new(self.node, self.first, self.count, self.extra));
        list.put(3 * i + 1, to_bits(self.lo, self.growth.to_bits()));
        list.put(3 * i + 2, to_bits(self.hi, 0));
    }
}

/// What workgroup `chunk` of a level works on, in a mesh of so many `references`: its node's number, the node, and the
/// range of references.
#[inline(always)]
pub fn chunk_of(
    chunk: u32,
    references: u32,
    chunks: &Buf<u32>,
    active: &Buf<UVec4>,
) -> (u32, Item, u32, u32) {
    let size = limits::chunk(references);
    let node = chunks.at(chunk);
    let item = Item::load(active, node);
    let from = (chunk - item.extra) * size;
    let rest = item.count - from;
    (node, item, item.first + from, if rest < size { rest } else { size })
}

/// The plane of active node `node`.
#[inline(always)]
pub fn plane_of(planes: &Buf<UVec2>, node: u32) -> SplitPlane {
    SplitPlane::from_words(planes.at(node))
}

#[inline(always)]
fn from_bits(v: UVec4) -> Vec3 {
    Vec3::new(f32::from_bits(v.x), f32::from_bits(v.y), f32::from_bits(v.z))
}

/// The bits of a vector, and one more word.
#[inline(always)]
pub fn to_bits(v: Vec3, last: u32) -> UVec4 {
    UVec4::new(v.x.to_bits(), v.y.to_bits(), v.z.to_bits(), last)
}

/// Puts the corners of a box to six words of a workgroup's memory.
#[inline(always)]
fn put_corners(words: &mut impl Slots<u32>, at: u32, lo: Vec3, hi: Vec3) {
    words.put(at, lo.x.to_bits());
    words.put(at + 1, lo.y.to_bits());
    words.put(at + 2, lo.z.to_bits());
    words.put(at + 3, hi.x.to_bits());
    words.put(at + 4, hi.y.to_bits());
    words.put(at + 5, hi.z.to_bits());
}

/// What [`put_corners`] put there.
#[inline(always)]
fn corners_at(words: &impl Slots<u32>, at: u32) -> (Vec3, Vec3) {
    let f = |i: u32| f32::from_bits(words.at(at + i));
    (Vec3::new(f(0), f(1), f(2)), Vec3::new(f(3), f(4), f(5)))
}

/// A plane that cuts a node.
#[derive(Clone, Copy, Debug)]
pub struct SplitPlane {
    /// Axis it is perpendicular to, or [`Node::LEAF`] for none: the node becomes a leaf.
    pub axis: u32,
    /// Its position.
    pub at: f32,
    /// Whether it makes the node cheaper: see [`Sah::middle`].
    pub pays: bool,
}

/// Of a plane's first word, the bits that tell its axis; others say that it does not pay.
const AXIS: u32 = 3;

impl SplitPlane {
    /// None.
    pub const LEAF: Self = Self { axis: Node::LEAF, at: 0.0, pays: true };

    #[inline(always)]
    fn from_words(words: UVec2) -> Self {
        Self { axis: words.x & AXIS, at: f32::from_bits(words.y), pays: words.x <= AXIS }
    }

    /// As it stands in a list.
    #[inline(always)]
    pub fn words(&self) -> UVec2 {
        UVec2::new(self.axis | if self.pays { 0 } else { AXIS + 1 }, self.at.to_bits())
    }
}

/// Whether a reference with this extent belongs below the plane. One that lies in the plane does, and not
/// above.
#[inline(always)]
pub fn is_below(lo: f32, hi: f32, at: f32) -> bool {
    (lo < at) | (hi <= at)
}

/// Whether a reference with this extent belongs above the plane.
#[inline(always)]
pub fn is_above(hi: f32, at: f32) -> bool {
    hi > at
}

/// Whether a reference with this extent belongs below the plane, and whether above, where one that lies in
/// the plane goes to a side of choice. What touches the plane from one side is on that side only.
#[inline(always)]
pub fn sides(lo: f32, hi: f32, at: f32, flat_above: bool) -> (bool, bool) {
    let flat = (lo == at) & (hi == at);
    ((lo < at) | (flat & !flat_above), (hi > at) | (flat & flat_above))
}

/// A node's box cut by a plane: the boxes of the children.
#[inline(always)]
pub fn cut(lo: Vec3, hi: Vec3, plane: SplitPlane) -> (Vec3, Vec3) {
    (with(hi, plane.axis, plane.at), with(lo, plane.axis, plane.at))
}

/// The vector with another component on `axis`.
#[inline(always)]
fn with(v: Vec3, axis: u32, value: f32) -> Vec3 {
    if axis == 0 {
        Vec3::new(value, v.y, v.z)
    } else if axis == 1 {
        Vec3::new(v.x, value, v.z)
    } else {
        Vec3::new(v.x, v.y, value)
    }
}

/// What the surface area heuristic weighs.
#[derive(Clone, Copy, Debug)]
pub struct Costs {
    /// Of a traversal step.
    pub step: f32,
    /// Of a triangle test.
    pub test: f32,
    /// Of a reference, whoever passes: see [`BuildParams::price`].
    pub price: f32,
    /// But in nodes of more references than this they have hardly any: a long leaf holds up all rays of a
    /// warp, more than its area tells.
    pub long: u32,
    /// Factor on planes that cut off empty space (Wald & Havran 2006, section 3.1), if they pay without it.
    pub empty: f32,
    /// Extent under which large nodes are not split.
    pub thin: f32,
}

/// Number of the longest axis.
#[inline(always)]
fn longest_axis(d: Vec3) -> u32 {
    if d.x >= d.y && d.x >= d.z {
        0
    } else if d.y >= d.z {
        1
    } else {
        2
    }
}

/// The longest of three extents.
#[inline(always)]
fn longest(d: Vec3) -> f32 {
    high(d.x, high(d.y, d.z))
}

impl Costs {
    /// Those of a build.
    #[inline(always)]
    pub fn of(params: &BuildParams) -> Self {
        Self {
            step: params.cost_step,
            test: params.cost_test,
            price: params.price,
            long: params.long,
            empty: params.empty,
            thin: longest(Vec3::from_array(params.hi) - Vec3::from_array(params.lo)) * THIN,
        }
    }

    /// How many references the children of a node may have together. Treelets need no such limit, as their
    /// memory is bounded. In larger nodes each reference may become `growth`, of which [`growth_left`] tells
    /// what is left to the children's: so many of the root's stay few, whatever the triangles, and what part
    /// of them cannot be parted does not take it from the rest.
    #[inline(always)]
    pub fn most(&self, lo: Vec3, hi: Vec3, count: u32, growth: f32) -> f32 {
        if count <= TREELET {
            f32::INFINITY
        } else if longest(hi - lo) < self.thin {
            -1.0
        } else {
            high(count as f32, growth * count as f32)
        }
    }
}

/// The surface area heuristic in one node, with costs that scale with area (Wald & Havran 2006, equation 5).
#[derive(Clone, Copy, Debug)]
pub struct Sah {
    lo: Vec3,
    hi: Vec3,
    costs: Costs,
    /// Half the node's surface area.
    area: f32,
    /// References that children may have.
    most: f32,
    /// Cost of the node as a leaf.
    pub leaf: f32,
    /// Whether any plane may be cheaper: one costs a step, and no reference less.
    pub may_pay: bool,
}

/// An extent, 0 if flat.
#[inline(always)]
fn flat(d: f32) -> f32 {
    if abs(d) < FLAT { 0.0 } else { d }
}

impl Sah {
    /// For a node of `count` references, whose children may have `most`.
    #[inline(always)]
    pub fn new(lo: Vec3, hi: Vec3, count: u32, most: f32, costs: Costs) -> Self {
        let d = hi - lo;
        let (x, y, z) = (flat(d.x), flat(d.y), flat(d.z));
        let area = x * y + y * z + z * x;
        let one = area * costs.test;
        let price = if count > costs.long {
            low(costs.price * LONG, one * DEAREST)
        } else {
            let most = if costs.long > DEAREST_SHORT { costs.long } else { DEAREST_SHORT };
            low(costs.price, one * most as f32)
        };
        let costs = Costs { price, ..costs };
        let tests = area * count as f32 * costs.test;
        Self {
            lo,
            hi,
            costs,
            area,
            most,
            leaf: tests + count as f32 * costs.price,
            may_pay: (tests > area * costs.step) & (most >= 0.0),
        }
    }

    /// The plane that cuts a long node though none pays, if any does: the middle of its longest axis. Several
    /// planes may pay together, as those that cut a bundle of diagonal sticks: the first leaves all on both
    /// sides, and empty space on each. It is dear, as it may be in vain.
    #[inline(always)]
    pub fn middle(&self, count: u32) -> SplitPlane {
        let axis = longest_axis(self.hi - self.lo);
        let (lo, hi) = (component(self.lo, axis), component(self.hi, axis));
        let at = lo + (hi - lo) * 0.5;
        let is_long = (count > TREELET) & (count / MUCH_LONGER > self.costs.long);
        let may = is_long & (2.0 * DEAR * count as f32 <= self.most) & self.across(axis).holds(at);
        if may { SplitPlane { axis, at, pays: false } } else { SplitPlane::LEAF }
    }

    /// What planes across `axis` cost.
    #[inline(always)]
    pub fn across(&self, axis: u32) -> Across {
        let (lo, hi) = (cycle(self.lo, axis), cycle(self.hi, axis));
        let (b, c) = (flat(hi.x - lo.x), flat(hi.y - lo.y));
        Across {
            lo: lo.z,
            hi: hi.z,
            girth: b + c,
            cap: b * c,
            step: self.costs.step * self.area,
            costs: self.costs,
            most: self.most,
            leaf: self.leaf,
        }
    }
}

/// Takes a number apart into a row of `length`, of no more than so many rows, and a place in it.
#[inline(always)]
fn row_of(i: u32, length: u32, rows: u32) -> (u32, u32) {
    let (mut row, mut rest) = (0, i);
    while rest >= length && row < rows {
        rest -= length;
        row += 1;
    }
    (row, rest)
}

/// The surface area heuristic across one axis of a node.
#[derive(Clone, Copy, Debug)]
pub struct Across {
    lo: f32,
    hi: f32,
    /// Half the circumference of the node's section, and the section's area.
    girth: f32,
    cap: f32,
    step: f32,
    costs: Costs,
    most: f32,
    leaf: f32,
}

impl Across {
    /// Whether a plane at `at` lies strictly inside. Most faces of what a node holds do not.
    #[inline(always)]
    pub fn holds<N: Number>(&self, at: N) -> N::Mask {
        // Nothing lies inside where it is flat.
        let hi = if self.hi - self.lo >= FLAT { self.hi } else { self.lo };
        at.exceeds(N::all(self.lo)) & N::all(hi).exceeds(at)
    }

    /// Cost of a cut at `at` into children of so many references; infinite unless [`Across::holds`] it, and
    /// they may be so many.
    #[inline(always)]
    pub fn cut<N: Number>(&self, at: N, below: N, above: N) -> N {
        let all = N::all;
        let cost = self.least(at, at, below, above);
        let pays = (below.is(all(0.0)) | above.is(all(0.0))) & all(self.leaf).exceeds(cost);
        let cost = cost * N::choose(pays, all(self.costs.empty), all(1.0));
        let may = self.holds(at) & !(below + above).exceeds(all(self.most));
        N::choose(may, cost, all(f32::INFINITY))
    }

    /// What a cut between `from` and `to`, which leaves at least so many references below and above, costs at
    /// least if neither is none. Rounding keeps the order of numbers, so it is no more than [`Across::cut`]
    /// says.
    #[inline(always)]
    pub fn least<N: Number>(&self, from: N, to: N, below: N, above: N) -> N {
        let all = N::all;
        let flat = |d: N| N::choose(all(FLAT).exceeds(d), all(0.0), d);
        let area_below = flat(from - all(self.lo)) * all(self.girth) + all(self.cap);
        let area_above = flat(all(self.hi) - to) * all(self.girth) + all(self.cap);
        let test = all(self.costs.test);
        all(self.step)
            + (area_below * below * test + area_above * above * test)
            + (below + above) * all(self.costs.price)
    }
}
