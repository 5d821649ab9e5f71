//! What a tree looks like: its cells, and the way of one ray.

use crate::{
    scene::Scene,
    values::{error, floats, object},
};
use raykd::{
    KdTree, Ray, Traversal,
    internals::kernels::trace::frame::PAD,
    shared::{Content, Node},
};
use serde::Serialize;
use wasm_bindgen::prelude::*;

/// Two corners of a box, in the mesh's own units.
type Bounds = [[f32; 3]; 2];

/// The parts of a cell at a plane.
fn halves(cell: Bounds, axis: u32, at: f32) -> [Bounds; 2] {
    let [mut below, mut above] = [cell; 2];
    below[1][axis as usize] = at;
    above[0][axis as usize] = at;
    [below, above]
}

/// Walks a tree from its root.
#[derive(Debug)]
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

    fn root(&self) -> Bounds {
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

/// A node that a ray visits.
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

/// Where a ray is inside of a box that reaches `pad` farther on each side; nowhere if the first is larger.
fn span(ray: &Ray, [lo, hi]: Bounds, pad: f64) -> [f64; 2] {
    let mut span = [f64::from(ray.t_min), f64::from(ray.t_max)];
    for axis in 0..3 {
        let (origin, direction) = (f64::from(ray.origin[axis]), f64::from(ray.direction[axis]));
        let planes = [f64::from(lo[axis]) - pad, f64::from(hi[axis]) + pad];
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
fn pad(ray: &Ray, [lo, hi]: Bounds) -> f64 {
    let reach = |axis: usize| (ray.origin[axis] - lo[axis]).abs().max((ray.origin[axis] - hi[axis]).abs());
    f64::from(PAD) * f64::from(reach(0).max(reach(1)).max(reach(2)))
}

/// A tree whose traversals tell the nodes that a ray visits. It has a copy of the tree, and stays what it is when the
/// scene is freed.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Ways {
    walker: Walker,
    ways: raykd_ways::Ways,
}

#[wasm_bindgen]
impl Ways {
    /// Through a scene's tree.
    #[wasm_bindgen(constructor)]
    pub fn new(scene: &Scene) -> Result<Self, JsError> {
        let ways = raykd_ways::Ways::new(&scene.scene, &scene.mesh).map_err(error)?;
        Ok(Self { walker: Walker::new(scene)?, ways })
    }

    /// The nodes that a ray visits by a traversal until its closest hit is known, in their order, as the kernels do. By
    /// `brute` there are none.
    #[wasm_bindgen(unchecked_return_type = "Visit[]")]
    pub fn of(&self, origin: &[f32], direction: &[f32], traversal: &str) -> Result<JsValue, JsError> {
        let rays = crate::values::rays(origin, direction, None, None)?;
        let [ray] = rays.as_slice() else { return Err(error("one ray is wanted")) };
        let traversal: Traversal = traversal.parse().map_err(error)?;
        let nodes = self.ways.of(ray, traversal).map(|way| way.nodes).unwrap_or_default();
        let pad = pad(ray, self.walker.root());
        let visits: Vec<Visit> = nodes.iter().map(|&node| self.visit(ray, node, pad)).collect();
        object(&visits)
    }

    /// A node's depth and box.
    fn place(&self, node: u32) -> (u32, Bounds) {
        let mut above = vec![node];
        while let Some(up) = self.ways.parent(above[above.len() - 1]) {
            above.push(up);
        }
        let mut cell = self.walker.root();
        for pair in above.windows(2).rev() {
            if let Content::Inner { axis, split, below } = self.walker.content(pair[1]) {
                cell = halves(cell, axis, split)[usize::from(pair[0] != below)];
            }
        }
        (above.len() as u32 - 1, cell)
    }

    fn visit(&self, ray: &Ray, node: u32, pad: f64) -> Visit {
        let (depth, cell) = self.place(node);
        let [enter, exit] = span(ray, cell, pad);
        let (triangles, plane) = match self.walker.content(node) {
            Content::Inner { axis, split, .. } => (None, Some((axis, split))),
            Content::Leaf { first, count } => {
                let refs = &self.walker.tree.view().refs[first as usize..][..count as usize];
                (Some(refs.to_vec()), None)
            }
        };
        Visit { node, depth, enter, exit, cell: cell.as_flattened().to_vec(), triangles, plane }
    }
}
