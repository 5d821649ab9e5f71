//! How many go below and above before each reference, and before each face in its list: within one block.

use super::{FACES, LEVEL_LISTS, LEVEL_REFS, LISTED, LISTS, REFERENCE, ROWS, SIDES_SHIFT, blocks, room};
use crate::{
    Group,
    build::scan::{self, LANES, before, scan, total, word},
    glam::UVec2,
    mem::{Buf, PerLane, Slots},
};
use raykd_shared::BuildParams;

const SUMS: usize = scan::sums(ROWS);
const BLOCKS: usize = scan::blocks(ROWS);

/// A code's two bits as what a lane adds: counts of both sides share a word.
#[inline(always)]
fn added(sides: u32) -> u32 {
    (sides & 1) | ((sides & 2) << 15)
}

/// Ranks one block of all rows; ranks share their words with where the reference or face itself goes.
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
    let (number, lists) = (level.at(LEVEL_REFS), level.at(LEVEL_LISTS));
    let room = room(&params.at(0));
    let base = group.id * LANES;
    // Two bits a row.
    let mut own = PerLane::<u32, { LANES as usize }>::default();
    lanes!(group, |lane| {
        let i = base + lane;
        let code = if i < number { codes.at(i) } else { 0 };
        let mut all = code & ((1 << (2 * FACES)) - 1);
        let mut row = 0;
        while row < FACES {
            sums.put(word(row, lane), added(code >> (2 * row)));
            row += 1;
        }
        if lists > 0 {
            let mut list = 0;
            while list < LISTS {
                let mut sides = 0;
                if (code & LISTED) != 0 {
                    sides = codes.at(faces.at(list * room + i).y & REFERENCE) & 3;
                }
                all |= sides << (2 * (FACES + list));
                sums.put(word(FACES + list, lane), added(sides));
                list += 1;
            }
        }
        own.put(lane, all);
    });
    let rows = FACES + lists;
    scan(group, rows, sums, parts);
    lanes!(group, |lane| {
        // One past the last, so that ends of cells have ranks too.
        if base + lane <= number {
            let mut row = 0;
            while row < rows {
                let sides = own.at(lane) >> (2 * row) & 3;
                let rank = before(sums, parts, row, lane) | (sides << SIDES_SHIFT);
                ranks.put(row * (room + 1) + base + lane, rank);
                row += 1;
            }
        }
        if lane < rows && group.id < blocks(number) {
            let all = total(rows, parts, lane);
            totals.put(lane * blocks(room) + group.id, UVec2::new(all & 0xFFFF, all >> 16));
        }
    });
}

kernel! {
    /// [`rank`] over all blocks of a level.
    group RANK = rank, threads 256, shared [sums: SUMS, parts: BLOCKS], {
        0 params: read BuildParams, 1 level: read u32, 2 codes: read u32, 3 faces: read UVec2, 4 ranks: write u32,
        5 totals: write UVec2,
    }
}
