//! Figure 6: the two tables of Meng Zhou, *Build and Travel KD-Tree with CUDA*, then and now.

use super::{
    data::{Data, Sample},
    figure::{Axis, Figure, Grid, Look, Scale, Series},
};
use crate::report::three;

/// The scene of that talk.
const SCENE: &str = "dragon";
/// Its figures, quoted: build and 50,000 rays, in milliseconds.
const THEN: [(&str, f64, f64); 2] = [("CPU, then", 38_315.0, 3_297.0), ("GTX 780 Ti, then", 8_063.0, 344.0)];
/// Its rays.
const RAYS: f64 = 50_000.0;

/// Who, the build and the rays, in milliseconds.
type Row = (String, f64, f64);

/// Bars of building and of tracing; other scenes stand beside nothing.
pub(super) fn figures(data: &Data, scenes: &[&str]) -> Vec<Figure> {
    let Some(scene) = scenes.iter().find(|&&s| s == SCENE).or(scenes.first()) else { return Vec::new() };
    let then: &[_] = if *scene == SCENE { &THEN } else { &[] };
    let mut rows: Vec<Row> = then.iter().map(|&(name, build, rays)| (name.to_owned(), build, rays)).collect();
    for device in ["cpu", "gpu"] {
        let of = data.samples.iter().filter(|s| s.scene == *scene && s.device == device);
        for sample in of.filter(|s| matches!(s.choice.name, "binned" | "exact") && usual(s)) {
            let name = format!("{} now, {}", device.to_uppercase(), sample.choice.name);
            rows.push((name, sample.cost.build_ms, sample.cost.launch_ms + RAYS * sample.cost.ray_ns * 1e-6));
        }
    }
    if rows.is_empty() {
        return Vec::new();
    }
    // The first row on top.
    let names: Vec<String> = rows.iter().rev().map(|(name, ..)| name.clone()).collect();
    let titles = ["who", "build ms", "50,000 rays ms"];
    [("6-talk-build", "build"), ("6-talk-rays", "50,000 rays")]
        .into_iter()
        .map(|(file, what)| {
            let number = |row: &Row| if what == "build" { row.1 } else { row.2 };
            let mut grid = Grid::new(&titles);
            grid.rows = rows.iter().map(|(name, b, r)| vec![name.clone(), three(*b), three(*r)]).collect();
            let mut bars = Series::new("", Look::Bars, 0, false);
            for (place, row) in rows.iter().rev().enumerate() {
                bars.mark(number(row), place as f64, &three(number(row)));
            }
            let best = rows[then.len()..].iter().map(number).fold(f64::INFINITY, f64::min);
            let say = match then.last() {
                Some(&(name, build, rays)) => {
                    let old = number(&(String::new(), build, rays));
                    format!(
                        "The quickest now takes {} ms, the {name} took {}: {} times; other hardware, so the \
                         ratio is of years and algorithms together. The rays of that talk were random ones, these \
                         are a picture's and bounces.",
                        three(best),
                        three(old),
                        three(old / best)
                    )
                }
                None => format!(
                    "Meng Zhou, Build and Travel KD-Tree with CUDA, has the {SCENE}; `raykd chart {SCENE}` puts that \
                     talk's figures beside."
                ),
            };
            Figure {
                file: file.to_owned(),
                title: format!("{scene}: {what}, then and now"),
                say,
                // Now would not be seen beside then.
                x: Axis::new("ms", if then.is_empty() { Scale::Linear } else { Scale::Log }),
                y: Axis::new("", Scale::Names(names.clone())),
                series: vec![bars],
                grid,
            }
        })
        .collect()
}

fn usual(sample: &Sample) -> bool {
    sample.choice.options().price == raykd::BuildOptions::default().price
}
