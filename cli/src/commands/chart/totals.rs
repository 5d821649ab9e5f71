//! Figure 3: the whole job's time against the number of rays.

use super::{
    data::{Data, Sample},
    figure::{Axis, Figure, Grid, Look, Scale, Series, slug},
};
use crate::report::three;
use raykd::plan::CHOICES;

/// Choices that figure 3 draws.
const DRAWN: [&str; 7] = ["none", "shallow", "halfway", "median", "binned", "exact", "wide"];
/// The samples of a scene that are choices of the planner.
pub(super) fn choices<'a>(data: &'a Data, scene: &'a str) -> impl Iterator<Item = &'a Sample> {
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
    (!series.is_empty()).then(|| Figure {
        file: format!("3-total-{}", slug(scene)),
        title: format!("{scene}: from the mesh to the last hit"),
        say: format!(
            "The lowest line is the right amount. Quickest by number of rays, of all that was measured: {}. \
             Beyond the rays measured the lines go on straight.",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn break_even_points() {
        let all = [("none", 0.0, 1e4), ("median", 10.0, 1e3), ("exact", 1000.0, 100.0)]
            .map(|(choice, build_ms, ray_ns)| Sample::example(choice, build_ms, ray_ns));
        let steps = break_even(&all.iter().collect::<Vec<_>>());
        let names: Vec<_> = steps.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["none", "median", "exact"]);
        // 10 ms against 9 us a ray, 990 ms against 900 ns a ray, to the grid's twentieth of a decade.
        for ((_, at), expected) in steps[1..].iter().zip([1.11e3, 1.1e6]) {
            assert!((at / expected).ln().abs() < 0.13, "{at} {expected}");
        }
    }
}
