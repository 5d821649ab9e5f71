//! Winding numbers of the space in which no triangle is, kept with a scene for many points: see
//! [`locate`](raykd_kernels::trace::locate).

use super::Scene;
use crate::{Error, exec::Buffer, mesh::edges};
use raykd_kernels::{
    glam::UVec4,
    math::exp2,
    trace::{frame::FARTHEST, locate::UNKNOWN},
};
use raykd_shared::{Content, Node, TreeHeader};
use std::sync::{
    Arc, OnceLock,
    atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
};

/// How many points must have been asked for each triangle before numbers are kept, on a CPU and on a GPU: so many take
/// by rays about as long as to find out whether the mesh is closed and to trace a ray from each empty leaf.
const WORTH: [u64; 2] = [2, 8];

/// What is known of the empty leaves' numbers. Scenes that are clones of each other share it.
#[derive(Clone, Debug, Default)]
pub(super) struct Regions(Arc<Known>);

/// See [`Regions`].
#[derive(Debug, Default)]
struct Known {
    /// How many points have been asked.
    asked: AtomicU64,
    /// Whether somebody finds the numbers out. Others do not wait for that: a thread of rayon that does it may take up
    /// a task meanwhile that asks, too.
    finding: AtomicBool,
    /// The nodes, of which an empty leaf has its number in place of a reference; nothing if the mesh is not closed,
    /// little of its box is empty, or there is no room.
    found: OnceLock<Option<Buffer<UVec4>>>,
}

impl Regions {
    /// The nodes, if they are kept.
    fn kept(&self) -> Option<&Buffer<UVec4>> {
        self.0.found.get()?.as_ref()
    }

    /// Bytes on the device.
    pub(super) fn bytes(&self) -> u64 {
        self.kept().map_or(0, |nodes| nodes.bytes())
    }
}

/// An empty leaf.
struct Region {
    /// Its number.
    leaf: usize,
    /// Of its cell.
    volume: f64,
    /// A point of its cell.
    inner: [f32; 3],
}

fn volume(lo: [f32; 3], hi: [f32; 3]) -> f64 {
    (0..3).map(|axis| f64::from(hi[axis]) - f64::from(lo[axis])).product()
}

/// All empty leaves of a tree in a box.
fn empty_leaves(nodes: &[Node], lo: [f32; 3], hi: [f32; 3]) -> Vec<Region> {
    let mut regions = Vec::new();
    let mut stack = vec![(0, lo, hi)];
    while let Some((index, lo, hi)) = stack.pop() {
        match nodes[index].content() {
            Content::Leaf { count, .. } => {
                if count == 0 {
                    // A cell has its lower sides, and not its upper ones.
                    let inner = |axis: usize| {
                        let middle = 0.5 * lo[axis] + 0.5 * hi[axis];
                        if middle < hi[axis] { middle } else { lo[axis] }
                    };
                    regions.push(Region { leaf: index, volume: volume(lo, hi), inner: [0, 1, 2].map(inner) });
                }
            }
            Content::Inner { axis, split, below } => {
                let (mut upper, mut lower) = (lo, hi);
                (upper[axis as usize], lower[axis as usize]) = (split, split);
                stack.push((below as usize + 1, upper, hi));
                stack.push((below as usize, lo, lower));
            }
        }
    }
    regions
}

impl Scene {
    /// The nodes with numbers of empty leaves, if so many points more are worth them and the mesh is closed.
    pub(super) fn regions(&self, points: usize) -> Result<Option<&Buffer<UVec4>>, Error> {
        let Known { asked, finding, found } = &*self.regions.0;
        if found.get().is_none() {
            let all = asked.fetch_add(points as u64, Relaxed) + points as u64;
            let worth = WORTH[usize::from(!self.device.is_cpu())] * u64::from(self.header.triangles);
            if all >= worth && !finding.swap(true, Relaxed) {
                let nodes = match self.find_regions() {
                    Ok(nodes) => nodes,
                    // Rays need less room.
                    Err(Error::TooLarge { .. } | Error::OutOfMemory { .. }) => None,
                    Err(error) => {
                        // Somebody may try again.
                        finding.store(false, Relaxed);
                        return Err(error);
                    }
                };
                found.get_or_init(|| nodes);
            }
        }
        Ok(self.regions.kept())
    }

    fn find_regions(&self) -> Result<Option<Buffer<UVec4>>, Error> {
        let TreeHeader { lo, hi, scale, .. } = self.header;
        // No ray starts so far off.
        let far = |x: &f32| x.abs() >= exp2(FARTHEST);
        if lo.iter().chain(&hi).any(far) {
            return Ok(None);
        }
        let (positions, indices) = self.coordinates_and_indices()?;
        if !self.device.install(|| edges(positions.as_chunks().0, &indices)).are_closed() {
            return Ok(None);
        }
        let mut nodes: Vec<Node> = self.device.read(&self.nodes.view(), 0, self.header.nodes as usize)?;
        let regions = empty_leaves(&nodes, lo, hi);
        // To look up a point takes a CPU a third to a half as long as a ray.
        if regions.iter().map(|region| region.volume).sum::<f64>() < 0.5 * volume(lo, hi) {
            return Ok(None);
        }
        let larger = 1.0 / scale;
        // Of a point so small that digits are lost, here or to a kernel that takes it for 0, nothing is known.
        let points: Vec<[f32; 3]> = regions.iter().map(|region| region.inner.map(|x| x * larger)).collect();
        let found = self.winding_by_rays(points.len(), &|range, part| points[range].clone_into(part))?;
        for ((region, point), number) in regions.iter().zip(&points).zip(found.counts) {
            let same = (0..3).all(|a| point[a] * scale == region.inner[a] && !point[a].is_subnormal());
            let number = if same { number.cast_unsigned() } else { UNKNOWN };
            nodes[region.leaf] = Node::leaf(number, 0);
        }
        Ok(Some(self.device.keeping_nothing().put("regions", &nodes)?.view()))
    }
}
