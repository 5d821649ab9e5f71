//! Figure 8, and `raykd calibrate --check`: what `--quality auto` predicts and chooses, against what was measured.

use super::{
    data::{Data, Sample},
    figure::{Axis, Figure, Grid, Look, Scale, Series},
    totals::choices,
};
use crate::report::three;
use raykd::{
    Mesh,
    plan::{Calibration, Cost, choose, costs},
};

/// Auto is asked for these powers of ten.
const ASKED: std::ops::RangeInclusive<i32> = 3..=9;

/// What auto chose for a scene and a number of rays, and how good that was.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Verdict {
    pub scene: String,
    /// Devices that it chose among.
    pub devices: String,
    pub rays: u64,
    pub choice: String,
    pub predicted_ms: f64,
    pub measured_ms: f64,
    pub best: String,
    pub best_ms: f64,
}

impl Verdict {
    /// Times as long as the best.
    fn loss(&self) -> f64 {
        self.measured_ms / self.best_ms
    }

    /// Times as long as predicted, or as short.
    fn surprise(&self) -> f64 {
        (self.measured_ms / self.predicted_ms).max(self.predicted_ms / self.measured_ms)
    }

    /// One for tests.
    #[cfg(test)]
    pub(super) fn example(predicted_ms: f64, measured_ms: f64) -> Self {
        Self {
            scene: "s".to_owned(),
            devices: "CPU".to_owned(),
            rays: 1000,
            choice: "CPU exact".to_owned(),
            predicted_ms,
            measured_ms,
            best: "CPU exact".to_owned(),
            best_ms: 1.0,
        }
    }
}

/// What a choice was predicted to cost at a scene on a device, and what it cost.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Pair {
    scene: String,
    device: String,
    predicted: Cost,
    measured: Cost,
}

/// Every choice that was measured.
pub(super) fn pairs(data: &Data, scenes: &[(&str, &Mesh)]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for &(scene, mesh) in scenes {
        for calibration in &data.calibrations {
            for predicted in costs(mesh, calibration) {
                let of = |s: &&Sample| s.device == calibration.device() && s.choice.name == predicted.choice;
                let Some(sample) = choices(data, scene).find(of) else { continue };
                let (scene, device) = (scene.to_owned(), calibration.device().to_owned());
                pairs.push(Pair { scene, device, predicted, measured: sample.cost.clone() });
            }
        }
    }
    pairs
}

/// Asks auto for scenes and numbers of rays, on each device alone and on all together.
pub(super) fn verdicts(data: &Data, scenes: &[(&str, &Mesh)]) -> Vec<Verdict> {
    let mut sets: Vec<Vec<&Calibration>> = data.calibrations.iter().map(|one| vec![one]).collect();
    if sets.len() > 1 {
        sets.push(data.calibrations.iter().collect());
    }
    let mut verdicts = Vec::new();
    for &(scene, mesh) in scenes {
        for set in &sets {
            for k in ASKED {
                let rays = 10u64.pow(k as u32);
                let plan = choose(mesh, rays, set);
                let device = set[plan.calibration].device();
                let of = || choices(data, scene).filter(|s| set.iter().any(|c| c.device() == s.device));
                // Rays move as fast whatever the mesh; what else the machine did meanwhile is no part of a choice.
                let total = |s: &Sample| {
                    let of = data.samples.iter().filter(|other| other.device == s.device);
                    let mut cost = s.cost.clone();
                    cost.transfer_ns =
                        of.map(|other| other.cost.transfer_ns).fold(cost.transfer_ns, f64::min);
                    cost.total_ms(rays as f64)
                };
                let named = |s: &Sample| format!("{} {}", s.device.to_uppercase(), s.choice.name);
                let chosen = of().find(|s| s.device == device && s.choice == plan.choice);
                let best = of().min_by(|a, b| total(a).total_cmp(&total(b)));
                let (Some(chosen), Some(best)) = (chosen, best) else { continue };
                verdicts.push(Verdict {
                    scene: scene.to_owned(),
                    devices: set.iter().map(|c| c.device().to_uppercase()).collect::<Vec<_>>().join(" or "),
                    rays,
                    choice: named(chosen),
                    predicted_ms: plan.total_ms(),
                    measured_ms: total(chosen),
                    best: named(best),
                    best_ms: total(best),
                });
            }
        }
    }
    verdicts
}

/// In words: how often auto was near the best, and its predictions right.
pub(crate) fn say(verdicts: &[Verdict]) -> String {
    let count = |fits: &dyn Fn(&Verdict) -> bool| verdicts.iter().filter(|v| fits(v)).count();
    let most = |of: &dyn Fn(&Verdict) -> f64| verdicts.iter().map(of).fold(1.0, f64::max);
    format!(
        "Of {} cases, what auto chose takes at most 1.10 times as long as the best in hindsight in {}, and {:.2} \
         times at worst; its prediction is within 25 % in {}, and off by {:.2} times at worst.",
        verdicts.len(),
        count(&|v| v.loss() <= 1.1),
        most(&Verdict::loss),
        count(&|v| v.surprise() <= 1.25),
        most(&Verdict::surprise)
    )
}

/// Predicted against measured time, and the table of choices.
pub(super) fn auto(verdicts: &[Verdict]) -> Option<Figure> {
    let mut scenes: Vec<&str> = verdicts.iter().map(|v| v.scene.as_str()).collect();
    scenes.dedup();
    let mut series = Vec::new();
    for (kind, scene) in scenes.into_iter().enumerate() {
        let mut marks = Series::new(scene, Look::Marks, kind, false);
        for v in verdicts.iter().filter(|v| v.scene == scene) {
            marks.mark(v.predicted_ms, v.measured_ms, "");
        }
        series.push(marks);
    }
    let (low, high) = verdicts.iter().fold((f64::INFINITY, 0.0f64), |(low, high), v| {
        (low.min(v.predicted_ms.min(v.measured_ms)), high.max(v.predicted_ms.max(v.measured_ms)))
    });
    let mut equal = Series::new("as predicted", Look::Dashed, 3, false);
    equal.mark(low, low, "");
    equal.mark(high, high, "");
    series.push(equal);
    (!verdicts.is_empty()).then(|| Figure {
        file: "8-auto".to_owned(),
        title: "What auto predicted and what it took".to_owned(),
        say: say(verdicts),
        x: Axis::new("predicted, ms", Scale::Log),
        y: Axis::new("measured, ms", Scale::Log),
        series,
        grid: table(verdicts),
    })
}

/// All cases.
pub(crate) fn table(verdicts: &[Verdict]) -> Grid {
    let titles = [
        "scene",
        "devices",
        "rays",
        "auto",
        "predicted ms",
        "measured ms",
        "best in hindsight",
        "ms",
        "times the best",
    ];
    let mut grid = Grid::new(&titles);
    grid.rows = verdicts
        .iter()
        .map(|v| {
            vec![
                v.scene.clone(),
                v.devices.clone(),
                format!("1e{:.0}", (v.rays as f64).log10()),
                v.choice.clone(),
                three(v.predicted_ms),
                three(v.measured_ms),
                v.best.clone(),
                three(v.best_ms),
                format!("{:.2}", v.loss()),
            ]
        })
        .collect();
    grid
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_and_surprises_are_counted() {
        let told = say(&[(1.0, 1.0), (1.0, 1.2), (4.0, 2.0)].map(|(p, m)| Verdict::example(p, m)));
        assert!(told.contains("Of 3 cases") && told.contains("hindsight in 1, and 2.00"), "{told}");
        assert!(told.contains("25 % in 2, and off by 2.00"), "{told}");
    }
}
