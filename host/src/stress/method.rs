//! Ways to answer rays.

use super::{Part, Rule, textbook::Textbook};
use crate::{BuildOptions, Builder, Device, Error, Hit, Intersector, KdTree, Mesh, Query, Scene, Traversal};

/// How triangles are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Way {
    /// Every triangle is tested.
    Brute,
    /// A tree and a way through it.
    Tree(Builder, Traversal),
    /// The default tree and way, but for the triangle that the ray leaves.
    Except,
    /// A form that was published, with its faults; on the CPU only.
    Textbook(Textbook),
}

/// A way to answer rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Method {
    /// The triangle test.
    pub test: Intersector,
    /// How triangles are found.
    pub way: Way,
}

/// raykd's default builder and traversal.
const USUAL: Way = Way::Tree(Builder::Binned, Traversal::Stack);

impl Method {
    /// A triangle test and a way.
    pub const fn new(test: Intersector, way: Way) -> Self {
        Self { test, way }
    }

    /// All of them, raykd's default first.
    pub fn all() -> Vec<Self> {
        let usual = |way| Self { test: Intersector::Strict, way };
        let others = Builder::ALL.iter().copied().filter(|&builder| builder != Builder::Binned);
        let ways =
            Traversal::ALL.iter().copied().filter(|t| !matches!(t, Traversal::Stack | Traversal::Brute));
        let mut all: Vec<Self> = Intersector::ALL
            .iter()
            .flat_map(|&test| [USUAL, Way::Brute].map(|way| Self { test, way }))
            .collect();
        all.extend(others.map(|builder| usual(Way::Tree(builder, Traversal::Stack))));
        all.extend(ways.map(|traversal| usual(Way::Tree(Builder::Binned, traversal))));
        all.push(usual(Way::Except));
        all.extend(Textbook::ALL.iter().copied().map(|textbook| usual(Way::Textbook(textbook))));
        all
    }

    /// Its name: the triangle test and the way, and the builder if it is not the default.
    pub fn name(&self) -> String {
        let test = self.test.name();
        match self.way {
            Way::Brute => format!("{test}/brute"),
            Way::Tree(Builder::Binned, traversal) => format!("{test}/{traversal}"),
            Way::Tree(builder, traversal) => format!("{test}/{traversal}/{}", builder.name()),
            Way::Except => format!("{test}-except/stack"),
            Way::Textbook(textbook) => format!("textbook/{}", textbook.name()),
        }
    }

    /// Whether its answers must be those of brute force.
    pub(super) const fn judges_tree(&self) -> bool {
        !matches!(self.way, Way::Brute | Way::Except | Way::Textbook(Textbook::Fused))
    }

    /// Brute force with the same triangle test.
    pub(super) const fn by_brute_force(self) -> Self {
        Self { way: Way::Brute, ..self }
    }

    /// Whether any default tree will do: its own build is no part of what the method shows.
    pub(super) fn takes_a_tree(&self) -> bool {
        matches!(self.way, Way::Brute | Way::Except | Way::Tree(Builder::Binned, _) | Way::Textbook(_))
            && self.way != USUAL
            || self.test != Intersector::Strict
    }

    /// The scene of a mesh as the method traces it, its tree built on the device if none is given.
    ///
    /// # Errors
    /// The mesh does not fit the device, or the device failed.
    pub fn scene(&self, device: &Device, mesh: &Mesh, tree: Option<&KdTree>) -> Result<Scene, Error> {
        let (builder, traversal) = match self.way {
            Way::Brute => (Builder::Binned, Traversal::Brute),
            Way::Tree(builder, traversal) => (builder, traversal),
            Way::Except | Way::Textbook(_) => (Builder::Binned, Traversal::Stack),
        };
        let mut scene = match tree {
            Some(tree) => Scene::with_tree(device, mesh, tree)?,
            None => Scene::build(device, mesh, &BuildOptions { builder, ..BuildOptions::default() })?,
        };
        scene.traverse_by(traversal)?;
        scene.intersect_by(self.test)?;
        Ok(scene)
    }

    /// The closest hits of a part's rays.
    pub(super) fn closest(
        &self,
        device: &Device,
        part: &Part,
        tree: Option<&KdTree>,
    ) -> Result<Vec<Hit>, Error> {
        let scene = self.scene(device, &part.mesh, tree)?;
        match (self.way, &part.rule) {
            (Way::Textbook(textbook), _) => {
                Ok(textbook.closest(&part.mesh, scene.tree()?.view(), &part.rays))
            }
            (Way::Except, Rule::Leaves(from)) => {
                Ok(scene.trace_except(Query::Closest, &part.rays, from)?.hits)
            }
            _ => scene.closest(&part.rays),
        }
    }
}
