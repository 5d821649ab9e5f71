//! Lists the triangles that take part, in their order.

use super::{BLOCK, JOB_TRIANGLES, MARKS};
use crate::mem::{Buf, Slots};

/// Lists triangle `t`, if it is marked.
pub fn collect(t: u32, job: &Buf<u32>, marks: &Buf<u32>, counts: &Buf<u32>, kept: &mut Buf<u32>) {
    if t < job.at(JOB_TRIANGLES) {
        let (word, bit) = (t / 32, t % 32);
        let marked = marks.at(word);
        if (marked >> bit) & 1 != 0 {
            let block = t / BLOCK;
            let mut to = counts.at(block) + (marked & ((1 << bit) - 1)).count_ones();
            let mut before = block * MARKS;
            while before < word {
                to += marks.at(before).count_ones();
                before += 1;
            }
            kept.put(to, t);
        }
    }
}

kernel! {
    /// [`collect`] over all triangles.
    map COLLECT = collect, threads 256, {
        0 job: read u32, 1 marks: read u32, 2 counts: read u32, 3 kept: write u32,
    }
}
