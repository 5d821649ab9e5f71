//! Winding numbers of points in empty space, looked up: where no triangle is, all points have the same one.
//!
//! The surface goes as often round each point of an empty leaf's cell as round any other, if it is closed. A point
//! counts as if moved by `(e, e^2, e^3)` for an infinitely small positive `e`, as origins of rays do
//! ([`perturbed`](super::intersect::perturbed)). So one in a plane lies above it, and each point inside of one cell.

use super::{
    frame::{FARTHEST, flush},
    job::{JOB_RAYS, OUTCOME_INVALID},
};
use crate::{
    Group,
    glam::{UVec4, Vec3},
    math::{Digits, component, exp2},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{Node, TreeHeader};

/// Stands for the number of a point that is not known; no mesh has as many triangles.
pub const UNKNOWN: u32 = 0x8000_0000;

/// A coordinate, scaled as those of rays' origins are.
#[inline(always)]
pub(super) fn placed<N: Digits>(coordinate: N, scale: f32) -> N {
    flush(flush(coordinate, f32::MIN_POSITIVE) * N::all(scale), f32::MIN_POSITIVE)
}

/// Whether a coordinate, or NaN, is one that rays may start at.
#[inline(always)]
pub(super) fn is_near<N: Digits>(place: N) -> N::Mask {
    place.abs().below(N::all(exp2(FARTHEST)))
}

/// What is known of a leaf: an empty one has its number in place of a reference.
#[inline(always)]
pub(super) fn number(leaf: Node) -> u32 {
    if leaf.is_empty() { leaf.first() } else { UNKNOWN }
}

/// The number of a point, and whether it is one.
#[inline(always)]
fn find(point: Vec3, header: &TreeHeader, regions: &Buf<UVec4>) -> (u32, bool) {
    let scale = header.scale;
    let place = Vec3::new(placed(point.x, scale), placed(point.y, scale), placed(point.z, scale));
    let near = is_near(place.x) & is_near(place.y) & is_near(place.z);
    let (lo, hi) = (header.lo, header.hi);
    let x = place.x >= lo[0] && place.x < hi[0];
    let y = place.y >= lo[1] && place.y < hi[1];
    let z = place.z >= lo[2] && place.z < hi[2];
    let mut found = 0;
    if near & x & y & z {
        let root = regions.at(0);
        let mut node = Node::from_words(root.x, root.y);
        while !node.is_leaf() {
            let pair = regions.at(node.below() >> 1);
            let above = component(place, node.axis()) >= node.split();
            node = if above { Node::from_words(pair.z, pair.w) } else { Node::from_words(pair.x, pair.y) };
        }
        found = number(node);
    }
    (found, near)
}

/// Finds the number of every point of a workgroup: that of a point outside of the scene's box is 0, and one in a leaf
/// that lists triangles has [`UNKNOWN`].
pub fn locate(
    group: Group,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    regions: &Buf<UVec4>,
    points: &Buf<f32>,
    found: &mut Buf<u32>,
    outcome: &mut Buf<u32>,
) {
    let header = header.at(0);
    let first = by_eight!(
        group.usual,
        crate::trace::side_by_side::locate(&group, job, &header, regions, points, found, outcome),
        else group.id * group.width
    );
    lanes!(group, |lane| {
        let i = group.id * group.width + lane;
        if i >= first && i < job.at(JOB_RAYS) {
            let point = Vec3::new(points.at(3 * i), points.at(3 * i + 1), points.at(3 * i + 2));
            let (known, near) = find(point, &header, regions);
            found.put(i, known);
            if !near {
                outcome.add(OUTCOME_INVALID, 1);
            }
        }
    });
}

kernel! {
    /// [`locate`] over all points. Nodes are those of the tree, but an empty leaf has the number of its points in
    /// place of a reference.
    group LOCATE = locate, threads 64, shared [], {
        0 job: read u32, 1 header: read TreeHeader, 2 regions: read UVec4, 3 points: read f32,
        4 found: write u32, 5 outcome: write u32,
    }
}
