//! Copies the vertices, and looks whether they are finite.

use super::{FOUND_VERTEX, JOB_VERTICES, is_endless};
use crate::mem::{Atomics, Buf, Slots};

/// Copies coordinate `i`.
pub fn copy(i: u32, job: &Buf<u32>, given: &Buf<u32>, positions: &mut Buf<u32>, found: &mut Buf<u32>) {
    if i < 3 * job.at(JOB_VERTICES) {
        let bits = given.at(i);
        positions.put(i, bits);
        if is_endless(bits) {
            found.lower(FOUND_VERTEX, i / 3);
        }
    }
}

kernel! {
    /// [`copy`] over all coordinates.
    map VERTICES = copy, threads 256, {
        0 job: read u32, 1 given: read u32, 2 positions: write u32, 3 found: write u32,
    }
}
