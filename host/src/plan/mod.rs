//! The right amount: what a scene and a number of rays need, from costs that were measured once on each device.
//!
//! A [`Calibration`] holds what each [`Choice`] cost on teapots of several sizes; [`choose`] reads between them and
//! adds up what the whole job would take. If that is long enough, a coarse copy of the mesh is looked at first: how
//! many steps a ray takes there, as against a teapot. All choices give the same closest hits.
//! One of them, `wide`, has boxes instead of a tree; [`choose_tree`] leaves that out.
//!
//! ```no_run
//! # fn main() -> Result<(), raykd::Error> {
//! let mesh = raykd::Mesh::load("dragon.ply.gz")?;
//! let device = raykd::Device::best();
//! let costs = raykd::plan::Calibration::measure(&device, |done| eprintln!("{:.0} %", 100.0 * done))?;
//! let plan = raykd::plan::choose(&mesh, 1_000_000, &[&costs]);
//! let mut scene = raykd::Scene::build(&device, &mesh, &plan.choice.options())?;
//! scene.traverse_by(plan.traversal())?;
//! # Ok(()) }
//! ```

pub(crate) mod calibration;
mod choice;
pub(crate) mod cost;
mod grid;
mod look;

pub use calibration::{Calibration, cache_file, create_cache_file};
pub use choice::{CHOICES, Choice};
pub use cost::Cost;

use crate::{Mesh, Traversal};
use look::{LOOKS, Looking, Seen};

/// What [`choose`] chose.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Plan {
    /// Which of the calibrations that were given, by its place, and so which device.
    pub calibration: usize,
    /// How to build and trace.
    pub choice: Choice,
    /// What it will cost.
    pub cost: Cost,
    /// How many rays that is for.
    pub rays: u64,
}

impl Plan {
    /// How rays are traced, see [`Choice::traversal`].
    pub const fn traversal(&self) -> Traversal {
        self.choice.traversal(self.cost.triangles as usize)
    }

    /// From the mesh to the last hit, in milliseconds, as predicted.
    pub fn total_ms(&self) -> f64 {
        self.cost.total_ms(self.rays as f64)
    }
}

/// How much more time than the best choice's a smaller tree may take, to build and to trace and in all.
const SLACK: f64 = 1.05;

/// Of all choices on all devices that were calibrated, the one that takes the least time in all; or a smaller tree on
/// that device, if building and tracing, and the whole job, take at most 5 % longer by it.
/// The rays are taken to be of the usual kind, those of a picture and a bounce from each hit, and are asked for closest
/// or any hits by the usual triangle test.
///
/// # Panics
/// There is no calibration.
pub fn choose(mesh: &Mesh, rays: u64, calibrations: &[&Calibration]) -> Plan {
    choose_of(CHOICES, mesh, rays, calibrations)
}

/// The same where there must be a tree: for other queries or triangle tests, or to save it.
///
/// # Panics
/// There is no calibration.
pub fn choose_tree(mesh: &Mesh, rays: u64, calibrations: &[&Calibration]) -> Plan {
    let trees: Vec<Choice> = CHOICES.iter().filter(|choice| !choice.is_wide()).copied().collect();
    choose_of(&trees, mesh, rays, calibrations)
}

fn choose_of(choices: &[Choice], mesh: &Mesh, rays: u64, calibrations: &[&Calibration]) -> Plan {
    let mesh = &*mesh.local();
    let triangles = mesh.kept().len() as u32;
    let through = look::through(mesh);
    let mut plan = among(choices, (triangles, rays), through, None, calibrations);
    let looking = Looking::at(mesh);
    for (at, look) in LOOKS.iter().enumerate() {
        if plan.total_ms() < look.from_ms + look.from_each_ms * f64::from(triangles) {
            break;
        }
        plan = among(choices, (triangles, rays), through, seen(&looking, at), calibrations);
    }
    plan
}

/// What the look of this number shows.
fn seen(looking: &Looking<'_>, at: usize) -> Option<(usize, Seen)> {
    looking.seen(&LOOKS[at]).ok().map(|seen| (at, seen))
}

/// What every choice would cost on a device, after a look at the mesh.
#[doc(hidden)]
pub fn costs(mesh: &Mesh, calibration: &Calibration) -> Vec<Cost> {
    let triangles = mesh.kept().len() as u32;
    let seen = seen(&Looking::at(mesh), LOOKS.len() - 1);
    let through = look::through(mesh);
    CHOICES.iter().filter_map(|choice| calibration.predict(choice, triangles, through, seen)).collect()
}

/// The best of some choices on all devices, by what was seen.
fn among(
    choices: &[Choice],
    (triangles, rays): (u32, u64),
    through: f64,
    seen: Option<(usize, Seen)>,
    calibrations: &[&Calibration],
) -> Plan {
    let mut plans = Vec::new();
    for (number, calibration) in calibrations.iter().enumerate() {
        for &choice in choices {
            if let Some(cost) = calibration.predict(&choice, triangles, through, seen) {
                plans.push(Plan { calibration: number, choice, cost, rays });
            }
        }
    }
    let best = plans.iter().min_by(|a, b| a.total_ms().total_cmp(&b.total_ms()));
    let calibration = best.expect("calibrations have costs of some choice").calibration;
    plans.retain(|plan| plan.calibration == calibration);
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
