//! Figure 9: would it pay to build only what rays touch?
//!
//! A lazy builder still handles all references of every node that a ray passes: its work is at least the share of
//! references in those nodes, of the references in all nodes. That share of the time of the whole build, and rays as
//! quick as in the whole tree, are what no lazy builder of that tree can beat.

use super::{
    data::{Data, Sample},
    figure::{Axis, Figure, Grid, Look, Scale, Series},
};
use crate::report::three;
use raykd::plan::CHOICES;

/// The tree that would be built lazily.
const TREE: &str = "exact";

/// The least that a lazy builder takes, beside the best of what was measured.
pub(super) fn figure(data: &Data) -> Option<Figure> {
    let mut scenes: Vec<&str> = data.lazy.iter().map(|share| share.scene.as_str()).collect();
    scenes.dedup();
    let (mut series, mut said) = (Vec::new(), Vec::new());
    let titles = [
        "scene",
        "rays",
        "touched %",
        "lazy at least, ms",
        "best measured",
        "ms",
        "lazy gains at most, times",
    ];
    let mut grid = Grid::new(&titles);
    for (kind, scene) in scenes.into_iter().enumerate() {
        let of = |s: &&Sample| s.scene == scene && s.device == "cpu" && CHOICES.contains(&s.choice);
        let samples: Vec<&Sample> = data.samples.iter().filter(of).collect();
        let Some(whole) = samples.iter().find(|s| s.choice.name == TREE) else { continue };
        let mut gains = Series::new(scene, Look::Line, kind, false);
        let mut most = (0.0, 0.0);
        for share in data.lazy.iter().filter(|share| share.scene == scene) {
            let rays = share.rays as f64;
            let total = |s: &&&Sample| s.cost.total_ms(rays);
            let Some(best) = samples.iter().min_by(|a, b| total(a).total_cmp(&total(b))) else { continue };
            let lazy = whole.cost.upload_ms + share.touched * whole.cost.build_ms + whole.cost.rays_ms(rays);
            let gain = best.cost.total_ms(rays) / lazy;
            most = if gain > most.0 { (gain, rays) } else { most };
            gains.mark(rays, gain, "");
            let numbers = [three(rays), three(100.0 * share.touched), three(lazy)];
            let rest = [best.choice.name.to_owned(), three(best.cost.total_ms(rays)), format!("{gain:.2}")];
            grid.rows.push(std::iter::once(scene.to_owned()).chain(numbers).chain(rest).collect());
        }
        said.push(format!("{scene} {:.2} times at {} rays", most.0, three(most.1)));
        series.push(gains);
    }
    (!series.is_empty()).then(|| Figure {
        file: "9-lazy".to_owned(),
        title: "Building only what rays touch (CPU)".to_owned(),
        say: format!(
            "The most that a lazy {TREE} builder could gain over the best of what there is: {}. Below 1 it loses \
             even if being lazy costs nothing.",
            said.join(", ")
        ),
        x: Axis::new("rays", Scale::Log),
        y: Axis::new("times as fast as the best measured, at most", Scale::Log),
        series,
        grid,
    })
}
