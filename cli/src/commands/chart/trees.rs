//! Figures 2 and 4: what a tree costs to build and to keep, and what it is worth.

use super::{
    data::{Data, Sample},
    figure::{Axis, Figure, Grid, Look, Mark, Scale, Series, front, slug},
};
use crate::report::three;
use raykd::{BuildOptions, Builder};

/// Samples of a scene that have a tree, by device and builder; trees that end early are no builder's.
fn groups<'a>(data: &'a Data, scene: &str) -> Vec<(String, usize, bool, Vec<&'a Sample>)> {
    let mut groups = Vec::new();
    for device in ["cpu", "gpu"] {
        for (kind, builder) in Builder::ALL.iter().copied().enumerate() {
            let of = data.samples.iter().filter(|s| s.scene == scene && s.device == device);
            let mut of: Vec<_> = of.filter(|s| s.builder() == builder.name() && is_whole(s)).collect();
            of.sort_by(|a, b| a.choice.options().price.total_cmp(&b.choice.options().price));
            if !of.is_empty() {
                let name = format!("{}, {}", device.to_uppercase(), builder.name());
                groups.push((name, kind, device == "gpu", of));
            }
        }
    }
    groups
}

fn is_whole(sample: &Sample) -> bool {
    sample.choice.options().max_depth == BuildOptions::default().max_depth
}

fn is_default(sample: &Sample) -> bool {
    let (is, usual) = (sample.choice.options(), BuildOptions::default());
    is.builder == usual.builder && is.price == usual.price
}

fn grid<'a>(groups: impl Iterator<Item = &'a Sample>) -> Grid {
    let titles = [
        "device",
        "builder",
        "price",
        "build ms",
        "SAH cost",
        "ns a ray",
        "Mray/s",
        "references a triangle",
        "bytes a triangle",
    ];
    let mut grid = Grid::new(&titles);
    grid.rows = groups
        .map(|s| {
            vec![
                s.device.to_uppercase(),
                s.builder().to_owned(),
                s.choice.options().price.to_string(),
                three(s.cost.build_ms),
                three(s.sah),
                three(s.cost.ray_ns),
                three(s.cost.mrays()),
                three(s.refs_per_triangle),
                three(s.bytes_per_triangle()),
            ]
        })
        .collect();
    grid
}

/// All three figures of a scene.
pub(super) fn figures(data: &Data, scene: &str) -> Vec<Figure> {
    let groups = groups(data, scene);
    if groups.is_empty() {
        return Vec::new();
    }
    let slug = slug(scene);
    let draw = |look, of: &dyn Fn(&Sample) -> [f64; 2], label: &dyn Fn(&Sample) -> String| {
        let one = |(name, kind, hollow, samples): &(String, usize, bool, Vec<&Sample>)| {
            let mut series = Series::new(name.clone(), look, *kind, *hollow);
            for sample in samples {
                let [x, y] = of(sample);
                series.mark(x, y, &label(sample));
            }
            series
        };
        groups.iter().map(one).collect::<Vec<_>>()
    };
    let all = || groups.iter().flat_map(|(.., samples)| samples.iter().copied());
    let nothing = |_: &Sample| String::new();
    let default = |s: &Sample| if is_default(s) { "default".to_owned() } else { String::new() };
    let ring = |of: &dyn Fn(&Sample) -> [f64; 2]| {
        let mut ring = Series::new("", Look::Ring, 3, false);
        for [x, y] in all().filter(|s| is_default(s)).map(of) {
            ring.mark(x, y, "");
        }
        ring
    };

    let speed = |s: &Sample| [s.cost.build_ms, s.cost.mrays()];
    let mut series = draw(Look::Marks, &speed, &default);
    for device in ["cpu", "gpu"] {
        let points = all().filter(|s| s.device == device).map(|s| {
            let [x, y] = speed(s);
            Mark { x, y, label: String::new() }
        });
        let mut line = Series::new("", Look::Dashed, 3, false);
        line.marks = front(points);
        series.push(line);
    }
    series.push(ring(&speed));
    let builds = Figure {
        file: format!("2-builders-{slug}"),
        title: format!("{scene}: time to build against speed"),
        say: say_front(&groups),
        x: Axis::new("build, ms", Scale::Log),
        y: Axis::new("million rays a second", Scale::Log),
        series,
        grid: grid(all()),
    };

    let heuristic = |s: &Sample| [s.sah, s.cost.ray_ns];
    let sah = Figure {
        file: format!("2-sah-{slug}"),
        title: format!("{scene}: what the heuristic promises and what rays cost"),
        say: say_sah(&groups),
        x: Axis::new("SAH cost of the tree", Scale::Linear),
        y: Axis::new("nanoseconds a ray", Scale::Log),
        series: draw(Look::Marks, &heuristic, &nothing),
        grid: grid(all()),
    };

    let bytes = |s: &Sample| [s.bytes_per_triangle(), s.cost.mrays()];
    let mut series = draw(Look::Line, &bytes, &default);
    series.push(ring(&bytes));
    let need = Figure {
        file: format!("4-bytes-{slug}"),
        title: format!("{scene}: bytes against speed, as references get dearer"),
        say: say_bytes(&groups),
        x: Axis::new("bytes of the tree a triangle", Scale::Linear),
        y: Axis::new("million rays a second", Scale::Log),
        series,
        grid: grid(all()),
    };
    vec![builds, sah, need]
}

