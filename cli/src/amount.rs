//! `--quality auto`: device, builder and traversal by what a scene and a number of rays need.

use crate::{
    args::{HowArgs, OneArgs, Quality},
    costs::costs,
    machine::{Machine, candidates},
    notes::Notes,
    report::{count, three},
};
use raykd::{
    BuildOptions, Device, Error, Mesh, Traversal,
    plan::{Calibration, Plan, choose, choose_tree},
};

/// How a command shall build and trace.
#[derive(Debug)]
pub(super) struct Amount {
    pub options: BuildOptions,
    pub traversal: Traversal,
    /// How auto came to that.
    pub plan: Option<Plan>,
}

/// What it is for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Job<'a> {
    pub mesh: &'a Mesh,
    pub rays: u64,
    /// Whether more is asked for than closest and any hits by the default triangle test.
    pub needs_tree: bool,
}

impl Job<'_> {
    fn plan(&self, calibrations: &[&Calibration]) -> Plan {
        let choose = if self.needs_tree { choose_tree } else { choose };
        choose(self.mesh, self.rays, calibrations)
    }
}

/// What was asked for; or, with `--quality auto`, what so many rays at this mesh need.
pub(super) fn decide(
    how: &HowArgs,
    traversal: Traversal,
    on: &OneArgs,
    job: Job<'_>,
    notes: &Notes,
) -> anyhow::Result<(Machine, Amount)> {
    if how.amount.quality == Quality::Usual {
        let machine = Machine::choose(on.device, &on.more, notes)?;
        return Ok((machine, Amount { options: how.tree.options(), traversal, plan: None }));
    }
    let mut devices = candidates(on.device, &on.more, notes)?;
    let all: Vec<Calibration> = devices
        .iter()
        .map(|device| costs(device, how.amount.costs.as_deref(), notes))
        .collect::<Result<_, Error>>()?;
    let plan = job.plan(&all.iter().collect::<Vec<_>>());
    let automatic = devices.len() > 1;
    Ok((Machine::of(devices.swap_remove(plan.calibration), automatic), Amount::of(plan)))
}

/// The same on a device that is not to be chosen.
pub(super) fn on(
    device: &Device,
    how: &HowArgs,
    traversal: Traversal,
    job: Job<'_>,
    notes: &Notes,
) -> anyhow::Result<Amount> {
    if how.amount.quality == Quality::Usual {
        return Ok(Amount { options: how.tree.options(), traversal, plan: None });
    }
    let costs = costs(device, how.amount.costs.as_deref(), notes)?;
    Ok(Amount::of(job.plan(&[&costs])))
}

impl Amount {
    fn of(plan: Plan) -> Self {
        let (options, traversal) = (plan.choice.options(), plan.traversal());
        Self { options, traversal, plan: Some(plan) }
    }
}

/// What auto predicted, and what it took.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub(super) struct Told {
    pub choice: &'static str,
    rays: u64,
    predicted_build_ms: f64,
    predicted_rays_ms: f64,
    predicted_ms: f64,
    measured_ms: f64,
}

impl Told {
    /// Times in milliseconds; `rays_ms` is 0 where none were traced, and then none are predicted either.
    pub(super) fn new(plan: &Plan, before_ms: f64, rays_ms: Option<f64>) -> Self {
        let build = plan.cost.before_ms();
        let rays = if rays_ms.is_some() { plan.cost.rays_ms(plan.rays as f64) } else { 0.0 };
        Self {
            choice: plan.choice.name,
            rays: plan.rays,
            predicted_build_ms: build,
            predicted_rays_ms: rays,
            predicted_ms: build + rays,
            measured_ms: before_ms + rays_ms.unwrap_or(0.0),
        }
    }

    /// In words.
    pub(super) fn words(&self) -> String {
        let tree = match self.choice {
            "none" => "no tree".to_owned(),
            "wide" => "boxes, eight a node,".to_owned(),
            tree => format!("{tree} tree"),
        };
        let rays = if self.predicted_rays_ms > 0.0 {
            format!(" + rays {}", three(self.predicted_rays_ms))
        } else {
            String::new()
        };
        format!(
            "{tree} for {} rays: predicted {} ms (build {}{rays}), measured {} ms",
            count(self.rays),
            three(self.predicted_ms),
            three(self.predicted_build_ms),
            three(self.measured_ms)
        )
    }
}
