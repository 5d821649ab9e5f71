//! The node of eight children that the traversal `wide` goes through.

use bytemuck::{Pod, Zeroable};

/// A node of eight children in 80 bytes, after Ylitie, Karras & Laine 2017, "Efficient incoherent ray traversal on GPUs
/// through compressed wide BVHs", section 4.
///
/// A child is a node, or up to three triangles. Its box has a byte a face: face `f` on axis `a` lies at `lo[a] + f *
/// 2^(exponents[a] - 127)`. Children take the slots 0 to 7 such that those in slots with bit `a` mostly lie above those
/// without along axis `a`. The children that are nodes follow each other from [`first_node`](Self::first_node) on, and
/// the triangles from [`first_triangle`](Self::first_triangle) on, both in the order of their slots. Slot `s` has bits
/// `3 s` to `3 s + 2` of [`nodes`](Self::nodes) and [`triangles`](Self::triangles).
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct WideNode {
    /// Bits of the `f32` coordinates of the lowest corner of all boxes, in units of the mesh times
    /// [`crate::TreeHeader::scale`].
    pub lo: [u32; 3],
    /// The exponent of a face's unit on each axis, 127 more than it is; then 0.
    pub exponents: [u8; 4],
    /// Index of the first child that is a node.
    pub first_node: u32,
    /// Index of the first triangle.
    pub first_triangle: u32,
    /// As many of a slot's bits as it has triangles, from the lowest on.
    pub triangles: u32,
    /// The two lower bits of each slot with a node.
    pub nodes: u32,
    /// The faces of the children's boxes: the lower ones of x, y and z, then the upper ones.
    pub faces: [[u8; 8]; 6],
}

impl WideNode {
    /// Most triangles in one slot.
    pub const TRIANGLES: u32 = 3;

    /// No wide node lies deeper than this many edges below the root.
    pub const MAX_DEPTH: u32 = 64;

    /// The lowest bit of each slot.
    pub const LOWEST: u32 = 0o1111_1111;

    /// The second bit of each slot.
    pub const SECOND: u32 = Self::LOWEST << 1;

    /// The bits in [`nodes`](Self::nodes) of a slot with a node.
    #[inline]
    pub const fn node(slot: u32) -> u32 {
        3 << (3 * slot)
    }

    /// The bits in [`triangles`](Self::triangles) of a slot with up to three triangles.
    #[inline]
    pub const fn triangles(slot: u32, count: u32) -> u32 {
        ((1 << count) - 1) << (3 * slot)
    }
}
