//! The rounds of few clusters, by one workgroup; then the first level of wide nodes.

use super::{
    COUNT, FIRST, JOB_TRIANGLES, PARTS, ROUND, STATE_CLUSTERS, STATE_NEXT, STATE_NODES, SUMS, merge,
    nearest::{BLOCK, BOXES, CLUSTERS, FOUND, PAIRS, is_forced, list, of_block},
    number, record,
    scan::LANES,
};
use crate::{
    Group,
    glam::{UVec2, UVec4, Vec4},
    mem::{Buf, Slots},
};

/// Runs rounds until there is one cluster, if the last record's are few; `queue` gets the root.
pub fn finish(
    group: Group,
    boxes: &mut [u32; BOXES],
    found: &mut [u32; FOUND],
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    job: &Buf<u32>,
    last: &Buf<u32>,
    clusters: &mut Buf<u32>,
    nodes: &mut Buf<UVec4>,
    children: &mut Buf<UVec2>,
    costs: &mut Buf<Vec4>,
    fates: &mut Buf<u32>,
    queue: &mut Buf<UVec4>,
    level: &mut Buf<u32>,
    state: &mut Buf<u32>,
) {
    let triangles = job.at(JOB_TRIANGLES);
    let (mut count, mut first, mut round) = (last.at(COUNT), last.at(FIRST), last.at(ROUND));
    while count > 1 && count <= BLOCK {
        let from = list(triangles, round);
        let here = (from, count, is_forced(round, count));
        of_block(group, boxes, found, sums, parts, 0, here, clusters, nodes, fates);
        group.meet_at_buffers();
        let places = (from, list(triangles, round + 1), first);
        lanes!(group, |lane| {
            if lane < count {
                let before = UVec2::new(0, 0);
                merge::one(lane, triangles, places, before, fates, clusters, nodes, children, costs);
            }
        });
        group.meet_at_buffers();
        count = number(parts, CLUSTERS);
        first += number(parts, PAIRS);
        round += 1;
    }
    lanes!(group, ..1, |_lane| {
        let roots = (count == 1) as u32;
        if roots > 0 {
            queue.put(0, UVec4::new(clusters.at(list(triangles, round)), 0, 0, 0));
        }
        record(level, roots, LANES, 0, 0);
        state.put(STATE_CLUSTERS, count);
        state.put(STATE_NODES, 0);
        state.put(STATE_NEXT, roots);
    });
}

kernel! {
    /// [`finish`]; a single workgroup.
    group FINISH = finish, threads 256, shared [boxes: BOXES, found: FOUND, sums: SUMS, parts: PARTS], {
        0 job: read u32, 1 last: read u32, 2 clusters: write u32, 3 nodes: write UVec4, 4 children: write UVec2,
        5 costs: write Vec4, 6 fates: write u32, 7 queue: write UVec4, 8 level: write u32, 9 state: write u32,
    }
}
