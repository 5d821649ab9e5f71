//! Rays that a kernel has left to the next, which shares those of a block among the lanes of a workgroup.

use crate::mem::Slots;

/// Rays of a workgroup. One in a hundred is left or fewer, so that a workgroup has some for its lanes to share.
pub const BLOCK: u32 = 1024;
/// Words of its marks.
pub const MARKS: usize = BLOCK as usize / 32;

/// The ray of a block that is marked with so many before it, or [`BLOCK`] if there are no more.
#[inline(always)]
pub fn marked_after(before: u32, marks: &[u32; MARKS]) -> u32 {
    let (mut rest, mut word, mut found) = (before, 0, BLOCK);
    while word < MARKS as u32 && found == BLOCK {
        let mut bits = marks.at(word);
        let count = bits.count_ones();
        if rest < count {
            while rest > 0 {
                bits &= bits - 1;
                rest -= 1;
            }
            found = 32 * word + bits.trailing_zeros();
        } else {
            rest -= count;
        }
        word += 1;
    }
    found
}

/// The phases of a workgroup: of the rays of its block those are marked that `$is_left` says, and then `$answer` runs
/// for each. Nothing happens if the outcome says that no ray is left.
macro_rules! answer_left {
    ($group:ident, $marks:ident, $job:ident, $outcome:ident, |$i:ident| $is_left:expr, |$ray:ident| $answer:expr) => {
        use $crate::trace::{
            job::{self, THREADS},
            left::{BLOCK, marked_after},
        };
        // All lanes of all workgroups see the same.
        if $outcome.at(job::OUTCOME_LEFT) != 0 {
            let number = $job.at(job::JOB_RAYS);
            // There may be more workgroups than blocks.
            let first = if $group.id > number / BLOCK { number } else { $group.id * BLOCK };
            lanes!($group, |lane| {
                if lane < MARKS as u32 {
                    $marks.put(lane, 0);
                }
            });
            lanes!($group, |lane| {
                let mut i = lane;
                while i < BLOCK && first + i < number {
                    let $i = first + i;
                    if $is_left {
                        $marks.or(i / 32, 1 << (i % 32));
                    }
                    i += THREADS;
                }
            });
            lanes!($group, |lane| {
                let mut before = lane;
                let mut running = true;
                while running {
                    let $ray = first + marked_after(before, $marks);
                    running = $ray < first + BLOCK;
                    if running {
                        $answer;
                        before += THREADS;
                    }
                }
                if !job::loops_are_whole($job) {
                    $outcome.or(job::OUTCOME_STATUS, ::raykd_shared::status::CUT_SHORT);
                }
            });
        }
    };
}
