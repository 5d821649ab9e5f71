//! The builder `exact` in kernels: the plane of every node is the cheapest of all faces of its references'
//! boxes, found by a sweep over them in order. Breadth first, in O(N log N) (after Wu, Zhao & Liu 2011), with
//! references clipped at every plane.
//!
//! A level holds cells (its nodes) and their references, cell by cell, triangles rising. In cells of more
//! than [`BuildParams::small`] references, six lists hold the faces of their boxes in order: starts and ends
//! on each axis. All lie where the cell's references lie, so nothing else needs a place of its own. How many
//! references begin before a plane and how many end by it are two binary searches, whichever face the plane
//! comes from; smaller cells count one by one.
//!
//! [`start`] makes the root's lists, which the kernels of [`super::radix`] sort. On each level [`sample`] weighs some
//! faces, [`weigh`] all that these do not rule out, block by block, and [`cheapest`] finds each cell's best plane.
//! [`classify`] says where every reference goes, [`rank`], [`total`] and [`advance`] count, [`children`] makes the next
//! level's cells and [`distribute`] its references. Faces of references that stay whole keep their order ([`carry`]);
//! those of clipped ones are sorted ([`sort`]) and merged in ([`insert`]). In the end [`sizes`] and [`number`] number
//! the nodes depth first, and [`leaves`] lists the references.

pub mod advance;
pub mod carry;
pub mod cheapest;
pub mod children;
pub mod classify;
pub mod distribute;
pub mod insert;
pub mod leaves;
pub mod number;
pub mod rank;
pub mod sample;
pub mod sizes;
pub mod sort;
pub mod start;
pub mod total;
pub mod weigh;

kernels! {
    /// The kernels of `exact`, in pipeline order.
    start::START,
    sort::SORT,
    sample::SAMPLE,
    weigh::WEIGH,
    cheapest::CHEAPEST,
    classify::CLASSIFY,
    rank::RANK,
    total::TOTAL,
    advance::ADVANCE,
    children::CHILDREN,
    distribute::DISTRIBUTE,
    carry::CARRY,
    insert::INSERT,
    sizes::SIZES,
    number::NUMBER,
    leaves::LEAVES,
}

use super::{
    Costs, Sah, SplitPlane,
    bin::{ordered, unordered},
    cut, from_bits,
    reference::Reference,
    scan::LANES,
    to_bits,
};
use crate::{
    bounds::Bounds,
    glam::{UVec2, UVec4},
    math::component,
    mem::{Buf, Slots},
};
use raykd_shared::{BuildParams, Node};

/// Entries of a level's indirect arguments, with which its record begins: a lane per reference.
pub const OVER_REFERENCES: u32 = 0;
/// A lane per cell.
pub const OVER_CELLS: u32 = 1;
/// A workgroup of [`rank`] per block.
pub const OVER_RANKS: u32 = 2;
/// A lane per face in the lists.
pub const OVER_FACES: u32 = 3;
/// A lane per face of the references that were clipped on the way to this level.
pub const OVER_FRESH: u32 = 4;
/// A lane per block of [`weigh`].
pub const OVER_BLOCKS: u32 = 5;
/// A lane per face that [`sample`] weighs.
pub const OVER_SAMPLES: u32 = 6;
/// Words of a level's record, the arguments first: its cells.
pub const LEVEL_CELLS: u32 = 21;
/// Its references.
pub const LEVEL_REFS: u32 = 22;
/// References clipped on the way to it whose faces are sorted in.
pub const LEVEL_FRESH: u32 = 23;
/// Its depth.
pub const LEVEL_DEPTH: u32 = 24;
/// Nodes of the levels above.
pub const LEVEL_NODES: u32 = 25;
/// References of the leaves above.
pub const LEVEL_LEAVES: u32 = 26;
/// How many lists of faces some of its cells may have: all or none.
pub const LEVEL_LISTS: u32 = 27;
/// Words of a level's record.
pub const LEVEL_WORDS: u32 = 28;

words! {
    /// The build's state.
    State {
        /// Status bits, see [`raykd_shared::status`].
        STATE_STATUS status: u32,
        /// Nodes of the levels so far.
        STATE_NODES nodes: u32,
        /// References of their leaves.
        STATE_REFS refs: u32,
        /// Depth of the deepest level.
        STATE_DEPTH depth: u32,
        /// Cells that the level after it takes: if they do not fit, what was missing.
        STATE_CELLS cells: u32,
        /// References, as [`STATE_CELLS`].
        STATE_LEVEL level_refs: u32,
        /// Faces a list, as [`STATE_CELLS`].
        STATE_FRESH fresh: u32,
        /// Whether there are lists in the level after it.
        STATE_LISTS lists: u32,
    }
}

