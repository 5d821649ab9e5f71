//! Where the triangles of each block begin in the list, by one workgroup; and what is wrong with a mesh that cannot be
//! used.

use super::{BLOCK, FOUND_KEPT, FOUND_TRIANGLE, FOUND_VERTEX, FOUND_WORDS, JOB_TRIANGLES, corners, vertex};
use crate::{
    Group,
    build::scan::{self, scan_counts, total},
    glam::UVec3,
    mem::{Buf, Slots},
};

const SUMS: usize = scan::sums(1);
const PARTS: usize = scan::blocks(1);

/// Replaces the counts of all blocks by the sums of those before.
pub fn offsets(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    job: &Buf<u32>,
    positions: &Buf<u32>,
    indices: &Buf<u32>,
    counts: &mut Buf<u32>,
    found: &mut Buf<u32>,
) {
    let blocks = job.at(JOB_TRIANGLES).div_ceil(BLOCK);
    scan_counts(group, sums, parts, counts, 0, blocks);
    lanes!(group, ..1, |_lane| {
        found.put(FOUND_KEPT, total(1, parts, 0));
        let (v, t) = (found.at(FOUND_VERTEX), found.at(FOUND_TRIANGLE));
        let words = if v != u32::MAX {
            vertex(positions, v)
        } else if t != u32::MAX {
            corners(indices, t)
        } else {
            UVec3::ZERO
        };
        found.put(FOUND_WORDS, words.x);
        found.put(FOUND_WORDS + 1, words.y);
        found.put(FOUND_WORDS + 2, words.z);
    });
}

kernel! {
    /// [`offsets`], once.
    group OFFSETS = offsets, threads 256, shared [sums: SUMS, parts: PARTS], {
        0 job: read u32, 1 positions: read u32, 2 indices: read u32, 3 counts: write u32, 4 found: write u32,
    }
}
