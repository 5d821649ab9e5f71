//! A whole tree: header, view and checks.

use crate::{Content, Node, limits::MAX_DEPTH};
use bytemuck::{Pod, Zeroable};

/// Version of the layouts in this crate; a file with another one is refused.
pub const LAYOUT_VERSION: u32 = 2;

/// What a tree says about itself: 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TreeHeader {
    /// Lower corner of the root's box, in mesh units times `scale`.
    pub lo: [f32; 3],
    /// Number of nodes, the padding beside the root included; at least 2.
    pub nodes: u32,
    /// Upper corner of the root's box.
    pub hi: [f32; 3],
    /// Number of references.
    pub refs: u32,
    /// Triangles of the mesh; references are below this.
    pub triangles: u32,
    /// Edges from the root to the deepest leaf.
    pub depth: u32,
    /// Power of two that the mesh's coordinates were multiplied by; 1 for all but very small or large scenes.
    pub scale: f32,
    /// SAH cost of one traversal step the tree was built for.
    pub cost_step: f32,
    /// SAH cost of one triangle test the tree was built for.
    pub cost_test: f32,
    /// Digest of the triangles the tree was built of; whoever has them can tell whether the tree is theirs.
    pub mesh: [u32; 2],
    /// [`TreeView::checksum`] of the tree.
    pub checksum: u32,
}

const _: () = assert!(size_of::<TreeHeader>() == 64, "sixteen words");

/// A tree borrowed from wherever its bytes lie: a file, a buffer, another crate.
#[derive(Clone, Copy, Debug)]
pub struct TreeView<'a> {
    /// What the tree says about itself.
    pub header: &'a TreeHeader,
    /// The nodes, root first, then padding, then pairs.
    pub nodes: &'a [Node],
    /// The triangle list of the leaves.
    pub refs: &'a [u32],
}

/// What [`TreeView::validate`] counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Report {
    /// Nodes with two children.
    pub inner: u32,
    /// Leaves, empty ones included.
    pub leaves: u32,
    /// Leaves without a triangle.
    pub empty_leaves: u32,
    /// Longest reference list of a leaf.
    pub largest_leaf: u32,
    /// Edges from the root to the deepest leaf.
    pub depth: u32,
    /// Expected cost of a random ray by the surface area heuristic, with the header's costs
    /// (Wald & Havran 2006, equation 1).
    pub sah_cost: f64,
    /// Expected traversal steps of a random line that meets the root's box.
    pub expected_steps: f64,
    /// Expected triangle tests of such a line.
    pub expected_tests: f64,
}

/// Why a tree is not valid.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Fault {
    /// A length in the header differs from what is there.
    Length,
    /// The header's box, scale or costs are not usable numbers.
    Header,
    /// This node's children lie outside the node list or not in a pair of slots.
    Child(u32),
    /// This node's plane lies outside the node's box.
    Split(u32),
    /// This leaf's range lies outside the reference list.
    Leaf(u32),
    /// This leaf's references do not rise, or name a triangle the mesh does not have.
    Reference(u32),
    /// A leaf lies deeper than the header's depth or [`MAX_DEPTH`]; the node is its parent.
    Depth(u32),
    /// Some nodes or references are reached twice or never.
    Shape,
    /// The tree differs from the one its header was made for.
    Checksum,
}

impl core::fmt::Display for Fault {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Length => write!(f, "the header's counts do not match the data"),
            Self::Header => write!(f, "the header's bounds, scale or costs are not usable"),
            Self::Child(n) => write!(f, "node {n}: its children lie outside the tree or off a pair of slots"),
            Self::Split(n) => write!(f, "node {n}: its plane lies outside its box"),
            Self::Leaf(n) => write!(f, "node {n}: its references lie outside the list"),
            Self::Reference(n) => write!(f, "node {n}: its references do not rise or name no triangle"),
            Self::Depth(n) => write!(f, "node {n}: its children lie too deep"),
            Self::Shape => write!(f, "some nodes or references are reached twice or never"),
            Self::Checksum => write!(f, "its checksum does not match"),
        }
    }
}

impl core::error::Error for Fault {}

/// Half the surface area of a box.
fn half_area(lo: [f32; 3], hi: [f32; 3]) -> f64 {
    let d = [0, 1, 2].map(|a| f64::from(hi[a]) - f64::from(lo[a]));
    d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
}

/// Sets bit `i`; whether it was clear.
fn mark(bits: &mut [u32], i: u32) -> bool {
    let (word, bit) = (&mut bits[i as usize / 32], 1 << (i % 32));
    let clear = *word & bit == 0;
    *word |= bit;
    clear
}

#[derive(Clone, Copy)]
struct Visit {
    node: u32,
    depth: u32,
    lo: [f32; 3],
    hi: [f32; 3],
}

