//! The right amount: what a scene and a number of rays need, from costs that were measured once on each device.
//!
//! A [`Calibration`] holds what each [`Choice`] cost on teapots of several sizes; [`choose`] reads between them and
//! adds up what the whole job would take. If that is long enough, a coarse copy of the mesh is looked at first: how
//! many steps a ray takes there, as against a teapot. All choices give the same hits.
//!
//! ```no_run
//! # fn main() -> Result<(), raykd::Error> {
//! let mesh = raykd::Mesh::load("dragon.ply.gz".as_ref())?;
//! let device = raykd::Device::best();
//! let costs = raykd::plan::Calibration::of(&device, |done| eprintln!("{:.0} %", 100.0 * done))?;
//! let plan = raykd::plan::choose(&mesh, 1_000_000, &[&costs]);
//! let mut scene = raykd::Scene::build(&device, &mesh, &plan.choice.options())?;
//! scene.traverse_by(plan.choice.traversal(mesh.kept().len()))?;
//! # Ok(()) }
//! ```

pub(crate) mod calibration;
pub(crate) mod cost;
mod grid;
mod look;

pub use calibration::{Calibration, cache, place};
pub use cost::Cost;
pub use look::Seen;

use crate::{BuildOptions, Builder, Mesh, Traversal};
use look::{LOOKS, Looking};

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
}

const fn choice(name: &'static str, builder: Builder) -> Choice {
    Choice { name, builder, price: None, long: None, depth: None }
}

/// Triangles that `stack` tests in one leaf.
const LONG_LEAF: usize = 1 << 15;

/// What there is to choose from: no tree, shallow ones, and those of all builders; small ones too.
pub const CHOICES: [Choice; 9] = [
    Choice { depth: Some(0), ..choice("none", Builder::Median) },
    Choice { depth: Some(6), ..choice("shallow", Builder::Median) },
    Choice { depth: Some(look::HALFWAY), ..choice("halfway", Builder::Median) },
    choice("median", Builder::Median),
    choice("zhou", Builder::Zhou),
    choice("binned", Builder::Binned),
    Choice { price: Some(40.0), long: Some(64), ..choice("binned-small", Builder::Binned) },
    choice("exact", Builder::Exact),
    Choice { price: Some(40.0), long: Some(64), ..choice("exact-small", Builder::Exact) },
];

impl Choice {
    /// The choice of this name.
    pub fn named(name: &str) -> Option<Self> {
        CHOICES.into_iter().find(|choice| choice.name == name)
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

    /// Whether there is more than one leaf.
    pub(crate) const fn has_tree(&self) -> bool {
        !matches!(self.depth, Some(0))
    }

    /// Whether the tree ends with long leaves halfway down.
    fn ends_halfway(&self) -> bool {
        self.depth == Some(look::HALFWAY)
    }

    /// How rays are traced: `stack` was the fastest way through a tree everywhere, and through a
    /// single leaf too, but software drivers end its loop if that is long.
    pub const fn traversal(&self, triangles: usize) -> Traversal {
        if self.has_tree() || triangles <= LONG_LEAF { Traversal::Stack } else { Traversal::Brute }
    }
}

/// What [`choose`] chose.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Plan {
    /// Which of the calibrations, and so which device.
    pub device: usize,
    /// How to build and trace.
    pub choice: Choice,
    /// What it will cost.
    pub cost: Cost,
    /// How many rays that is for.
    pub rays: u64,
}

impl Plan {
    /// From the mesh to the last hit, in milliseconds, as predicted.
    pub fn total_ms(&self) -> f64 {
        self.cost.total_ms(self.rays as f64)
    }
}

/// How much more time than the best choice's a smaller tree may take, to build and to trace and in all.
const SLACK: f64 = 1.05;

/// Of all choices on all devices that were calibrated, the one that takes the least time in all; or a smaller tree on
/// that device, if building and tracing, and the whole job, take at most 5 % longer by it.
/// The rays are taken to be of the usual kind, those of a picture and a bounce from each hit.
///
/// # Panics
/// There is no calibration.
pub fn choose(mesh: &Mesh, rays: u64, calibrations: &[&Calibration]) -> Plan {
    let mesh = &*mesh.local();
    let triangles = mesh.kept().len() as u32;
    let through = look::through(mesh);
    let mut plan = among(triangles, rays, through, None, calibrations);
    let looking = Looking::at(mesh);
    for (at, look) in LOOKS.iter().enumerate() {
        if plan.total_ms() < look.from_ms + look.from_each_ms * f64::from(triangles) {
            break;
        }
        plan = among(triangles, rays, through, seen(&looking, at), calibrations);
    }
    plan
}

/// What the look of this number shows.
fn seen(looking: &Looking<'_>, at: usize) -> Option<(usize, Seen)> {
    looking.seen(&LOOKS[at]).ok().map(|seen| (at, seen))
}

/// What every choice would cost on a device, after a look at the mesh.
pub fn costs(mesh: &Mesh, calibration: &Calibration) -> Vec<Cost> {
    let triangles = mesh.kept().len() as u32;
    let seen = seen(&Looking::at(mesh), LOOKS.len() - 1);
    let through = look::through(mesh);
    CHOICES.iter().filter_map(|choice| calibration.predict(choice, triangles, through, seen)).collect()
}

/// The best of all choices on all devices, by what was seen.
fn among(
    triangles: u32,
    rays: u64,
    through: f64,
    seen: Option<(usize, Seen)>,
    calibrations: &[&Calibration],
) -> Plan {
    let mut plans = Vec::new();
    for (device, calibration) in calibrations.iter().enumerate() {
        for choice in CHOICES {
            if let Some(cost) = calibration.predict(&choice, triangles, through, seen) {
                plans.push(Plan { device, choice, cost, rays });
            }
        }
    }
    let best = plans.iter().min_by(|a, b| a.total_ms().total_cmp(&b.total_ms()));
    let device = best.expect("calibrations have costs of some choice").device;
    plans.retain(|plan| plan.device == device);
    let costs: Vec<&Cost> = plans.iter().map(|plan| &plan.cost).collect();
    let chosen = best_of(&costs, rays).expect("the best is among them");
    plans.swap_remove(chosen)
}

/// Of what choices cost on one device, the place of the one to take for so many rays.
#[doc(hidden)]
pub fn best_of(costs: &[&Cost], rays: u64) -> Option<usize> {
    let rays = rays as f64;
    let total = |cost: &Cost| cost.total_ms(rays);
    let best = costs.iter().copied().min_by(|a, b| total(a).total_cmp(&total(b)))?;
    // Moving a million rays takes longer than tracing them: of that every tree would be 5 %.
    let like =
        |cost: &Cost| cost.own_ms(rays) <= best.own_ms(rays) * SLACK && total(cost) <= total(best) * SLACK;
    let good = (0..costs.len()).filter(|&at| like(costs[at]));
    good.min_by_key(|&at| (costs[at].bytes, (total(costs[at]) * 1e6) as u64))
}