type Group<'a> = (String, usize, bool, Vec<&'a Sample>);

fn fastest<'a>(samples: impl Iterator<Item = &'a Sample>) -> Option<&'a Sample> {
    samples.min_by(|a, b| a.cost.ray_ns.total_cmp(&b.cost.ray_ns))
}

fn say_front(groups: &[Group<'_>]) -> String {
    let mut told = Vec::new();
    for device in ["cpu", "gpu"] {
        let of = || groups.iter().flat_map(|(.., s)| s.iter().copied()).filter(|s| s.device == device);
        let soonest = of().min_by(|a, b| a.cost.build_ms.total_cmp(&b.cost.build_ms));
        if let (Some(soonest), Some(fastest)) = (soonest, fastest(of())) {
            told.push(format!(
                "{}: {} is built first, in {} ms, and traces at {} % of the best, {} at price {}, which takes {} ms",
                device.to_uppercase(),
                soonest.builder(),
                three(soonest.cost.build_ms),
                (100.0 * fastest.cost.ray_ns / soonest.cost.ray_ns).round(),
                fastest.builder(),
                fastest.choice.options().price,
                three(fastest.cost.build_ms)
            ));
        }
    }
    format!("Upper left is better, nothing lies beyond the dashed line. {}.", told.join(". "))
}

/// The pair of trees on one device that the heuristic puts most wrongly.
fn say_sah(groups: &[Group<'_>]) -> String {
    let all: Vec<&Sample> = groups.iter().flat_map(|(.., samples)| samples.iter().copied()).collect();
    let mut worst: Option<(f64, &Sample, &Sample)> = None;
    let (mut right, mut pairs) = (0, 0);
    for (at, a) in all.iter().enumerate() {
        for b in all[..at].iter().filter(|b| b.device == a.device) {
            pairs += 1;
            right += usize::from((a.sah < b.sah) == (a.cost.ray_ns < b.cost.ray_ns));
            for (a, b) in [(a, b), (b, a)] {
                let wrong = (b.sah / a.sah).min(a.cost.ray_ns / b.cost.ray_ns);
                if wrong > worst.map_or(1.0, |(worst, ..)| worst) {
                    worst = Some((wrong, a, b));
                }
            }
        }
    }
    let named = |s: &Sample| format!("{} at price {}", s.builder(), s.choice.options().price);
    let misled = worst.map_or_else(String::new, |(_, a, b)| {
        format!(
            " It misleads most on the {}: {} has the lower cost ({} against {}) and the slower rays ({} against \
             {} ns) than {}.",
            a.device.to_uppercase(),
            named(a),
            three(a.sah),
            three(b.sah),
            three(a.cost.ray_ns),
            three(b.cost.ray_ns),
            named(b)
        )
    });
    format!(
        "Of {pairs} pairs of trees the surface area heuristic says of {right} rightly which is faster.{misled}"
    )
}

fn say_bytes(groups: &[Group<'_>]) -> String {
    let mut told = Vec::new();
    for (name, _, _, samples) in groups.iter().filter(|(.., samples)| samples.len() > 2) {
        let Some(best) = fastest(samples.iter().copied()) else { continue };
        let enough = samples.iter().filter(|s| s.cost.ray_ns <= 1.05 * best.cost.ray_ns);
        let Some(least) = enough.min_by(|a, b| a.cost.bytes.cmp(&b.cost.bytes)) else { continue };
        told.push(format!(
            "{name}: {} bytes a triangle are enough for 95 % of the best speed, price {}; the largest tree takes {}",
            three(least.bytes_per_triangle()),
            least.choice.options().price,
            three(samples.iter().map(|s| s.bytes_per_triangle()).fold(0.0, f64::max))
        ));
    }
    format!("What is right of the left end of the plateau is waste. {}.", told.join(". "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use raykd::plan::CHOICES;

    #[test]
    fn what_ends_early_or_is_no_tree_is_no_builders() {
        let mut data = Data::default();
        data.samples.extend(CHOICES.iter().map(|choice| Sample::example(choice.name, 1.0, 1.0)));
        let groups = groups(&data, "s");
        let mut names: Vec<_> = groups.iter().flat_map(|(.., of)| of.iter().map(|s| s.choice.name)).collect();
        names.sort_unstable();
        assert_eq!(names, ["binned", "binned-small", "exact", "exact-small", "median", "zhou"]);
    }
}
