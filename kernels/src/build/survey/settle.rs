//! Brings coordinates to what the kernels see: no dust, no -0, times a power of two.

use super::{JOB_DUST, JOB_SCALE, JOB_VERTICES, size};
use crate::mem::{Buf, Slots};

/// The bits of a number times `2^(scale - 127)`: 0 if there is no room for it, or it is dust.
#[inline(always)]
fn scaled(bits: u32, dust: u32, scale: u32) -> u32 {
    let magnitude = size(bits);
    let sign = bits & 0x8000_0000;
    // The place of the leading digit, and the digits behind it: subnormal numbers lack them.
    let missing = if magnitude < 0x0080_0000 { magnitude.leading_zeros() as i32 - 8 } else { 0 };
    let field = if missing > 0 { 1 - missing } else { (magnitude >> 23) as i32 };
    let digits = (magnitude << missing) & 0x007F_FFFF;
    let moved = field + scale as i32 - 127;
    if magnitude == 0 || magnitude < dust {
        0
    } else if scale == 127 {
        bits
    } else if (moved - 1) as u32 >= 254 {
        // No normal number.
        0
    } else {
        sign | ((moved as u32) << 23) | digits
    }
}

/// Settles coordinate `i`.
pub fn settle(i: u32, job: &Buf<u32>, positions: &mut Buf<u32>) {
    if i < 3 * job.at(JOB_VERTICES) {
        positions.put(i, scaled(positions.at(i), job.at(JOB_DUST), job.at(JOB_SCALE)));
    }
}

kernel! {
    /// [`settle`] over all coordinates.
    map SETTLE = settle, threads 256, { 0 job: read u32, 1 positions: write u32 }
}
