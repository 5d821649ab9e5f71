//! The triangle tests that there are to choose from.

use crate::{Error, Traversal, choices::choices};

choices! {
    /// How it is told whether a ray hits a triangle, and where. [`Intersector::Strict`] keeps raykd's promises, and
    /// [`Intersector::Exact`] more than those; the others are the literature's, with their failures, for comparison.
    pub enum Intersector {
        /// Edge functions with exact signs: no gaps, whatever the tree
        Strict = "strict",
        /// Without rounding: exact hits, `t`, `u` and `v` correctly rounded
        Exact = "exact",
        /// Edge functions of rounded products (Woop, Benthin & Wald 2013)
        Woop = "woop",
        /// Cramer's rule (Möller & Trumbore 1997)
        Moeller = "moeller",
        /// The point in the triangle's plane, then its edges (Snyder & Barr 1987)
        Plane = "plane",
        /// A stored transformation to the unit triangle (Baldwin & Weber 2016)
        Baldwin = "baldwin",
    }
    default = Strict;
}

impl Intersector {
    /// Whether it keeps the contract: the default, and what is more accurate still.
    pub const fn keeps_contract(self) -> bool {
        matches!(self, Self::Strict | Self::Exact)
    }

    /// Whether it goes with a way through the tree: all do with [`Intersector::Strict`], of which none loses a hit.
    ///
    /// # Errors
    /// Another test with a traversal other than `stack` and `brute`.
    pub fn check(self, traversal: Traversal) -> Result<(), Error> {
        match (self, traversal) {
            (Self::Strict, _) | (_, Traversal::Stack | Traversal::Brute) => Ok(()),
            _ => Err(Error::Intersector { name: self.name(), asked: format!("traversal {traversal}") }),
        }
    }
}