impl TreeView<'_> {
    /// A hash of header, nodes and references. Changing any one word changes it; so, but for one case in
    /// 2^32, does any other change. It tells damage, not malice.
    pub fn checksum(&self) -> u32 {
        let head = TreeHeader { checksum: 0, ..*self.header };
        let head = bytemuck::cast::<TreeHeader, [u32; 16]>(head);
        let nodes = self.nodes.iter().flat_map(|node| <[u32; 2]>::from(node.words()));
        // A step is one to one in the word and in what came before (Fowler, Noll & Vo's hash, on words).
        head.into_iter()
            .chain(nodes)
            .chain(self.refs.iter().copied())
            .fold(0x811C_9DC5, |hash: u32, word| (hash ^ word).wrapping_mul(0x0100_0193).rotate_left(5))
    }

    /// Checks every node and reference, and measures the tree on the way. `Ok` means that the tree is whole
    /// and undamaged, that every pair of nodes and every reference is reached exactly once, and that a
    /// traversal with a stack of `header.depth` entries stays inside the three arrays and ends. What it
    /// cannot tell is whether leaves list the triangles that lie there.
    ///
    /// # Errors
    /// The first [`Fault`] found.
    #[cfg(feature = "alloc")]
    pub fn validate(&self) -> Result<Report, Fault> {
        self.validate_in(&mut alloc::vec![0; self.scratch_words()])
    }

    /// How many words [`Self::validate_in`] needs: a bit for each pair of nodes and each reference.
    pub const fn scratch_words(&self) -> usize {
        self.nodes.len().div_ceil(64) + self.refs.len().div_ceil(32)
    }

    /// [`Self::validate`] where there is no allocator: `scratch` holds [`Self::scratch_words`] words of any
    /// value.
    ///
    /// # Errors
    /// The first [`Fault`] found.
    ///
    /// # Panics
    /// `scratch` is too short.
    pub fn validate_in(&self, scratch: &mut [u32]) -> Result<Report, Fault> {
        scratch.fill(0);
        let (seen_pairs, seen_refs) = scratch.split_at_mut(self.nodes.len().div_ceil(64));
        assert!(seen_refs.len() >= self.refs.len().div_ceil(32), "scratch memory is too short");
        let h = self.header;
        if h.nodes as usize != self.nodes.len() || h.refs as usize != self.refs.len() || h.nodes < 2 {
            return Err(Fault::Length);
        }
        let finite = h.lo.iter().chain(&h.hi).all(|x| x.is_finite());
        let ordered = (0..3).all(|a| h.lo[a] <= h.hi[a]);
        let scaled = h.scale.is_normal() && h.scale > 0.0 && h.scale.to_bits() & 0x007f_ffff == 0;
        let priced =
            h.cost_step.is_finite() && h.cost_test.is_finite() && h.cost_step >= 0.0 && h.cost_test >= 0.0;
        if !finite || !ordered || !scaled || !priced || h.depth > MAX_DEPTH {
            return Err(Fault::Header);
        }
        let root_area = half_area(h.lo, h.hi);
        let root = Visit { node: 0, depth: 0, lo: h.lo, hi: h.hi };
        let mut stack = [root; MAX_DEPTH as usize + 1];
        let mut top = 1;
        let mut report = Report::default();
        // The root and the padding beside it.
        let mut visited = 2u32;
        mark(seen_pairs, 0);
        if self.nodes[1] != Node::PADDING {
            return Err(Fault::Shape);
        }
        let mut listed = 0u32;
        while top > 0 {
            top -= 1;
            let v = stack[top];
            // A box without area is met by no random line, except the root itself.
            let share = if root_area > 0.0 { half_area(v.lo, v.hi) / root_area } else { 1.0 };
            match self.nodes[v.node as usize].content() {
                Content::Leaf { first, count } => {
                    // What an empty leaf names is not looked at.
                    let first = if count == 0 { 0 } else { first };
                    let Some(end) = first.checked_add(count) else { return Err(Fault::Leaf(v.node)) };
                    let Some(refs) = self.refs.get(first as usize..end as usize) else {
                        return Err(Fault::Leaf(v.node));
                    };
                    let rising = refs.windows(2).all(|w| w[0] < w[1]);
                    if !rising || refs.last().is_some_and(|&r| r >= h.triangles) {
                        return Err(Fault::Reference(v.node));
                    }
                    report.leaves += 1;
                    report.empty_leaves += u32::from(count == 0);
                    report.largest_leaf = report.largest_leaf.max(count);
                    report.depth = report.depth.max(v.depth);
                    report.expected_tests += share * f64::from(count);
                    if !(first..end).all(|i| mark(seen_refs, i)) {
                        return Err(Fault::Shape);
                    }
                    listed += count;
                }
                Content::Inner { axis, split, below } => {
                    let axis = axis as usize;
                    if below < 2 || below % 2 != 0 || below >= h.nodes - 1 {
                        return Err(Fault::Child(v.node));
                    }
                    if !(v.lo[axis] <= split && split <= v.hi[axis]) {
                        return Err(Fault::Split(v.node));
                    }
                    if v.depth >= h.depth {
                        return Err(Fault::Depth(v.node));
                    }
                    if !mark(seen_pairs, below / 2) {
                        return Err(Fault::Shape);
                    }
                    visited += 2;
                    report.inner += 1;
                    report.expected_steps += share;
                    let (mut low, mut high) = (v, v);
                    (low.node, low.depth, low.hi[axis]) = (below, v.depth + 1, split);
                    (high.node, high.depth, high.lo[axis]) = (below + 1, v.depth + 1, split);
                    // Depth first, one waiting sibling per edge: depth + 1 entries are enough.
                    stack[top] = high;
                    stack[top + 1] = low;
                    top += 2;
                }
            }
        }
        if visited != h.nodes || listed != h.refs || report.depth != h.depth {
            return Err(Fault::Shape);
        }
        if h.checksum != self.checksum() {
            return Err(Fault::Checksum);
        }
        report.sah_cost =
            f64::from(h.cost_step) * report.expected_steps + f64::from(h.cost_test) * report.expected_tests;
        Ok(report)
    }
}
