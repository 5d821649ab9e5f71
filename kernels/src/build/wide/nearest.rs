//! Which clusters of a round become one: two of which each is the other's best neighbour. And the places that what they
//! become has in its block.

use super::{Binary, COUNT, JOB_TRIANGLES, PARTS, ROUND, SUMS, area, number};
use crate::{
    Group,
    bounds::Bounds,
    build::scan::{LANES, before, scan, word},
    glam::{UVec2, UVec4, Vec3},
    mem::{Buf, PerLane, Slots},
};
use raykd_shared::WideNode;

/// How far away in the order a neighbour may be.
pub const RADIUS: u32 = 8;
/// Clusters of a block. A workgroup finds the neighbours of those within [`RADIUS`] of it, too.
pub const BLOCK: u32 = LANES - 2 * RADIUS;
/// Clusters whose boxes a workgroup keeps.
const KEPT: u32 = LANES + 2 * RADIUS;

/// Words for the boxes and areas of clusters.
pub(super) const BOXES: usize = 7 * KEPT as usize;
/// Words for the neighbours that they find.
pub(super) const FOUND: usize = LANES as usize;

/// Kinds that are counted: clusters of the next round, and nodes that are made.
pub(super) const CLUSTERS: u32 = 0;
pub(super) const PAIRS: u32 = 1;

// What becomes of a cluster: its places among both kinds, and how far away its partner is, if it has one behind it.
const PLACE_BITS: u32 = 8;
const PARTNER: u32 = 2 * PLACE_BITS;
/// It became part of one before it.
const GONE: u32 = 1 << 31;

/// What becomes of a cluster.
pub(super) struct Fate {
    /// It became part of one before it.
    pub gone: bool,
    /// Its place among the clusters of the next round, and that of what it becomes among new nodes, in its block.
    pub cluster: u32,
    pub pair: u32,
    /// How far behind it its partner is, or 0.
    pub partner: u32,
}

impl Fate {
    #[inline(always)]
    pub(super) const fn of(word: u32) -> Self {
        let mask = (1 << PLACE_BITS) - 1;
        Self {
            gone: (word & GONE) != 0,
            cluster: word & mask,
            pair: word >> PLACE_BITS & mask,
            partner: word >> PARTNER & mask,
        }
    }
}

/// The box of a cluster that a workgroup keeps, and its area.
#[inline(always)]
fn kept(boxes: &[u32; BOXES], i: u32) -> (Bounds, f32) {
    let word = |c: u32| f32::from_bits(boxes.at(c * KEPT + i));
    let bounds =
        Bounds { lo: Vec3::new(word(0), word(1), word(2)), hi: Vec3::new(word(3), word(4), word(5)) };
    (bounds, word(6))
}

/// Whether the cluster that a lane looks for is one of a block, which begins with `first`.
#[inline(always)]
fn is_own(lane: u32, first: u32, count: u32) -> bool {
    let i = lane.wrapping_sub(RADIUS);
    i < BLOCK && first + i < count
}

