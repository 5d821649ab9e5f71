//! What a tree looks like: its cells, and the way of one ray.

use crate::{
    scene::Scene,
    values::{error, floats, object},
};
use raykd::{
    KdTree, Ray,
    kernels::trace::frame::PAD,
    shared::{Content, Node},
};
use serde::Serialize;
use wasm_bindgen::prelude::*;

/// Two corners of a box, in the mesh's own units.
type Cell = [[f32; 3]; 2];

/// The parts of a cell at a plane.
fn halves(cell: Cell, axis: u32, at: f32) -> [Cell; 2] {
    let [mut below, mut above] = [cell; 2];
    below[1][axis as usize] = at;
    above[0][axis as usize] = at;
    [below, above]
}

/// Walks a tree from its root.
struct Walker {
    tree: KdTree,
    scale: f32,
}

impl Walker {
    fn new(scene: &Scene) -> Result<Self, JsError> {
        let tree = scene.scene.tree().map_err(error)?;
        let scale = 1.0 / tree.view().header.scale;
        Ok(Self { tree, scale })
    }

    fn root(&self) -> Cell {
        let header = self.tree.view().header;
        [header.lo, header.hi].map(|corner| corner.map(|x| x * self.scale))
    }

    fn content(&self, node: u32) -> Content {
        let nodes: &[Node] = self.tree.view().nodes;
        match nodes[node as usize].content() {
            Content::Inner { axis, split, below } => {
                Content::Inner { axis, split: split * self.scale, below }
            }
            leaf @ Content::Leaf { .. } => leaf,
        }
    }
}

/// The boxes of all nodes of one level, and of leaves above it, at most `most`: for each two corners, and then 0 for an
/// inner node, 1 for a leaf, 2 for an empty leaf.
#[wasm_bindgen]
pub fn cells(scene: &Scene, level: u32, most: u32) -> Result<JsValue, JsError> {
    let walker = Walker::new(scene)?;
    let mut found: Vec<f32> = Vec::new();
    let mut waiting = vec![(0, 0, walker.root())];
    while let Some((node, depth, cell)) = waiting.pop() {
        if found.len() / 7 >= most as usize {
            break;
        }
        let kind = match walker.content(node) {
            Content::Inner { axis, split, below } if depth < level => {
                let [low, high] = halves(cell, axis, split);
                waiting.extend([(below, depth + 1, low), (below + 1, depth + 1, high)]);
                continue;
            }
            Content::Inner { .. } => 0.0,
            Content::Leaf { count: 0, .. } => 2.0,
            Content::Leaf { .. } => 1.0,
        };
        found.extend(cell.as_flattened());
        found.push(kind);
    }
    Ok(floats(&found, |&x| x))
}

/// A node that a ray passes.
#[derive(Serialize)]
struct Visit {
    node: u32,
    depth: u32,
    enter: f64,
    exit: f64,
    #[serde(rename = "box")]
    cell: Vec<f32>,
    triangles: Option<Vec<u32>>,
    plane: Option<(u32, f32)>,
}

/// Where a ray is inside of a box; nowhere if the first is larger.
fn span(ray: &Ray, [lo, hi]: Cell) -> [f64; 2] {
    let mut span = [f64::from(ray.t_min), f64::from(ray.t_max)];
    for axis in 0..3 {
        let (origin, direction) = (f64::from(ray.origin[axis]), f64::from(ray.direction[axis]));
        let planes = [lo[axis], hi[axis]].map(f64::from);
        if direction == 0.0 {
            if origin < planes[0] || origin > planes[1] {
                return [f64::INFINITY, f64::NEG_INFINITY];
            }
            continue;
        }
        let [a, b] = planes.map(|plane| (plane - origin) / direction);
        span = [span[0].max(a.min(b)), span[1].min(a.max(b))];
    }
    span
}

/// Half of what a plane counts as thick, as the kernels have it.
fn pad(ray: &Ray, [lo, hi]: Cell) -> f64 {
    let reach = |axis: usize| (ray.origin[axis] - lo[axis]).abs().max((ray.origin[axis] - hi[axis]).abs());
    f64::from(PAD) * f64::from(reach(0).max(reach(1)).max(reach(2)))
}

/// The nodes that a ray passes until its closest hit, as the traversal `stack` passes them, but in numbers that are
/// rounded otherwise: `Scene.steps` has the kernels' own counts.
#[wasm_bindgen(unchecked_return_type = "Visit[]")]
pub fn way(scene: &Scene, origin: &[f32], direction: &[f32]) -> Result<JsValue, JsError> {
    let ray = crate::values::rays(origin, direction, None, None)?;
    let [ray] = ray.as_slice() else { return Err(error("one ray is wanted")) };
    let hit = scene.scene.closest(&[*ray]).map_err(error)?[0];
    let walker = Walker::new(scene)?;
    let root = walker.root();
    let (pad, [enter, exit]) = (pad(ray, root), span(ray, root));
    let mut visits = Vec::new();
    let mut waiting = if enter <= exit { vec![(0, 0, root, [enter, exit])] } else { Vec::new() };
    while let Some((node, depth, cell, [enter, exit])) = waiting.pop() {
        if hit.is_hit() && enter > f64::from(hit.t) {
            continue;
        }
        let content = walker.content(node);
        let visit = Visit {
            node,
            depth,
            enter,
            exit,
            cell: cell.as_flattened().to_vec(),
            triangles: None,
            plane: None,
        };
        match content {
            Content::Leaf { first, count } => {
                let refs = &walker.tree.view().refs[first as usize..][..count as usize];
                visits.push(Visit { triangles: Some(refs.to_vec()), ..visit });
            }
            Content::Inner { axis, split, below } => {
                visits.push(Visit { plane: Some((axis, split)), ..visit });
                let [low, high] = halves(cell, axis, split);
                let (low, high) = ((below, low), (below + 1, high));
                let at = axis as usize;
                // Small enough a divisor gives a large number, never an infinite one.
                let direction = f64::from(ray.direction[at]);
                let inverse = 1.0 / if direction == 0.0 { 1e-30 } else { direction };
                let (near, far) = if inverse < 0.0 { (high, low) } else { (low, high) };
                let there = (f64::from(split) - f64::from(ray.origin[at])) * inverse;
                let (first, last) = (there - pad * inverse.abs(), there + pad * inverse.abs());
                let empty = |node| matches!(walker.content(node), Content::Leaf { count: 0, .. });
                let to_near = (near.0, depth + 1, near.1, [enter, exit.min(last)]);
                let to_far = (far.0, depth + 1, far.1, [enter.max(first), exit]);
                // Beside another child an empty leaf is not worth a visit.
                if last < enter {
                    waiting.push(to_far);
                } else if first > exit || empty(far.0) {
                    waiting.push(to_near);
                } else if empty(near.0) {
                    waiting.push(to_far);
                } else {
                    waiting.extend([to_far, to_near]);
                }
            }
        }
    }
    object(&visits)
}
