//! Moves elements to where a digit puts them; those with the same value keep their order.

use super::{Block, LANES, VALUES, value};
use crate::{
    Group,
    build::scan::{self, before, scan, word},
    glam::UVec2,
    mem::{Atomics, Buf, PerLane, Slots},
};

const SUMS: usize = scan::sums(1);
const PARTS: usize = scan::blocks(1);
/// Words with a bit for each lane.
const MASK: u32 = LANES / 32;
/// For each value, which lanes' elements have it.
const MASKS: usize = (VALUES * MASK) as usize;

/// Deals a block of a list, 256 elements at a time.
pub fn deal(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    places: &mut [u32; VALUES as usize],
    masks: &mut [u32; MASKS],
    pass: &Buf<u32>,
    from: &Buf<UVec2>,
    counts: &Buf<u32>,
    totals: &Buf<u32>,
    to: &mut Buf<UVec2>,
) {
    let block = Block::of(group.id, pass);
    lanes!(group, |lane| {
        sums.put(
            word(0, lane),
            if lane < VALUES && block.end > 0 { totals.at(block.list * VALUES + lane) } else { 0 },
        );
        let mut i = lane;
        while i < MASKS as u32 {
            masks.put(i, 0);
            i += LANES;
        }
    });
    scan(group, 1, sums, parts);
    lanes!(group, |lane| {
        if lane < VALUES && block.end > 0 {
            places.put(lane, before(sums, parts, 0, lane) + counts.at(block.count(lane)));
        }
    });
    let mut elements = PerLane::<UVec2, { LANES as usize }>::default();
    let mut first = block.start;
    while first < block.end {
        elements.forget();
        lanes!(group, |lane| {
            if first + lane < block.end {
                let element = from.at(block.base + first + lane);
                elements.put(lane, element);
                masks.or(value(element, block.digit) * MASK + lane / 32, 1 << (lane % 32));
            }
        });
        lanes!(group, |lane| {
            if first + lane < block.end {
                let element = elements.at(lane);
                let value = value(element, block.digit);
                let mut rank = (masks.at(value * MASK + lane / 32) & ((1 << (lane % 32)) - 1)).count_ones();
                let mut word = 0;
                while word < lane / 32 {
                    rank += masks.at(value * MASK + word).count_ones();
                    word += 1;
                }
                to.put(block.base + places.at(value) + rank, element);
            }
        });
        lanes!(group, |lane| {
            if lane < VALUES {
                let mut sum = places.at(lane);
                let mut word = lane * MASK;
                while word < (lane + 1) * MASK {
                    sum += masks.at(word).count_ones();
                    masks.put(word, 0);
                    word += 1;
                }
                places.put(lane, sum);
            }
        });
        first += LANES;
    }
}

kernel! {
    /// [`deal`] over all blocks of all lists.
    group DEAL = deal, threads 256,
        shared [sums: SUMS, parts: PARTS, places: VALUES as usize, masks: MASKS], {
        0 pass: read u32, 1 from: read UVec2, 2 counts: read u32, 3 totals: read u32, 4 to: write UVec2,
    }
}
