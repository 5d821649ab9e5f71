//! The 8-byte kd-tree node.

use bytemuck::{Pod, Zeroable};

/// One node of the tree, 8 bytes.
///
/// | | word 0 | word 1 |
/// |---|---|---|
/// | inner | bits of the `f32` split position | `below << 2 \| axis`, axis 0, 1 or 2 |
/// | leaf | index of its first reference | `count << 2 \| 3` |
///
/// The two children of an inner node are neighbours: `below` holds what lies at coordinates up to the split,
/// `below + 1` (called above) the rest. `below` is even, so that a pair is one aligned load of 16 bytes; node 0
/// is the root and node 1 is [`Node::PADDING`].
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Node {
    word0: u32,
    word1: u32,
}

/// A node taken apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    /// Space is cut in two.
    Inner {
        /// Axis the plane is perpendicular to: 0 = x, 1 = y, 2 = z.
        axis: u32,
        /// Position of the plane on that axis, in units of the mesh times [`crate::TreeHeader::scale`].
        split: f32,
        /// Index of the child below the plane; the one above follows it.
        below: u32,
    },
    /// `refs[first .. first + count]` lists the triangles here, by rising number.
    Leaf {
        /// Index of the first reference.
        first: u32,
        /// Number of references, 0 for empty space.
        count: u32,
    },
}

impl Node {
    /// The tag in the low two bits of word 1 that marks a leaf.
    pub const LEAF: u32 = 3;

    /// What fills the slot beside the root: an empty leaf that no node points to.
    pub const PADDING: Self = Self::leaf(0, 0);

    /// An inner node.
    #[inline]
    pub const fn inner(axis: u32, split: f32, below: u32) -> Self {
        Self { word0: split.to_bits(), word1: below << 2 | axis }
    }

    /// A leaf.
    #[inline]
    pub const fn leaf(first: u32, count: u32) -> Self {
        Self { word0: first, word1: count << 2 | Self::LEAF }
    }

    /// A node from its two words, as kernels load them.
    #[inline]
    pub const fn from_words(word0: u32, word1: u32) -> Self {
        Self { word0, word1 }
    }

    /// The two words, as kernels store them.
    #[inline]
    pub const fn words(self) -> (u32, u32) {
        (self.word0, self.word1)
    }

    /// Whether this is a leaf.
    #[inline]
    pub const fn is_leaf(self) -> bool {
        self.word1 & 3 == Self::LEAF
    }

    /// Whether this is a leaf without references.
    #[inline]
    pub const fn is_empty(self) -> bool {
        self.word1 == Self::LEAF
    }

    /// Axis of an inner node; 3 for a leaf.
    #[inline]
    pub const fn axis(self) -> u32 {
        self.word1 & 3
    }

    /// Split position of an inner node.
    #[inline]
    pub const fn split(self) -> f32 {
        f32::from_bits(self.word0)
    }

    /// Index of an inner node's child below the plane.
    #[inline]
    pub const fn below(self) -> u32 {
        self.word1 >> 2
    }

    /// First reference of a leaf.
    #[inline]
    pub const fn first(self) -> u32 {
        self.word0
    }

    /// Reference count of a leaf.
    #[inline]
    pub const fn count(self) -> u32 {
        self.word1 >> 2
    }

    /// The node taken apart, for code that prefers a `match`.
    pub const fn content(self) -> Content {
        if self.is_leaf() {
            Content::Leaf { first: self.first(), count: self.count() }
        } else {
            Content::Inner { axis: self.axis(), split: self.split(), below: self.below() }
        }
    }
}

const _: () = assert!(size_of::<Node>() == 8 && align_of::<Node>() == 4, "a node is two words");
