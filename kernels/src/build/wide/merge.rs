//! Makes the clusters of the next round, and the nodes of those that are two clusters of this.

use super::{
    Binary, COUNT, FIRST, IS_NODE, JOB_TRIANGLES, ROUND, SHARE_BITS, area,
    nearest::{BLOCK, Fate, list},
};
use crate::{
    glam::{UVec2, UVec4, Vec4},
    math::low,
    mem::{Buf, Slots},
};
use raykd_shared::WideNode;

/// What a step to a node costs, and the test of a triangle.
const STEP: f32 = 1.0;
const TEST: f32 = 0.3;

/// What it costs to represent a node by at most one to seven wide nodes or slots with triangles, in units of surface.
type Costs = [f32; 7];

/// What it costs to represent a triangle, of a box with so much surface, or node `i`.
#[inline(always)]
fn costs_of(costs: &Buf<Vec4>, triangles: u32, i: u32, area: f32) -> Costs {
    if i < triangles {
        [TEST * area; 7]
    } else {
        let (a, b) = (costs.at(2 * (i - triangles)), costs.at(2 * (i - triangles) + 1));
        [a.x, a.y, a.z, a.w, b.x, b.y, b.z]
    }
}

/// The least cost of two children together that have so many between them, and what the first gets.
macro_rules! cheapest {
    ($below:ident, $above:ident, $($share:literal + $rest:literal),+) => {{
        let mut best = (f32::INFINITY, 0);
        $(
            let cost = $below[$share - 1] + $above[$rest - 1];
            if cost < best.0 {
                best = (cost, $share);
            }
        )+
        best
    }};
}

/// Of a node with so much surface and so many triangles: what it costs, and the shares of its children.
#[inline(always)]
fn weigh(area: f32, count: u32, a: &Costs, b: &Costs) -> (Costs, u32) {
    let two = cheapest!(a, b, 1 + 1);
    let three = cheapest!(a, b, 1 + 2, 2 + 1);
    let four = cheapest!(a, b, 1 + 3, 2 + 2, 3 + 1);
    let five = cheapest!(a, b, 1 + 4, 2 + 3, 3 + 2, 4 + 1);
    let six = cheapest!(a, b, 1 + 5, 2 + 4, 3 + 3, 4 + 2, 5 + 1);
    let seven = cheapest!(a, b, 1 + 6, 2 + 5, 3 + 4, 4 + 3, 5 + 2, 6 + 1);
    let eight = cheapest!(a, b, 1 + 7, 2 + 6, 3 + 5, 4 + 4, 5 + 3, 6 + 2, 7 + 1);
    let slot = if count <= WideNode::TRIANGLES { TEST * area * count as f32 } else { f32::INFINITY };
    let node = STEP * area + eight.0;
    let one = low(slot, node);
    // Fewer may cost less.
    let or_fewer =
        |fewer: f32, (cost, share): (f32, u32)| if fewer <= cost { (fewer, 0) } else { (cost, share) };
    let two = or_fewer(one, two);
    let three = or_fewer(two.0, three);
    let four = or_fewer(three.0, four);
    let five = or_fewer(four.0, five);
    let six = or_fewer(five.0, six);
    let seven = or_fewer(six.0, seven);
    let mut shares = if node < slot { IS_NODE } else { 0 };
    shares |= two.1 | three.1 << SHARE_BITS | four.1 << (2 * SHARE_BITS) | five.1 << (3 * SHARE_BITS);
    shares |= six.1 << (4 * SHARE_BITS) | seven.1 << (5 * SHARE_BITS) | eight.1 << (6 * SHARE_BITS);
    ([one, two.0, three.0, four.0, five.0, six.0, seven.0], shares)
}

/// Makes what cluster `i` becomes. Clusters of the round begin at `from` in their list, those of the next one at `to`,
/// and new nodes at `first`. `before` counts what the blocks before its own become, of both kinds.
#[inline(always)]
pub(super) fn one(
    i: u32,
    triangles: u32,
    (from, to, first): (u32, u32, u32),
    before: UVec2,
    fates: &Buf<u32>,
    clusters: &mut Buf<u32>,
    nodes: &mut Buf<UVec4>,
    children: &mut Buf<UVec2>,
    costs: &mut Buf<Vec4>,
) {
    let fate = Fate::of(fates.at(i));
    if !fate.gone {
        let mut cluster = clusters.at(from + i);
        if fate.partner != 0 {
            let other = clusters.at(from + i + fate.partner);
            let (a, b) = (Binary::load(nodes, cluster), Binary::load(nodes, other));
            let bounds = a.bounds.or(&b.bounds);
            let count = a.count + b.count;
            let below = costs_of(costs, triangles, cluster, area(&a.bounds));
            let above = costs_of(costs, triangles, other, area(&b.bounds));
            let (all, shares) = weigh(area(&bounds), count, &below, &above);
            let made = first + before.y + fate.pair;
            Binary { bounds, count, shares }.store(nodes, made);
            children.put(made - triangles, UVec2::new(cluster, other));
            costs.put(2 * (made - triangles), Vec4::new(all[0], all[1], all[2], all[3]));
            costs.put(2 * (made - triangles) + 1, Vec4::new(all[4], all[5], all[6], 0.0));
            cluster = made;
        }
        clusters.put(to + before.x + fate.cluster, cluster);
    }
}

/// Makes what cluster `i` of a round becomes.
pub fn merge(
    i: u32,
    job: &Buf<u32>,
    record: &Buf<u32>,
    fates: &Buf<u32>,
    totals: &Buf<UVec2>,
    clusters: &mut Buf<u32>,
    nodes: &mut Buf<UVec4>,
    children: &mut Buf<UVec2>,
    costs: &mut Buf<Vec4>,
) {
    if i < record.at(COUNT) {
        let (triangles, round) = (job.at(JOB_TRIANGLES), record.at(ROUND));
        let places = (list(triangles, round), list(triangles, round + 1), record.at(FIRST));
        one(i, triangles, places, totals.at(i / BLOCK), fates, clusters, nodes, children, costs);
    }
}

kernel! {
    /// [`merge`] over the clusters of a round.
    map MERGE = merge, threads 128, {
        0 job: read u32, 1 record: read u32, 2 fates: read u32, 3 totals: read UVec2, 4 clusters: write u32,
        5 nodes: write UVec4, 6 children: write UVec2, 7 costs: write Vec4,
    }
}
