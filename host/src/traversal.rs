//! The ways through the tree that there are to choose from.

use crate::choices::choices;
use raykd_kernels::trace::traverse::{backtrack, pushdown, restart, ropes, sequential, shortstack};
use raykd_shared::limits::MAX_DEPTH;

choices! {
    /// How rays find their way through the tree. All find the same hits, bit by bit.
    /// [`Traversal::Stack`] is the first, [`Traversal::Brute`] the last.
    pub enum Traversal {
        /// A full stack: the fastest
        Stack = "stack",
        /// Restarts at the root after every leaf (Foley & Sugerman 2005)
        Restart = "restart",
        /// Restarts at the lowest node that holds the rest of the ray (Horn et al. 2007)
        Pushdown = "pushdown",
        /// A stack of 1 entry, restarts when it is empty (Horn et al. 2007)
        ShortStack1 = "shortstack1",
        /// A stack of 2 entries
        ShortStack2 = "shortstack2",
        /// A stack of 4 entries
        ShortStack4 = "shortstack4",
        /// A stack of 8 entries
        ShortStack8 = "shortstack8",
        /// Climbs by parents and boxes (Foley & Sugerman 2005)
        Backtrack = "backtrack",
        /// Ropes from leaf to leaf (Popov et al. 2007)
        Ropes = "ropes",
        /// Ropes pulled down as far as they go (Popov et al. 2007)
        OptimisedRopes = "optimised-ropes",
        /// Locates every leaf from the root (Kaplan 1985)
        Sequential = "sequential",
        /// No tree: tests every triangle
        Brute = "brute",
    }
    default = Stack;
}

/// What a traversal needs on the device beside the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Needs {
    Nothing,
    Boxes,
    Ropes { optimised: bool },
}

impl Traversal {
    /// Bytes that a ray keeps between two leaves, beside the best hit.
    pub const fn state_bytes(self) -> u32 {
        match self {
            // Sixteen bytes an entry, and how many there are.
            Self::Stack => 16 * MAX_DEPTH + 4,
            Self::Restart => restart::STATE,
            Self::Pushdown => pushdown::STATE,
            Self::ShortStack1 => shortstack::state(1),
            Self::ShortStack2 => shortstack::state(2),
            Self::ShortStack4 => shortstack::state(4),
            Self::ShortStack8 => shortstack::state(8),
            Self::Backtrack => backtrack::STATE,
            Self::Ropes | Self::OptimisedRopes => ropes::STATE,
            Self::Sequential => sequential::STATE,
            Self::Brute => 0,
        }
    }

    pub(crate) const fn needs(self) -> Needs {
        match self {
            Self::Backtrack => Needs::Boxes,
            Self::Ropes => Needs::Ropes { optimised: false },
            Self::OptimisedRopes => Needs::Ropes { optimised: true },
            _ => Needs::Nothing,
        }
    }
}
