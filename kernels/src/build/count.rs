//! How many references of a chunk go below and above its node's plane.

use super::{LEVEL_CHUNKS, chunk_of, plane_of, side};
use crate::{
    Group,
    glam::{UVec2, UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
};

const LANES: u32 = 128;

/// Counts of chunk `group.id`.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn count(
    group: Group,
    sums: &mut [u32; 2],
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    refs: &Buf<u32>,
    boxes: &Buf<Vec4>,
    planes: &Buf<UVec2>,
    sides: &mut Buf<UVec2>,
) {
    if group.id < level.at(LEVEL_CHUNKS) {
        let (node, _, start, number) = chunk_of(group.id, chunks, active);
        let plane = plane_of(planes, node);
        lanes!(group, |lane| {
            if lane < 2 {
                sums.put(lane, 0);
            }
        });
        lanes!(group, |lane| {
            let (mut below, mut above) = (0, 0);
            let mut i = lane;
            while i < number {
                let s = side(boxes, refs.at(start + i), plane);
                below += s & 1;
                above += s >> 1;
                i += LANES;
            }
            if below + above > 0 {
                sums.add(0, below);
                sums.add(1, above);
            }
        });
        lanes!(group, |lane| {
            if lane == 0 {
                sides.put(group.id, UVec2::new(sums.at(0), sums.at(1)));
            }
        });
    }
}

kernel! {
    /// [`count`] over all chunks of a level.
    group COUNT = count, threads 128, shared [sums: 2], {
        0 level: read u32, 1 active: read UVec4, 2 chunks: read u32, 3 refs: read u32, 4 boxes: read Vec4,
        5 planes: read UVec2, 6 sides: write UVec2,
    }
}
