//! The node of eight children that the traversal `wide` goes through.

use bytemuck::{Pod, Zeroable};

/// A node of eight children in 80 bytes, after Ylitie, Karras & Laine 2017, "Efficient incoherent ray traversal on GPUs
/// through compressed wide BVHs", section 4.
///
/// A child is a node, or up to three triangles. Its box has a byte a face: face `f` on axis `a` lies at `lo[a] + f *
/// 2^(exponents[a] - 127)`. Children take the slots 0 to 7 such that those in slots with bit `a` mostly lie above those
/// without along axis `a`. The children that are nodes follow each other from [`first_node`](Self::first_node) on, and
/// the triangles from [`first_triangle`](Self::first_triangle) on, both in the order of their slots.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct WideNode {
    /// Bits of the `f32` coordinates of the lowest corner of all boxes, in units of the mesh times
    /// [`crate::TreeHeader::scale`].
    pub lo: [u32; 3],
    /// The exponent of a face's unit on each axis, 127 more than it is.
    pub exponents: [u8; 3],
    /// A bit for each slot whose child is a node.
    pub inner: u8,
    /// Index of the first child that is a node.
    pub first_node: u32,
    /// Index of the first triangle.
    pub first_triangle: u32,
    /// What is in each slot: [`WideNode::node`], [`WideNode::triangles`], or 0 for nothing.
    pub slots: [u8; 8],
    /// The faces of the children's boxes: the lower ones of x, y and z, then the upper ones.
    pub faces: [[u8; 8]; 6],
}

impl WideNode {
    /// Most triangles in one slot.
    pub const TRIANGLES: u32 = 3;

    /// No wide node lies deeper than this many edges below the root.
    pub const MAX_DEPTH: u32 = 64;

    /// The word of a slot with a node.
    #[inline]
    pub const fn node(slot: u32) -> u8 {
        (1 << 5 | 24 | slot) as u8
    }

    /// The word of a slot with `count` triangles, one to three, behind `first` others of the same node.
    #[inline]
    pub const fn triangles(first: u32, count: u32) -> u8 {
        (((1 << count) - 1) << 5 | first) as u8
    }
}
