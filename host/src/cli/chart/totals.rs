//! Figures 3 and 8: the whole job's time against the number of rays, and what `--quality auto` makes of it.

use super::{
    data::{Data, Sample},
    figure::{Axis, Figure, Grid, Look, Scale, Series},
};
use crate::{
    Mesh,
    plan::{CHOICES, Calibration, choose},
    report::three,
};

/// Choices that figure 3 draws.
const DRAWN: [&str; 6] = ["none", "shallow", "halfway", "median", "binned", "exact"];
/// Auto is asked for these powers of ten.
const ASKED: std::ops::RangeInclusive<i32> = 3..=9;

/// The samples of a scene that are choices of the planner.
fn choices<'a>(data: &'a Data, scene: &'a str) -> impl Iterator<Item = &'a Sample> {
    data.samples.iter().filter(move |s| s.scene == scene && CHOICES.contains(&s.choice))
}

/// Build and trace together, for 1e2 to 1e10 rays.
pub(super) fn figure(data: &Data, scene: &str) -> Option<Figure> {
    let mut series = Vec::new();
    let mut said = Vec::new();
    let mut grid =
        Grid::new(&["device", "tree", "upload ms", "build ms", "launch ms", "ns a ray", "ns to move it"]);
    for device in ["cpu", "gpu"] {
        let of = || choices(data, scene).filter(|s| s.device == device);
        for (kind, name) in DRAWN.into_iter().enumerate() {
            let Some(sample) = of().find(|s| s.choice.name == name) else { continue };
            let mut line =
                Series::new(format!("{}, {name}", device.to_uppercase()), Look::Line, kind, device == "gpu");
            for power in 2..=10 {
                let rays = 10f64.powi(power);
                line.mark(rays, sample.cost.total_ms(rays), "");
            }
            series.push(line);
        }
        for s in of() {
            let c = &s.cost;
            let numbers = [c.upload_ms, c.build_ms, c.launch_ms, c.ray_ns, c.transfer_ns];
            let cells = [device.to_uppercase(), s.choice.name.to_owned()];
            grid.rows.push(cells.into_iter().chain(numbers.map(three)).collect());
        }
        let steps: Vec<String> = break_even(&of().collect::<Vec<_>>())
            .into_iter()
            .map(
                |(name, from)| {
                    if from <= 100.0 { name.to_owned() } else { format!("{name} from {}", power(from)) }
                },
            )
            .collect();
        if !steps.is_empty() {
            said.push(format!("{}: {}", device.to_uppercase(), steps.join(", ")));
        }
    }
    let slug: String = scene.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    (!series.is_empty()).then(|| Figure {
        file: format!("3-total-{slug}"),
        title: format!("{scene}: from the mesh to the last hit"),
        say: format!(
            "The lowest line is the right amount. Quickest by number of rays, of all that was measured: {}. Beyond the rays \
             measured the lines go on straight.",
            said.join("; ")
        ),
        x: Axis::new("rays", Scale::Log),
        y: Axis::new("ms, mesh to hits", Scale::Log),
        series,
        grid,
    })
}

/// `2 x 10^5`, in letters that every font has.
fn power(x: f64) -> String {
    let k = x.log10().floor();
    format!("{:.1}e{k:.0}", x / 10f64.powf(k))
}

/// Which choice is the quickest, and from how many rays on.
fn break_even<'a>(samples: &[&'a Sample]) -> Vec<(&'a str, f64)> {
    let mut steps: Vec<(&str, f64)> = Vec::new();
    for i in 0..=8 * 20 {
        let rays = 10f64.powf(2.0 + f64::from(i) / 20.0);
        let best = samples.iter().min_by(|a, b| a.cost.total_ms(rays).total_cmp(&b.cost.total_ms(rays)));
        if let Some(best) = best
            && steps.last().is_none_or(|(name, _)| *name != best.choice.name)
        {
            steps.push((best.choice.name, rays));
        }
    }
    steps
}

/// What auto chose for a scene and a number of rays, and how good that was.
#[derive(Clone, Debug, serde::Serialize)]
pub(in crate::cli) struct Verdict {
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
                let device = &set[plan.device].device;
                let of = || choices(data, scene).filter(|s| set.iter().any(|c| c.device == s.device));
                let total = |s: &Sample| s.cost.total_ms(rays as f64);
                let named = |s: &Sample| format!("{} {}", s.device.to_uppercase(), s.choice.name);
                let chosen = of().find(|s| s.device == device && s.choice == plan.choice);
                let best = of().min_by(|a, b| total(a).total_cmp(&total(b)));
                let (Some(chosen), Some(best)) = (chosen, best) else { continue };
                verdicts.push(Verdict {
                    scene: scene.to_owned(),
                    devices: set.iter().map(|c| c.device.to_uppercase()).collect::<Vec<_>>().join(" or "),
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
pub(in crate::cli) fn say(verdicts: &[Verdict]) -> String {
    let count = |fits: &dyn Fn(&Verdict) -> bool| verdicts.iter().filter(|v| fits(v)).count();
    let most = |of: &dyn Fn(&Verdict) -> f64| verdicts.iter().map(of).fold(1.0, f64::max);
    format!(
        "Of {} cases, what auto chose takes at most 1.10 times as long as the best in hindsight in {}, and {:.2} times at \
         worst; its prediction is within 25 % in {}, and off by {:.2} times at worst.",
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
pub(in crate::cli) fn table(verdicts: &[Verdict]) -> Grid {
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
    use crate::plan::{Choice, Cost};

    fn sample(choice: &str, build_ms: f64, ray_ns: f64) -> Sample {
        let cost = Cost {
            choice: choice.to_owned(),
            triangles: 10,
            upload_ms: 0.0,
            build_ms,
            launch_ms: 0.0,
            ray_ns,
            transfer_ns: 0.0,
            bytes: 100,
        };
        let choice = Choice::named(choice).unwrap();
        Sample {
            scene: "s".to_owned(),
            device: "cpu",
            threads: 0,
            choice,
            cost,
            sah: 1.0,
            refs_per_triangle: 1.0,
        }
    }

    #[test]
    fn break_even_points() {
        let all = [sample("none", 0.0, 1e4), sample("median", 10.0, 1e3), sample("exact", 1000.0, 100.0)];
        let steps = break_even(&all.iter().collect::<Vec<_>>());
        let names: Vec<_> = steps.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["none", "median", "exact"]);
        // 10 ms against 9 us a ray, 990 ms against 900 ns a ray, to the grid's twentieth of a decade.
        for ((_, at), expected) in steps[1..].iter().zip([1.11e3, 1.1e6]) {
            assert!((at / expected).ln().abs() < 0.13, "{at} {expected}");
        }
    }

    #[test]
    fn losses_and_surprises_are_counted() {
        let verdict = |predicted_ms, measured_ms| Verdict {
            scene: "s".to_owned(),
            devices: "CPU".to_owned(),
            rays: 1000,
            choice: "CPU exact".to_owned(),
            predicted_ms,
            measured_ms,
            best: "CPU exact".to_owned(),
            best_ms: 1.0,
        };
        let told = say(&[verdict(1.0, 1.0), verdict(1.0, 1.2), verdict(4.0, 2.0)]);
        assert!(told.contains("Of 3 cases") && told.contains("hindsight in 1, and 2.00"), "{told}");
        assert!(told.contains("25 % in 2, and off by 2.00"), "{told}");
    }
}
