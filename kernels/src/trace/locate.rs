//! Winding numbers of points in empty space, looked up: where no triangle is, all points have the same one.
//!
//! The surface goes as often round each point of an empty leaf's cell as round any other, if it is closed. A point
//! counts as if moved by `(e, e^2, e^3)` for an infinitely small positive `e`, as origins of rays do
//! ([`perturbed`](super::intersect::perturbed)). So one in a plane lies above it, and each point inside of one cell.

#[cfg(target_arch = "x86_64")]
use super::packet::neighbours;
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
#[cfg(target_arch = "x86_64")]
use crate::{
    eight::{Eight, SIDE_BY_SIDE},
    glam::Vec4,
    math::{Number as _, Sides},
};
use raykd_shared::{Node, TreeHeader};

/// Stands for the number of a point that is not known; no mesh has as many triangles.
pub const UNKNOWN: u32 = 0x8000_0000;

/// A coordinate, scaled as those of rays' origins are.
#[inline(always)]
fn placed<N: Digits>(coordinate: N, scale: f32) -> N {
    flush(flush(coordinate, f32::MIN_POSITIVE) * N::all(scale), f32::MIN_POSITIVE)
}

/// Whether a coordinate, or NaN, is one that rays may start at.
#[inline(always)]
fn is_near<N: Digits>(place: N) -> N::Mask {
    place.abs().below(N::all(exp2(FARTHEST)))
}

/// What is known of a leaf: an empty one has its number in place of a reference.
#[inline(always)]
fn number(leaf: Node) -> u32 {
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

/// How many times eight points a CPU takes down at once: while it loads nodes of some it compares others.
#[cfg(target_arch = "x86_64")]
const SETS: usize = 2;
#[cfg(target_arch = "x86_64")]
const POINTS: u32 = SETS as u32 * SIDE_BY_SIDE;

/// Finds the numbers of the first points from `first` to `end`, as far as they fill sets. Returns the first one left.
///
/// # Safety
/// The processor has these instructions.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn by_eight(
    (first, end): (u32, u32),
    header: &TreeHeader,
    regions: &Buf<UVec4>,
    points: &Buf<f32>,
    found: &mut Buf<u32>,
    outcome: &mut Buf<u32>,
) -> u32 {
    type N = Eight;
    let root = regions.at(0);
    let (word0, word1) = (N::all(f32::from_bits(root.x)), N::all(f32::from_bits(root.y)));
    let mut i = first;
    while i + POINTS <= end {
        let zero = N::all(0.0);
        let mut places = [[zero; 3]; SETS];
        let (mut within, mut far) = ([0; SETS], 0);
        let mut set = 0;
        while set < SETS {
            let mut rows = [Vec4::ZERO; 8];
            let mut k = 0;
            while k < SIDE_BY_SIDE {
                let at = 3 * (i + set as u32 * SIDE_BY_SIDE + k);
                rows[k as usize] = Vec4::new(points.at(at), points.at(at + 1), points.at(at + 2), 0.0);
                k += 1;
            }
            let columns = N::columns(&rows);
            let (mut near, mut inside) = (0xFF, 0xFF);
            let mut axis = 0;
            while axis < 3 {
                let place = placed(columns[axis], header.scale);
                near &= N::bits(is_near(place));
                let (lo, hi) = (N::all(header.lo[axis]), N::all(header.hi[axis]));
                inside &= !N::bits(place.below(lo)) & N::bits(place.below(hi));
                places[set][axis] = place;
                axis += 1;
            }
            within[set] = near & inside;
            far += (!near & 0xFF).count_ones();
            set += 1;
        }
        if far > 0 {
            outcome.add(OUTCOME_INVALID, far);
        }
        let (mut splits, mut tags) = ([word0; SETS], [word1; SETS]);
        let mut running = true;
        while running {
            running = false;
            let mut set = 0;
            while set < SETS {
                let leaves = N::leaves(tags[set]);
                let at = N::on_axis(tags[set], &places[set]);
                let child = N::child(tags[set], !at.below(splits[set]));
                running |= N::bits(leaves) != 0xFF;
                (splits[set], tags[set]) = N::nodes(regions, child, !leaves, (splits[set], tags[set]));
                set += 1;
            }
        }
        let mut set = 0;
        while set < SETS {
            let (splits, tags) = (splits[set].numbers(), tags[set].numbers());
            let mut k = 0;
            while k < SIDE_BY_SIDE {
                let leaf = Node::from_words(splits[k as usize].to_bits(), tags[k as usize].to_bits());
                let known = if within[set] >> k & 1 != 0 { number(leaf) } else { 0 };
                found.put(i + set as u32 * SIDE_BY_SIDE + k, known);
                k += 1;
            }
            set += 1;
        }
        i += POINTS;
    }
    i
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
    let first = group.id * group.width;
    #[cfg(target_arch = "x86_64")]
    let first = match neighbours(&group, job) {
        // SAFETY: that the group is usual says so.
        Some(range) => unsafe { by_eight(range, &header, regions, points, found, outcome) },
        None => first,
    };
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
