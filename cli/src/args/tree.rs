//! How trees are built and gone through, on every command that does.

use super::values::{one_of, within};
use clap::ValueEnum;
use raykd::{BuildOptions, Builder, Intersector, Traversal};
use std::path::PathBuf;

/// How the tree is built, by these options or by `auto`. Closest hits do not depend on it.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct HowArgs {
    #[command(flatten)]
    pub tree: TreeArgs,
    #[command(flatten)]
    pub amount: AmountArgs,
}

impl HowArgs {
    /// Finds options that would do nothing; `rays` tells whether the number of rays was given for `auto` alone.
    pub(crate) fn check(&self, rays: bool) -> Result<(), String> {
        match self.amount.quality {
            Quality::Auto => Ok(()),
            Quality::Usual if self.amount.costs.is_some() => Err("--costs is for --quality auto".to_owned()),
            Quality::Usual if rays => Err("--rays is for --quality auto".to_owned()),
            Quality::Usual => Ok(()),
        }
    }
}

/// A tree's options. They are apart from [`HowArgs`] because clap makes a group of a struct's own options only.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct TreeArgs {
    /// How planes are chosen
    #[arg(long, value_name = "NAME", default_value_t)]
    #[arg(value_parser = one_of(Builder::ALL, Builder::name, Builder::about))]
    pub builder: Builder,
    /// Keep references where only a triangle's box reaches, not the triangle
    #[arg(long)]
    pub no_clip: bool,
    /// SAH cost of a traversal step; left out: 1
    #[arg(long, value_name = "X", value_parser = within(1e-6_f32, 1e6))]
    pub cost_step: Option<f32>,
    /// SAH cost of a triangle test; left out: 1
    #[arg(long, value_name = "X", value_parser = within(1e-6_f32, 1e6))]
    pub cost_test: Option<f32>,
    /// Price of a reference: tests a ray it has to save, times the number of triangles; more makes smaller trees;
    /// left out: 5
    #[arg(long, value_name = "X", value_parser = within(0.0_f32, 1e9))]
    pub price: Option<f32>,
    /// Most references a triangle, on average, at least 1: the price is doubled until the tree keeps to it (median
    /// and zhou may not); left out: any number
    #[arg(long, value_name = "X", value_parser = within(1.0_f32, 1e6))]
    pub budget: Option<f32>,
    /// Factor on the cost of planes that cut off empty space, from 0 to 1; left out: 0.9
    #[arg(long, value_name = "X", value_parser = within(0.0_f32, 1.0))]
    pub empty: Option<f32>,
}

impl TreeArgs {
    /// As the library is told.
    pub(crate) fn options(&self) -> BuildOptions {
        let usual = BuildOptions::default();
        usual
            .clone()
            .with_builder(self.builder)
            .with_clip(!self.no_clip)
            .with_cost_step(self.cost_step.unwrap_or(usual.cost_step))
            .with_cost_test(self.cost_test.unwrap_or(usual.cost_test))
            .with_price(self.price.unwrap_or(usual.price))
            .with_budget(self.budget)
            .with_empty(self.empty.unwrap_or(usual.empty))
    }
}

/// How much is done for the rays.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct AmountArgs {
    /// auto: device, builder and traversal that take the least time for this scene and so many rays
    #[arg(long, value_enum, default_value_t = Quality::Usual, conflicts_with = "TreeArgs")]
    pub quality: Quality,
    /// With --quality auto: costs of the device by `raykd calibrate -o FILE`; left out: those kept, or measured now
    #[arg(long, value_name = "FILE")]
    pub costs: Option<PathBuf>,
}

/// How rays find triangles.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct WalkArgs {
    /// The way through the tree; closest hits do not depend on it, steps do
    #[arg(long, value_name = "NAME", default_value_t, conflicts_with = "quality")]
    #[arg(value_parser = one_of(Traversal::ALL, Traversal::name, Traversal::about))]
    pub traversal: Traversal,
    /// How triangles are tested; all but strict and exact lose hits
    #[arg(long, value_name = "NAME", default_value_t)]
    #[arg(value_parser = one_of(Intersector::ALL, Intersector::name, Intersector::about))]
    pub intersector: Intersector,
}

impl WalkArgs {
    /// Whether the triangle test does what is asked for: with this traversal, and `more` that only those do which keep
    /// the contract.
    pub(crate) fn check(&self, more: Option<&str>) -> Result<(), String> {
        let test = self.intersector;
        let done = more
            .map_or(Ok(()), |asked| test.check_query(asked))
            .and_then(|()| test.goes_with(self.traversal));
        done.map_err(|error| error.to_string())
    }

    /// Whether the triangle test goes with trees only.
    pub(crate) fn needs_tree(&self) -> bool {
        self.intersector.goes_with(Traversal::Wide).is_err()
    }
}

/// How a tree is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Quality {
    /// The default, or what the other options say
    Usual,
    /// The right amount for the scene and the rays
    Auto,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Those that the options' help names.
    #[test]
    fn defaults() {
        let usual = BuildOptions::default();
        assert_eq!((usual.cost_step, usual.cost_test), (1.0, 1.0));
        assert_eq!((usual.price, usual.empty, usual.budget), (5.0, 0.9, None));
    }
}
