//! Winding numbers of points looked up side by side: see [`locate`](crate::trace::locate).

use super::neighbours;
use crate::{
    Group,
    eight::{Eight, SIDE_BY_SIDE},
    glam::{UVec4, Vec4},
    math::{Digits as _, Number as _, Sides},
    mem::{Atomics as _, Buf, Slots as _},
    trace::{
        job::OUTCOME_INVALID,
        locate::{is_near, number, placed},
    },
};
use raykd_shared::{Node, TreeHeader};

/// How many times eight points a CPU takes down at once: while it loads nodes of some it compares others.
const SETS: usize = 2;
const POINTS: u32 = SETS as u32 * SIDE_BY_SIDE;

/// Finds the numbers of the first points from `first` to `end`, as far as they fill sets. Returns the first one left.
///
/// # Safety
/// The processor has these instructions.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn by_eight(
    (first, end): (u32, u32),
    header: &TreeHeader,
    regions: &Buf<UVec4>,
    points: &Buf<f32>,
    found: &mut Buf<u32>,
    outcome: &mut Buf<u32>,
) -> u32 {
    type N = Eight;
    let root = regions.at(0);
    let (word0, word1) = (N::all(f32::from_bits(root.x)), N::all(f32::from_bits(root.y)));
    let mut i = first;
    while i + POINTS <= end {
        let zero = N::all(0.0);
        let mut places = [[zero; 3]; SETS];
        let (mut within, mut far) = ([0; SETS], 0);
        let mut set = 0;
        while set < SETS {
            let mut rows = [Vec4::ZERO; 8];
            let mut k = 0;
            while k < SIDE_BY_SIDE {
                let at = 3 * (i + set as u32 * SIDE_BY_SIDE + k);
                rows[k as usize] = Vec4::new(points.at(at), points.at(at + 1), points.at(at + 2), 0.0);
                k += 1;
            }
            let columns = N::columns(&rows);
            let (mut near, mut inside) = (0xFF, 0xFF);
            let mut axis = 0;
            while axis < 3 {
                let place = placed(columns[axis], header.scale);
                near &= N::bits(is_near(place));
                let (lo, hi) = (N::all(header.lo[axis]), N::all(header.hi[axis]));
                inside &= !N::bits(place.below(lo)) & N::bits(place.below(hi));
                places[set][axis] = place;
                axis += 1;
            }
            within[set] = near & inside;
            far += (!near & 0xFF).count_ones();
            set += 1;
        }
        if far > 0 {
            outcome.add(OUTCOME_INVALID, far);
        }
        let (mut splits, mut tags) = ([word0; SETS], [word1; SETS]);
        let mut running = true;
        while running {
            running = false;
            let mut set = 0;
            while set < SETS {
                let leaves = N::leaves(tags[set]);
                let at = N::on_axis(tags[set], &places[set]);
                let child = N::child(tags[set], !at.below(splits[set]));
                running |= N::bits(leaves) != 0xFF;
                (splits[set], tags[set]) = N::nodes(regions, child, !leaves, (splits[set], tags[set]));
                set += 1;
            }
        }
        let mut set = 0;
        while set < SETS {
            let (splits, tags) = (splits[set].numbers(), tags[set].numbers());
            let mut k = 0;
            while k < SIDE_BY_SIDE {
                let leaf = Node::from_words(splits[k as usize].to_bits(), tags[k as usize].to_bits());
                let known = if within[set] >> k & 1 != 0 { number(leaf) } else { 0 };
                found.put(i + set as u32 * SIDE_BY_SIDE + k, known);
                k += 1;
            }
            set += 1;
        }
        i += POINTS;
    }
    i
}

/// Finds the numbers of the first of a workgroup's points. Returns the first one left.
#[inline(always)]
pub(in crate::trace) fn locate(
    group: &Group,
    job: &Buf<u32>,
    header: &TreeHeader,
    regions: &Buf<UVec4>,
    points: &Buf<f32>,
    found: &mut Buf<u32>,
    outcome: &mut Buf<u32>,
) -> u32 {
    let Some(range) = neighbours(group, job) else { return group.id * group.width };
    // SAFETY: that the group is usual says so.
    unsafe { by_eight(range, header, regions, points, found, outcome) }
}
