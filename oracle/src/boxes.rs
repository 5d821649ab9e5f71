//! A plain tree of boxes, so that large meshes can be asked too: medians of centres, at most four triangles a leaf.

use crate::exact::Corners;
use raykd_shared::Ray;

#[derive(Debug)]
struct Node {
    lo: [f32; 3],
    hi: [f32; 3],
    /// Of an inner node: its second child; the first follows it. Of a leaf: where its triangles start.
    at: u32,
    /// Of a leaf: how many; 0 for inner nodes.
    count: u32,
}

/// The tree.
#[derive(Debug)]
pub(crate) struct Boxes {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

const LEAF: usize = 4;

impl Boxes {
    pub(crate) fn new(triangles: &[Corners]) -> Self {
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut nodes = Vec::new();
        if !order.is_empty() {
            split(triangles, &mut order, 0, &mut nodes);
        }
        Self { nodes, order }
    }

    pub(crate) fn reach(&self, from: [f32; 3]) -> f64 {
        let Some(root) = self.nodes.first() else { return 0.0 };
        let ends = |i: usize| [root.lo[i], root.hi[i]].map(|x| (f64::from(x) - f64::from(from[i])).abs());
        (0..3).flat_map(ends).fold(0.0, f64::max)
    }

    /// Every triangle whose box the ray may meet, and some others.
    pub(crate) fn visit(&self, ray: &Ray, mut see: impl FnMut(u32)) {
        if self.nodes.is_empty() {
            return;
        }
        let mut waiting = vec![0usize];
        while let Some(number) = waiting.pop() {
            let node = &self.nodes[number];
            if !meets(node, ray) {
                continue;
            }
            if node.count == 0 {
                waiting.extend([node.at as usize, number + 1]);
            } else {
                let from = node.at as usize;
                self.order[from..from + node.count as usize].iter().copied().for_each(&mut see);
            }
        }
    }
}

/// Adds the tree of `part`, which starts at `from` in the order of all.
fn split(triangles: &[Corners], part: &mut [u32], from: u32, nodes: &mut Vec<Node>) {
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for corner in part.iter().flat_map(|&t| &triangles[t as usize]) {
        for i in 0..3 {
            (lo[i], hi[i]) = (lo[i].min(corner[i]), hi[i].max(corner[i]));
        }
    }
    let number = nodes.len();
    nodes.push(Node { lo, hi, at: from, count: part.len() as u32 });
    if part.len() <= LEAF {
        return;
    }
    let wide = |i: usize| f64::from(hi[i]) - f64::from(lo[i]);
    let axis = (1..3).fold(0, |best, i| if wide(i) > wide(best) { i } else { best });
    let centre = |t: u32| triangles[t as usize].iter().map(|p| f64::from(p[axis])).sum::<f64>();
    let middle = part.len() / 2;
    part.select_nth_unstable_by(middle, |&a, &b| centre(a).total_cmp(&centre(b)));
    let (first, second) = part.split_at_mut(middle);
    split(triangles, first, from, nodes);
    (nodes[number].at, nodes[number].count) = (nodes.len() as u32, 0);
    split(triangles, second, from + middle as u32, nodes);
}

/// Whether a ray may meet a box: two roundings of each `t` are allowed for, several times over, and that hits count
/// whose `t` is rounded to an end of the ray.
fn meets(node: &Node, ray: &Ray) -> bool {
    const MORE: f64 = 1.0e-14;
    let [mut enter, mut exit] = [(ray.t_min, -1.0), (ray.t_max, 1.0)].map(|(end, out)| {
        let end = f64::from(end);
        end + out * f64::from(f32::EPSILON) * end.abs()
    });
    for i in 0..3 {
        let (o, d) = (f64::from(ray.origin[i]), f64::from(ray.direction[i]));
        let [lo, hi] = [node.lo[i], node.hi[i]].map(|x| f64::from(x) - o);
        if d == 0.0 {
            if lo > 0.0 || hi < 0.0 {
                return false;
            }
            continue;
        }
        let (near, far) = if d > 0.0 { (lo / d, hi / d) } else { (hi / d, lo / d) };
        enter = enter.max(near - MORE * near.abs());
        exit = exit.min(far + MORE * far.abs());
    }
    enter <= exit
}