/// Lists of faces: starts and ends on each axis.
pub const LISTS: u32 = 6;
/// Runs that a pass of [`sort`] makes into one, as a power of two.
pub const SORT_BITS: u32 = 4;
/// Candidates of a cell that a pass of [`cheapest`] makes into one, as a power of two.
pub const CHEAPEST_BITS: u32 = 5;
/// Lanes of the kernels that are functions of an index.
pub const THREADS: u32 = 128;

/// Rows that are ranked: references that stay whole, references that are clipped, leaves' references and
/// heads, then faces in their lists.
pub const ROWS: u32 = FACES + LISTS;
const WHOLE: u32 = 0;
const CLIPPED: u32 = 1;
const LEAVES: u32 = 2;
/// The first of the rows of faces.
const FACES: u32 = 3;

// What a reference's code says. Two bits a row: it goes below, above.
const BELOW: u32 = 1;
const ABOVE: u32 = 2;
const CLIPPED_SHIFT: u32 = 2;
/// It is a leaf's.
const LEAF: u32 = 16;
/// It is the first one of a cell that is cut.
const HEAD: u32 = 32;
/// Its cell has lists.
const LISTED: u32 = 64;
/// Its box is cut.
const CUT: u32 = 128;

/// A reference's number in a face's second word; the bit above says of starts that the box is not flat.
const REFERENCE: u32 = (1 << 31) - 1;
const AFTER_FLAT: u32 = 1 << 31;

/// One reference in so many may be clipped on the way to a level, before more room is needed.
pub const FRESH_SHARE: u32 = 4;

/// From one list of faces, or one row of ranks, to the next: as many as there is room for references of a
/// level.
#[inline(always)]
fn room(params: &BuildParams) -> u32 {
    params.level_refs
}

/// Room for the faces of clipped references, a list, where a level has room for so many references.
pub const fn fresh_room(references: u32) -> u32 {
    references / FRESH_SHARE + 64
}

/// Blocks that [`rank`] takes references in, where there is room for so many: one more is ranked, past the
/// last.
pub const fn blocks(references: u32) -> u32 {
    references / LANES + 1
}

/// A node of a level: three words of four.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Where its references start.
    pub first: u32,
    /// How many it has.
    pub count: u32,
    /// Where those that were clipped start in the lists of [`sort`], if it has lists.
    pub fresh: u32,
    /// How many they are.
    pub freshes: u32,
    /// The cell of the level above that it was cut from.
    pub parent: u32,
    /// Its box.
    pub bounds: Bounds,
    /// How many each of its references may become: see [`Costs::most`].
    pub growth: f32,
}

impl Cell {
    /// Elements of a list that one takes.
    pub const ELEMENTS: u32 = 3;

    /// Reads cell `i` of a level.
    #[inline(always)]
    pub fn load(cells: &Buf<UVec4>, i: u32) -> Self {
        let (head, lo, hi) = cells.three(3 * i);
        Self {
            first: head.x,
            count: head.y,
            fresh: head.z,
            freshes: head.w,
            parent: lo.w,
            bounds: Bounds { lo: from_bits(lo), hi: from_bits(hi) },
            growth: f32::from_bits(hi.w),
        }
    }

    /// What planes cost in it.
    #[inline(always)]
    fn sah(&self, params: &BuildParams) -> Sah {
        let (costs, Bounds { lo, hi }) = (Costs::of(params), self.bounds);
        Sah::new(lo, hi, self.count, costs.most(lo, hi, self.count, self.growth), costs)
    }

    /// Writes cell `i` of a level.
    #[inline(always)]
    pub fn store(&self, cells: &mut Buf<UVec4>, i: u32) {
        cells.put(3 * i, UVec4::new(self.first, self.count, self.fresh, self.freshes));
        cells.put(3 * i + 1, to_bits(self.bounds.lo, self.parent));
        cells.put(3 * i + 2, to_bits(self.bounds.hi, self.growth.to_bits()));
    }
}

