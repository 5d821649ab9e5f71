//! The way from the root to a node, a bit a level (after Laine 2010, "Restart trail for stackless BVH
//! traversal").
//!
//! Traversals that keep no stack need to know what is behind them. Comparing `t` with what was left last
//! cannot tell: planes are thick, so intervals overlap, and even where they do not, `t + epsilon == t` for a
//! large `t`. The leaves of a ray have an order, near before far at every node, and a trail names a leaf's
//! place in it.

use raykd_shared::limits::MAX_DEPTH;

const _: () = assert!(MAX_DEPTH <= 64, "a trail is 64 bits");

/// Bits are set on levels where the far child was taken; those below the node's own level are 0.
#[derive(Clone, Copy, Debug)]
pub struct Trail {
    upper: u32,
    lower: u32,
}

impl Trail {
    /// At the root.
    pub const ROOT: Self = Self { upper: 0, lower: 0 };

    /// Whether it takes the far child of the node on `level`.
    #[inline(always)]
    pub fn is_far(self, level: u32) -> bool {
        let word = if level < 32 { self.upper } else { self.lower };
        (word >> (level & 31)) & 1 != 0
    }

    /// The same way down to the node on `level`, then its far child.
    #[inline(always)]
    pub fn turned(self, level: u32) -> Self {
        let bit = 1 << (level & 31);
        if level < 32 {
            Self { upper: (self.upper & (bit - 1)) | bit, lower: 0 }
        } else {
            Self { upper: self.upper, lower: (self.lower & (bit - 1)) | bit }
        }
    }
}