/// Finds what becomes of the clusters of a block. The round has `count`, from place `from` of their list on. `parts`
/// then tells how many there are of each kind, see [`number`].
#[inline(always)]
pub(super) fn of_block(
    group: Group,
    boxes: &mut [u32; BOXES],
    found: &mut [u32; FOUND],
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    block: u32,
    (from, count, is_forced): (u32, u32, bool),
    clusters: &Buf<u32>,
    nodes: &Buf<UVec4>,
    fates: &mut Buf<u32>,
) {
    // The clusters that a workgroup keeps begin as far before its own.
    let first = block * BLOCK;
    lanes!(group, |lane| {
        let mut k = lane;
        while k < KEPT {
            let i = (first + k).wrapping_sub(2 * RADIUS);
            if i < count {
                let Bounds { lo, hi } = Binary::load(nodes, clusters.at(from + i)).bounds;
                boxes.put(k, lo.x.to_bits());
                boxes.put(KEPT + k, lo.y.to_bits());
                boxes.put(2 * KEPT + k, lo.z.to_bits());
                boxes.put(3 * KEPT + k, hi.x.to_bits());
                boxes.put(4 * KEPT + k, hi.y.to_bits());
                boxes.put(5 * KEPT + k, hi.z.to_bits());
                boxes.put(6 * KEPT + k, area(&Bounds { lo, hi }).to_bits());
            }
            k += LANES;
        }
    });
    lanes!(group, |lane| {
        let i = (first + lane).wrapping_sub(RADIUS);
        // How far it is to the neighbour, from as far before as may be; to itself if there is none.
        let mut best = RADIUS;
        if i < count && is_forced {
            if (i ^ 1) < count {
                best = RADIUS + (i ^ 1) - i;
            }
        } else if i < count {
            let (own, own_area) = kept(boxes, lane + RADIUS);
            let mut least = f32::INFINITY;
            let mut k = 0;
            while k <= 2 * RADIUS {
                let other = (i + k).wrapping_sub(RADIUS);
                if other < count && other != i {
                    let (bounds, other_area) = kept(boxes, lane + k);
                    // The surface that they have together beyond their own, and something for what is large: with the
                    // surface alone large ones wait for each other longer, and the hierarchy is deeper.
                    let cost = 1.5 * area(&own.or(&bounds)) - (own_area + other_area);
                    // Of equal costs the one that both would choose.
                    let so_far = (i + best).wrapping_sub(RADIUS);
                    if cost < least || (cost == least && (i ^ other) < (i ^ so_far)) {
                        least = cost;
                        best = k;
                    }
                }
                k += 1;
            }
        }
        found.put(lane, best);
    });
    let mut own = PerLane::<u32, { LANES as usize }>::default();
    lanes!(group, |lane| {
        let mut fate = GONE;
        if is_own(lane, first, count) {
            let to = found.at(lane);
            let is_mutual = to != RADIUS && found.at(lane + to - RADIUS) + to == 2 * RADIUS;
            fate = if !is_mutual {
                0
            } else if to > RADIUS {
                (to - RADIUS) << PARTNER
            } else {
                GONE
            };
        }
        sums.put(word(CLUSTERS, lane), ((fate & GONE) == 0) as u32);
        sums.put(word(PAIRS, lane), ((fate & GONE) == 0 && fate != 0) as u32);
        own.put(lane, fate);
    });
    scan(group, 2, sums, parts);
    lanes!(group, |lane| {
        if is_own(lane, first, count) {
            let (cluster, pair) = (before(sums, parts, CLUSTERS, lane), before(sums, parts, PAIRS, lane));
            fates.put(first + lane - RADIUS, own.at(lane) | cluster | pair << PLACE_BITS);
        }
    });
}

/// Whether any two neighbours become one, which halves their number each round. No node lies deeper than there are
/// rounds.
#[inline(always)]
pub(super) fn is_forced(round: u32, count: u32) -> bool {
    let rounds = 32 - (count - 1).leading_zeros();
    round + rounds >= WideNode::MAX_DEPTH
}

/// Finds the fates of the clusters in block `group.id`, and how many there are of each kind.
pub fn nearest(
    group: Group,
    boxes: &mut [u32; BOXES],
    found: &mut [u32; FOUND],
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    job: &Buf<u32>,
    record: &Buf<u32>,
    clusters: &Buf<u32>,
    nodes: &Buf<UVec4>,
    fates: &mut Buf<u32>,
    totals: &mut Buf<UVec2>,
) {
    let (count, round) = (record.at(COUNT), record.at(ROUND));
    let here = (list(job.at(JOB_TRIANGLES), round), count, is_forced(round, count));
    of_block(group, boxes, found, sums, parts, group.id, here, clusters, nodes, fates);
    lanes!(group, ..1, |_lane| {
        // Workgroups come in whole rows.
        if group.id < count.div_ceil(BLOCK) {
            totals.put(group.id, UVec2::new(number(parts, CLUSTERS), number(parts, PAIRS)));
        }
    });
}

/// Where the clusters of a round begin: in turn in one half of their list and the other.
#[inline(always)]
pub(super) fn list(triangles: u32, round: u32) -> u32 {
    (round & 1) * triangles
}

kernel! {
    /// [`nearest`] over the blocks of a round.
    group NEAREST = nearest, threads 256, shared [boxes: BOXES, found: FOUND, sums: SUMS, parts: PARTS], {
        0 job: read u32, 1 record: read u32, 2 clusters: read u32, 3 nodes: read UVec4, 4 fates: write u32,
        5 totals: write UVec2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However few become one while they may choose.
    #[test]
    fn there_are_no_more_rounds_than_a_node_may_lie_deep() {
        for count in [2, 3, 64, 65, 1000, 1 << 20, (1 << 27) + 1] {
            let (mut left, mut round) = (count, 0);
            while left > 1 {
                left = if is_forced(round, left) { left.div_ceil(2) } else { left - 1 };
                round += 1;
            }
            assert!(round <= WideNode::MAX_DEPTH, "{count} take {round}");
        }
    }
}
