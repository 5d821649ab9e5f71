//! Nodes of eight children for the traversal `wide`: a binary hierarchy of boxes from the triangles up (Meister &
//! Bittner 2018, "Parallel locally-ordered clustering for bounding volume hierarchy construction"), of whose nodes
//! those are kept that cost least (Ylitie, Karras & Laine 2017, section 4.3).
//!
//! [`curve`] gives triangles their places on a Morton curve, by which the kernels of [`super::radix`] sort them, and
//! each is a cluster then ([`singles`]). In each round a cluster finds the best of the neighbours within
//! [`nearest::RADIUS`] of it in that order ([`nearest`]); two that find each other become a node ([`merge`]), which is
//! one cluster of the next round ([`advance`]). When few clusters are left, one workgroup goes on ([`finish`]).
//!
//! A node knows what it costs to represent it by at most one to eight wide nodes or slots with triangles. From the root
//! down, level by level, [`open`] finds the children of each wide node and their slots, and [`place`] numbers those
//! that are nodes. [`encode`] then writes all nodes, and the order of the triangles.

pub mod advance;
pub mod curve;
pub mod encode;
pub mod finish;
pub mod merge;
pub mod nearest;
pub mod open;
pub mod place;
pub mod singles;

kernels! {
    /// The kernels that make nodes of eight children, in pipeline order.
    curve::CURVE,
    singles::SINGLES,
    nearest::NEAREST,
    advance::ADVANCE,
    merge::MERGE,
    finish::FINISH,
    open::OPEN,
    place::PLACE,
    encode::ENCODE,
}

use super::{
    from_bits,
    scan::{self, total},
    to_bits,
};
use crate::{
    bounds::Bounds,
    glam::{UVec2, UVec4, Vec3},
    mem::{Buf, Slots, Table},
    put_groups,
};

/// Words for the sums of two kinds, and for blocks of lanes.
const SUMS: usize = scan::sums(2);
const PARTS: usize = scan::blocks(2);

words! {
    /// What is made.
    Job {
        /// Triangles.
        JOB_TRIANGLES triangles: u32,
        /// Twice the lowest corner of the box around them, bits of floats.
        JOB_LO lo: [u32; 3],
        /// Places of the curve along an axis by twice the extent of the box, bits of a float.
        JOB_PLACES places: u32,
    }
}

words! {
    /// How far it is.
    State {
        /// Clusters that are left: there is a root if it is one.
        STATE_CLUSTERS clusters: u32,
        /// Wide nodes of the levels so far.
        STATE_NODES nodes: u32,
        /// Wide nodes of the next level.
        STATE_NEXT next: u32,
    }
}

/// Entries of the indirect arguments with which records begin: a workgroup of [`nearest`] or [`open`] a block.
pub const OVER_BLOCKS: u32 = 0;
/// A lane a cluster, or a wide node of the level.
pub const OVER_ALL: u32 = 1;
/// Words of a record, the arguments first: clusters of a round, wide nodes of a level.
pub const COUNT: u32 = 6;
/// How many of them a block has.
pub const SIZE: u32 = 7;
/// The number of the next node; of the first wide node of a level.
pub const FIRST: u32 = 8;
/// How many records came before.
pub const ROUND: u32 = 9;
/// Words of a record.
pub const RECORD_WORDS: u32 = 10;

/// Lanes of the kernels that are functions of an index.
pub const THREADS: u32 = 128;

/// Extents below `2^-48` count as flat, which keeps sums and differences of areas clear of subnormals.
const FLAT: f32 = crate::math::exp2(-48);

/// Set in a node's word with its shares if by one it is represented by a wide node, not by a slot with triangles.
const IS_NODE: u32 = 1 << 31;
/// Bits of a share.
const SHARE_BITS: u32 = 3;

/// Writes a record of blocks of so many. A few clusters are left to [`finish`].
#[inline(always)]
pub fn record(to: &mut (impl Slots<u32> + ?Sized), count: u32, block: u32, first: u32, round: u32) {
    let many = if block == nearest::BLOCK && count <= block { 0 } else { count };
    put_groups(to, OVER_BLOCKS, many.div_ceil(block));
    put_groups(to, OVER_ALL, many.div_ceil(THREADS));
    to.put(COUNT, count);
    to.put(SIZE, block);
    to.put(FIRST, first);
    to.put(ROUND, round);
}

/// How many there are of a kind of two that are counted.
#[inline(always)]
fn number(parts: &impl Table, kind: u32) -> u32 {
    total(2, parts, kind)
}

/// A node of the binary hierarchy, of which the first are the triangles along the curve.
#[derive(Clone, Copy, Debug)]
pub struct Binary {
    /// Its box.
    pub bounds: Bounds,
    /// How many triangles it has.
    pub count: u32,
    /// How it is represented best by at most two to eight wide nodes or slots with triangles: how many of them its
    /// first child gets, or 0 for as with one less. The highest bit tells whether by one wide node, if by one.
    pub shares: u32,
}

impl Binary {
    /// Reads one.
    #[inline(always)]
    pub fn load(nodes: &Buf<UVec4>, i: u32) -> Self {
        let (lo, hi) = (nodes.at(2 * i), nodes.at(2 * i + 1));
        Self { bounds: Bounds { lo: from_bits(lo), hi: from_bits(hi) }, count: lo.w, shares: hi.w }
    }

    /// Writes one.
    #[inline(always)]
    pub fn store(&self, nodes: &mut Buf<UVec4>, i: u32) {
        nodes.put(2 * i, to_bits(self.bounds.lo, self.count));
        nodes.put(2 * i + 1, to_bits(self.bounds.hi, self.shares));
    }

    /// Whether it is represented by one slot with its triangles, if by one.
    #[inline(always)]
    pub fn is_slot(&self) -> bool {
        (self.shares & IS_NODE) == 0
    }
}

/// What the first child gets of at most `most`, 2 to 8.
#[inline(always)]
fn share(shares: u32, most: u32) -> u32 {
    shares >> ((most - 2) * SHARE_BITS) & ((1 << SHARE_BITS) - 1)
}

/// Half a box's surface.
#[inline(always)]
fn area(a: &Bounds) -> f32 {
    let extent = |lo: f32, hi: f32| if hi - lo < FLAT { 0.0 } else { hi - lo };
    let (x, y, z) = (extent(a.lo.x, a.hi.x), extent(a.lo.y, a.hi.y), extent(a.lo.z, a.hi.z));
    x * y + y * z + z * x
}

/// Twice a box's centre.
#[inline(always)]
fn centre(a: &Bounds) -> Vec3 {
    a.lo + a.hi
}

/// The two children of node `i`, which is no triangle.
#[inline(always)]
fn children_of(children: &Buf<UVec2>, triangles: u32, i: u32) -> UVec2 {
    children.at(i - triangles)
}
