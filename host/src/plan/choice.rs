//! What there is to choose from.

use crate::{BuildOptions, Builder, Traversal};

/// A kind of tree, or none, and a way through it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Choice {
    /// What it is called.
    pub name: &'static str,
    builder: Builder,
    price: Option<f32>,
    long: Option<u32>,
    depth: Option<u32>,
    /// Boxes instead of a tree.
    wide: bool,
}

const fn choice(name: &'static str, builder: Builder) -> Choice {
    Choice { name, builder, price: None, long: None, depth: None, wide: false }
}

/// Depth of the tree that ends halfway down.
pub(super) const HALFWAY: u32 = 12;

/// Triangles that `stack` tests in one leaf.
const LONG_LEAF: usize = 1 << 15;

/// What there is to choose from: no tree, shallow ones, and those of all builders; small ones too; and the boxes of
/// [`Traversal::Wide`] instead of a tree.
pub const CHOICES: &[Choice] = &[
    Choice { depth: Some(0), ..choice("none", Builder::Median) },
    Choice { depth: Some(6), ..choice("shallow", Builder::Median) },
    Choice { depth: Some(HALFWAY), ..choice("halfway", Builder::Median) },
    choice("median", Builder::Median),
    choice("zhou", Builder::Zhou),
    choice("binned", Builder::Binned),
    Choice { price: Some(40.0), long: Some(64), ..choice("binned-small", Builder::Binned) },
    choice("exact", Builder::Exact),
    Choice { price: Some(40.0), long: Some(64), ..choice("exact-small", Builder::Exact) },
    Choice { depth: Some(0), wide: true, ..choice("wide", Builder::Median) },
];

impl Choice {
    /// The choice of this name.
    pub fn named(name: &str) -> Option<Self> {
        CHOICES.iter().find(|choice| choice.name == name).copied()
    }

    /// For charts: a builder and the price of a reference.
    #[doc(hidden)]
    pub const fn of(name: &'static str, builder: Builder, price: f32) -> Self {
        Self { price: Some(price), ..choice(name, builder) }
    }

    /// How its tree is built.
    pub fn options(&self) -> BuildOptions {
        let usual = BuildOptions::default();
        BuildOptions {
            builder: self.builder,
            price: self.price.unwrap_or(usual.price),
            long: self.long.unwrap_or(usual.long),
            max_depth: self.depth.unwrap_or(usual.max_depth),
            ..usual
        }
    }

    /// Whether all triangles are in one leaf, and tested by every ray.
    pub(crate) const fn tests_all(&self) -> bool {
        matches!(self.depth, Some(0)) && !self.wide
    }

    /// Whether there are boxes instead of a tree, by which closest and any hits are found and by the test `strict`
    /// alone.
    pub const fn is_wide(&self) -> bool {
        self.wide
    }

    /// Whether the tree ends with long leaves halfway down.
    pub(super) fn ends_halfway(&self) -> bool {
        self.depth == Some(HALFWAY)
    }

    /// How rays are traced through a tree of so many triangles, those of [`Mesh::kept`](crate::Mesh::kept): `stack` was
    /// the fastest way through a tree everywhere, and through a single leaf too, but software drivers end its loop if
    /// that is long.
    pub const fn traversal(&self, triangles: usize) -> Traversal {
        if self.wide {
            Traversal::Wide
        } else if self.tests_all() && triangles > LONG_LEAF {
            Traversal::Brute
        } else {
            Traversal::Stack
        }
    }
}
