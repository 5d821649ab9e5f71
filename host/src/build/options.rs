//! The options of a build.

use super::built::Facts;
use crate::{Error, choices::choices};
use raykd_shared::{
    limits::{MAX_DEPTH, TREELET},
    rule,
};

choices! {
    /// How the planes of a tree are chosen; the cheapest first.
    pub enum Builder {
        /// Empty space cut off, else the middle of the longest axis, down to 8 references: the cheap baseline
        Median = "median",
        /// As median above 32 references and as binned below (Zhou et al. 2008, who go over at 64)
        Zhou = "zhou",
        /// Surface area heuristic, over 32 bins an axis above 32 references (Shevtsov et al. 2007) and all box faces
        /// below
        Binned = "binned",
        /// Surface area heuristic over all box faces, with boxes clipped at every plane (Wald & Havran 2006; on a GPU
        /// after Wu et al. 2011)
        Exact = "exact",
    }
    default = Binned;
    called = "builder";
}

impl Builder {
    pub(super) fn rule(self) -> u32 {
        match self {
            Self::Median => rule::MEDIAN | rule::LEAVES,
            Self::Binned | Self::Exact => 0,
            Self::Zhou => rule::MEDIAN,
        }
    }

    /// References at which a node leaves the level loop.
    pub(super) fn small(self) -> u32 {
        if self == Self::Median { 8 } else { TREELET }
    }
}

/// Options of a build: the default ones, of which methods change some.
///
/// ```
/// use raykd::{BuildOptions, Builder};
///
/// let options = BuildOptions::default().with_builder(Builder::Exact).with_max_depth(20);
/// assert_eq!((options.builder, options.max_depth), (Builder::Exact, 20));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct BuildOptions {
    /// SAH cost of one traversal step, from 0 to [`Self::MAX_COST`]; default 1.
    pub cost_step: f32,
    /// SAH cost of one triangle test, from 0 to [`Self::MAX_COST`]; default 1.
    pub cost_test: f32,
    /// Price of a reference, from 0 to [`Self::MAX_COST`]; default 5: the tests that it must save a ray through the
    /// scene, times the number of triangles. 0 takes every split that saves anything; more makes trees smaller where
    /// that costs least. It is at most what a ray through the node can save, and half a test in nodes of more than
    /// `long` references, so that small objects in large scenes are split, too.
    pub price: f32,
    /// In nodes of more references than this, a reference costs 2^-7 of `price`, as long leaves hold up the rays
    /// beside; default 16.
    pub long: u32,
    /// Most references a triangle, on average, at least 1; default none. `price` and `long` are doubled until the
    /// tree keeps to it. A scene that needs more gets slow. [`Builder::Median`] weighs no costs, [`Builder::Zhou`]
    /// none in large nodes: they may not keep to it.
    pub budget: Option<f32>,
    /// Factor on the cost of planes that cut off empty space, from 0 to 1; default 0.9.
    pub empty: f32,
    /// Deepest level for a leaf, from 0 to [`MAX_DEPTH`], the default.
    pub max_depth: u32,
    /// How planes are chosen.
    pub builder: Builder,
    /// Whether a reference is dropped where its triangle does not reach, though its box does ("perfect splits",
    /// Wald & Havran 2006, section 4.3); default true.
    pub clip: bool,
    /// Whether every kernel is timed, see [`BuildTimes::kernels`](crate::BuildTimes::kernels); default false.
    pub profile: bool,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            cost_step: 1.0,
            cost_test: 1.0,
            price: 5.0,
            long: 16,
            budget: None,
            empty: 0.9,
            max_depth: MAX_DEPTH,
            builder: Builder::default(),
            clip: true,
            profile: false,
        }
    }
}

impl BuildOptions {
    /// The most that a cost or price may be.
    pub const MAX_COST: f32 = 1e9;

    /// Refuses numbers out of range.
    pub(crate) fn check(&self) -> Result<(), Error> {
        let numbers = [
            ("cost_step", self.cost_step, 0.0, Self::MAX_COST),
            ("cost_test", self.cost_test, 0.0, Self::MAX_COST),
            ("price", self.price, 0.0, Self::MAX_COST),
            ("empty", self.empty, 0.0, 1.0),
            ("budget", self.budget.unwrap_or(1.0), 1.0, f32::INFINITY),
            // Rounded it is above the limit if it was before.
            ("max_depth", self.max_depth as f32, 0.0, MAX_DEPTH as f32),
        ];
        match numbers.into_iter().find(|(_, value, least, most)| !(least..=most).contains(&value)) {
            Some((name, value, least, most)) => Err(Error::Options { name, value, least, most }),
            None => Ok(()),
        }
    }

    /// [`BuildParams::price`] in the scaled mesh.
    pub(super) fn price(&self, facts: &Facts) -> f32 {
        let (lo, hi) = facts.bounds;
        let d: [f32; 3] = std::array::from_fn(|i| hi[i] - lo[i]);
        let area = d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
        self.price_of_area() * area / facts.kept.max(1) as f32
    }

    /// What [`Self::price`] shares among the triangles, for each unit of half the root's area.
    pub(super) fn price_of_area(&self) -> f32 {
        self.price * self.cost_test
    }
}
