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
use raykd::{Error, Hit, Mesh, Ray, Scene, plan::CHOICES, plan::usual_rays, shared::Content};

/// Rays by powers of ten.
const ASKED: std::ops::RangeInclusive<i32> = 2..=6;
/// The tree that would be built lazily.
const TREE: &str = "exact";

/// How much of the building some rays need.
#[derive(Clone, Debug)]
pub(super) struct Share {
    pub scene: String,
    pub rays: usize,
    /// Of the references in all inner nodes, those in nodes that rays pass.
    pub touched: f64,
}

/// Shares of a scene whose tree is built already.
pub(super) fn shares(name: &str, mesh: &Mesh, scene: &Scene) -> Result<Vec<Share>, Error> {
    let tree = scene.tree()?;
    let (nodes, scale) = (tree.view().nodes, tree.view().header.scale);
    // Children stand behind their parents.
    let mut refs = vec![0u64; nodes.len()];
    for at in (0..nodes.len()).rev() {
        refs[at] = match nodes[at].content() {
            Content::Leaf { count, .. } => count.into(),
            Content::Inner { below, .. } => refs[below as usize] + refs[below as usize + 1],
        };
    }
    let work = |at: usize| if nodes[at].is_leaf() { 0 } else { refs[at] };
    let all: u64 = (0..nodes.len()).map(work).sum();
    let mut shares = Vec::new();
    for power in ASKED {
        let rays = usual_rays(mesh, 10usize.pow(power as u32), |rays| scene.closest(rays))?;
        let hits = scene.closest(&rays)?;
        let mut passed = vec![false; nodes.len()];
        for (ray, hit) in rays.iter().zip(&hits) {
            pass(nodes, scale, (mesh.scaled_bounds(), ray, hit), &mut passed);
        }
        let touched: u64 = (0..nodes.len()).filter(|&at| passed[at]).map(work).sum();
        let touched = touched as f64 / all.max(1) as f64;
        shares.push(Share { scene: name.to_owned(), rays: rays.len(), touched });
    }
    Ok(shares)
}

/// Marks the nodes that a ray passes before its hit. Rounding may add a neighbour or leave one out: it is a measurement.
fn pass(
    nodes: &[raykd::shared::Node],
    scale: f32,
    ((lo, hi), ray, hit): (([f32; 3], [f32; 3]), &Ray, &Hit),
    passed: &mut [bool],
) {
    let origin = ray.origin.map(|x| f64::from(x) * f64::from(scale));
    let direction = ray.direction.map(|x| f64::from(x) * f64::from(scale));
    let mut span = [f64::from(ray.t_min), f64::from(if hit.is_hit() { hit.t } else { ray.t_max })];
    for a in 0..3 {
        let ends = [lo[a], hi[a]].map(|end| (f64::from(end) - origin[a]) / direction[a]);
        if ends.iter().all(|t| !t.is_nan()) {
            span = [span[0].max(ends[0].min(ends[1])), span[1].min(ends[0].max(ends[1]))];
        }
    }
    let mut waiting = vec![(0u32, span)];
    while let Some((at, [from, to])) = waiting.pop() {
        if from > to {
            continue;
        }
        passed[at as usize] = true;
        if let Content::Inner { axis, split, below } = nodes[at as usize].content() {
            let axis = axis as usize;
            let t = (f64::from(split) - origin[axis]) / direction[axis];
            let (near, far) = if origin[axis] < f64::from(split)
                || t.is_nan()
                || (origin[axis] == f64::from(split) && direction[axis] <= 0.0)
            {
                (below, below + 1)
            } else {
                (below + 1, below)
            };
            if t > 0.0 {
                waiting.push((far, [from.max(t), to]));
                waiting.push((near, [from, to.min(t)]));
            } else {
                waiting.push((near, [from, to]));
            }
        }
    }
}

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
            "The most that a lazy {TREE} builder could gain over the best of what there is: {}. Below 1 it loses even if \
             being lazy costs nothing.",
            said.join(", ")
        ),
        x: Axis::new("rays", Scale::Log),
        y: Axis::new("times as fast as the best measured, at most", Scale::Log),
        series,
        grid,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use raykd::{BuildOptions, Device};

    #[test]
    fn passed_nodes_are_those_that_the_kernel_passes() {
        let (device, mesh) = (Device::cpu(), Mesh::teapot(6));
        let scene = Scene::build(&device, &mesh, &BuildOptions::default()).unwrap();
        let tree = scene.tree().unwrap();
        let view = tree.view();
        let rays = raykd::rays::random(mesh.bounds(), 300, 5);
        let (hits, steps) = scene.steps(&rays).unwrap();
        let (mut ours, mut theirs) = (0, 0);
        for ((ray, hit), steps) in rays.iter().zip(&hits).zip(&steps) {
            let mut passed = vec![false; view.nodes.len()];
            pass(view.nodes, view.header.scale, (mesh.scaled_bounds(), ray, hit), &mut passed);
            ours += (0..passed.len()).filter(|&at| passed[at] && !view.nodes[at].is_leaf()).count();
            theirs += steps.inner as usize;
        }
        // The kernel's planes are thick, and it may enter a node before it knows of a nearer hit.
        assert!(ours <= theirs && ours * 10 >= theirs * 9, "{ours} {theirs}");
    }

    #[test]
    fn more_rays_touch_more() {
        let (device, mesh) = (Device::cpu(), Mesh::teapot(12));
        let scene = Scene::build(&device, &mesh, &BuildOptions::default()).unwrap();
        let shares = shares("teapot", &mesh, &scene).unwrap();
        assert!(shares.is_sorted_by(|a, b| a.touched <= b.touched + 0.01), "{shares:?}");
        assert!(shares[0].touched > 0.01 && shares[4].touched <= 1.0, "{shares:?}");
    }
}
