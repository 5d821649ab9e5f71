//! Copies the triangles, and looks whether their vertices are there.

use super::{FOUND_TRIANGLE, JOB_TRIANGLES, JOB_VERTICES};
use crate::mem::{Atomics, Buf, Slots};

/// Copies index `i`.
pub fn copy(i: u32, job: &Buf<u32>, given: &Buf<u32>, indices: &mut Buf<u32>, found: &mut Buf<u32>) {
    if i < 3 * job.at(JOB_TRIANGLES) {
        let vertex = given.at(i);
        indices.put(i, vertex);
        if vertex >= job.at(JOB_VERTICES) {
            found.lower(FOUND_TRIANGLE, i / 3);
        }
    }
}

kernel! {
    /// [`copy`] over all indices.
    map INDICES = copy, threads 256, {
        0 job: read u32, 1 given: read u32, 2 indices: write u32, 3 found: write u32,
    }
}