/// A face of a reference's box as list number `list` holds it.
#[inline(always)]
fn face(bounds: &Bounds, list: u32, number: u32) -> UVec2 {
    let (lo, hi) = (component(bounds.lo, list >> 1), component(bounds.hi, list >> 1));
    let is_end = (list & 1) == 1;
    let kind = if is_end || lo == hi { 0 } else { AFTER_FLAT };
    UVec2::new(ordered(if is_end { hi } else { lo }), kind | number)
}

/// The cell that reference `i` of a level lies in.
#[inline(always)]
fn cell_of(refs: &Buf<UVec4>, i: u32) -> u32 {
    refs.at(2 * i + 1).w
}

/// Whether a face comes before another in its list: by position, then flat boxes first. Those left over are
/// equal.
#[inline(always)]
fn is_before(a: UVec2, b: UVec2) -> bool {
    a.x < b.x || (a.x == b.x && (a.y & AFTER_FLAT) < (b.y & AFTER_FLAT))
}

/// How many of the faces `from..to` come before `face`, and with `equal` how many are equal to it too.
#[inline(always)]
fn count_before(faces: &Buf<UVec2>, from: u32, to: u32, face: UVec2, equal: bool) -> u32 {
    let (mut low, mut high) = (from, to);
    while low < high {
        let middle = low + ((high - low) >> 1);
        let its = faces.at(middle);
        if (equal && !is_before(face, its)) || (!equal && is_before(its, face)) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low - from
}

/// The plane that a cell is cut by, and on which side references go that lie in it.
#[derive(Clone, Copy, Debug)]
pub struct Cutting {
    /// Its axis is [`Node::LEAF`] for none: the cell becomes a leaf.
    pub plane: SplitPlane,
    /// Above, not below.
    pub flat_above: bool,
}

/// A candidate as [`weigh`] writes it: words that order as candidates do. The cheapest comes first, then the
/// lower axis, the lower position, and references in the plane above.
#[inline(always)]
fn candidate(cost: f32, axis: u32, at: u32, flat_above: bool) -> UVec4 {
    // Costs are not negative: their bits order as they do.
    UVec4::new(cost.to_bits(), axis, at, !flat_above as u32)
}

/// No candidate.
const NONE: UVec4 = UVec4::new(f32::INFINITY.to_bits(), Node::LEAF, 0, 0);

/// The better one of two candidates.
#[inline(always)]
fn better(a: UVec4, b: UVec4) -> UVec4 {
    let less =
        b.x < a.x || (b.x == a.x && (b.y < a.y || (b.y == a.y && (b.z < a.z || (b.z == a.z && b.w < a.w)))));
    if less { b } else { a }
}

/// What becomes of a cell, once [`cheapest`] has left its best candidate with its first reference.
#[inline(always)]
fn decide(cell: &Cell, bests: &Buf<UVec4>) -> Cutting {
    let best = if cell.count > 0 { bests.at(cell.first) } else { NONE };
    let plane = SplitPlane { axis: best.y, at: unordered(best.z), pays: best.x != NONE.x };
    Cutting { plane, flat_above: best.w == 0 }
}

/// A box cut by a plane.
#[inline(always)]
fn in_two(bounds: &Bounds, plane: SplitPlane) -> (Bounds, Bounds) {
    let (hi_below, lo_above) = cut(bounds.lo, bounds.hi, plane);
    (Bounds { lo: bounds.lo, hi: hi_below }, Bounds { lo: lo_above, hi: bounds.hi })
}

/// A rank within a block, which is below 256, has room for where the face itself goes: two bits, as in a code.
const SIDES_SHIFT: u32 = 14;
const RANK: u32 = (1 << SIDES_SHIFT) - 1;

/// How many of the first `i` in a row go below, and above.
#[inline(always)]
fn ranked(ranks: &Buf<u32>, totals: &Buf<UVec2>, room: u32, row: u32, i: u32) -> UVec2 {
    let here = ranks.at(row * (room + 1) + i);
    let block = totals.at(row * blocks(room) + i / LANES);
    UVec2::new(block.x + (here & RANK), block.y + (here >> 16))
}

/// Where a face in a row goes itself, as bits of a code.
#[inline(always)]
fn sides_of(ranks: &Buf<u32>, room: u32, row: u32, i: u32) -> u32 {
    (ranks.at(row * (room + 1) + i) & 0xFFFF) >> SIDES_SHIFT
}

#[inline(always)]
fn lesser(a: u32, b: u32) -> u32 {
    if a < b { a } else { b }
}

/// Below, or above.
#[inline(always)]
fn pick(both: UVec2, above: u32) -> u32 {
    if above == 0 { both.x } else { both.y }
}
