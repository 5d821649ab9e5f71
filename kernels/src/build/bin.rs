//! Counts of references per bin, for one chunk of one node.
//!
//! Min-max binning (Shevtsov, Soupikov & Kapustin 2007): one counter for the bin where a box starts, one for
//! where it ends; sums of them give the exact number of boxes on either side of every bin border, up to the
//! rounding of the bin's index. The tree does not depend on that: `count` and `scatter` use the plane itself.

use super::{LEVEL_CHUNKS, chunk_of};
use crate::{
    Group,
    glam::{UVec4, Vec4},
    math::div,
    mem::{Atomics, Buf, Slots},
    trace::frame::component,
};
use raykd_shared::limits::BINS;

const LANES: u32 = 128;
/// Words of a chunk's histogram: starts in the low half, ends in the high half.
pub const HIST_WORDS: u32 = 3 * BINS;
const WORDS: usize = HIST_WORDS as usize;

/// The bin of coordinate `x`.
#[inline(always)]
fn bin_of(x: f32, lo: f32, per_bin: f32) -> u32 {
    let f = (x - lo) * per_bin;
    // Boxes reach beyond the node; what starts before it starts in its first bin.
    if f < 1.0 {
        0
    } else if f >= (BINS - 1) as f32 {
        BINS - 1
    } else {
        f as u32
    }
}

/// Histogram of chunk `group.id`.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn bin(
    group: Group,
    hist: &mut [u32; WORDS],
    rate: &mut [u32; 3],
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    refs: &Buf<u32>,
    boxes: &Buf<Vec4>,
    hists: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) {
        let (_, item, start, count) = chunk_of(group.id, chunks, active);
        lanes!(group, |lane| {
            if lane < HIST_WORDS {
                hist.put(lane, 0);
            }
            if lane < 3 {
                let d = component(item.hi, lane) - component(item.lo, lane);
                rate.put(lane, if d < super::FLAT { 0 } else { div(BINS as f32, d).to_bits() });
            }
        });
        lanes!(group, |lane| {
            let rate_x = f32::from_bits(rate.at(0));
            let rate_y = f32::from_bits(rate.at(1));
            let rate_z = f32::from_bits(rate.at(2));
            let mut i = lane;
            while i < count {
                let id = refs.at(start + i);
                let (lo, hi) = (boxes.at(2 * id), boxes.at(2 * id + 1));
                hist.add(bin_of(lo.x, item.lo.x, rate_x), 1);
                hist.add(bin_of(hi.x, item.lo.x, rate_x), 1 << 16);
                hist.add(BINS + bin_of(lo.y, item.lo.y, rate_y), 1);
                hist.add(BINS + bin_of(hi.y, item.lo.y, rate_y), 1 << 16);
                hist.add(2 * BINS + bin_of(lo.z, item.lo.z, rate_z), 1);
                hist.add(2 * BINS + bin_of(hi.z, item.lo.z, rate_z), 1 << 16);
                i += LANES;
            }
        });
        lanes!(group, |lane| {
            if lane < HIST_WORDS {
                hists.put(group.id * HIST_WORDS + lane, hist.at(lane));
            }
        });
    }
}

kernel! {
    /// [`bin`] over all chunks of a level.
    group BIN = bin, threads 128, shared [hist: WORDS, rate: 3], {
        0 level: read u32, 1 active: read UVec4, 2 chunks: read u32, 3 refs: read u32, 4 boxes: read Vec4,
        5 hists: write u32,
    }
}
