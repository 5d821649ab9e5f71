//! How much of a tree some rays touch.

use raykd::{
    Error, Hit, Mesh, Ray, Scene,
    internals::usual_rays,
    shared::{Content, Node},
};

/// Rays by powers of ten.
const ASKED: std::ops::RangeInclusive<i32> = 2..=6;

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

/// Marks the nodes that a ray passes before its hit. Rounding may add a neighbour or leave one out: it is a
/// measurement.
fn pass(
    nodes: &[Node],
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
