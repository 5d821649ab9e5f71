//! How many go below and above before each reference, and before each face in its list: within one block.

use super::{FACES, LEVEL_REFS, LISTED, REFERENCE, ROWS, blocks, room, row_of};
use crate::{
    Group,
    build::scan::{self, LANES, before, scan, total, word},
    glam::UVec2,
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

const SUMS: usize = scan::sums(1);
const BLOCKS: usize = scan::blocks(1);

/// Ranks one block of one row; counts of both sides share a word.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn rank(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; BLOCKS],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    codes: &Buf<u32>,
    faces: &Buf<UVec2>,
    ranks: &mut Buf<u32>,
    totals: &mut Buf<UVec2>,
) {
    let number = level.at(LEVEL_REFS);
    let (row, block) = row_of(group.id, blocks(number));
    if row < ROWS {
        let room = room(&params.at(0));
        let base = block * LANES;
        lanes!(group, |lane| {
            let i = base + lane;
            let mut sides = 0;
            if i < number {
                let code = codes.at(i);
                sides = code >> (2 * row);
                if row >= FACES {
                    sides = 0;
                    if (code & LISTED) != 0 {
                        sides = codes.at(faces.at((row - FACES) * room + i).y & REFERENCE);
                    }
                }
            }
            sums.put(word(0, lane), (sides & 1) | ((sides & 2) << 15));
        });
        scan(group, 1, sums, parts);
        lanes!(group, |lane| {
            // One past the last, so that ends of cells have ranks too.
            if base + lane <= number {
                ranks.put(row * (room + 1) + base + lane, before(sums, parts, 0, lane));
            }
            if lane == 0 {
                let all = total(1, parts, 0);
                totals.put(row * blocks(room) + block, UVec2::new(all & 0xFFFF, all >> 16));
            }
        });
    }
}

kernel! {
    /// [`rank`] over all rows and blocks of a level.
    group RANK = rank, threads 256, shared [sums: SUMS, parts: BLOCKS], {
        0 params: read BuildParams, 1 level: read u32, 2 codes: read u32, 3 faces: read UVec2, 4 ranks: write u32,
        5 totals: write UVec2,
    }
}
