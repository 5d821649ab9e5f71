//! Gives every treelet its place in the final lists: an exclusive scan of their sizes. One workgroup.

use super::{
    LEVEL_ACTIVE, STATE_DEPTH, STATE_NODES, STATE_REFS, STATE_STATUS, STATE_TOP, STATE_TREELETS,
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::status;

const LANES: u32 = 1024;
const WIDTH: usize = LANES as usize;

/// Places all treelets; raises [`status::LEVELS`] if the level loop left active nodes.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn place(
    group: Group,
    nodes: &mut [u32; WIDTH],
    refs: &mut [u32; WIDTH],
    deep: &mut [u32; WIDTH],
    level: &Buf<u32>,
    sizes: &Buf<UVec4>,
    places: &mut Buf<UVec2>,
    state: &mut Buf<u32>,
) {
    let number = if state.at(STATE_STATUS) == 0 { state.at(STATE_TREELETS) } else { 0 };
    let top = state.at(STATE_TOP);
    let run = number.div_ceil(LANES);
    lanes!(group, |lane| {
        let (mut n, mut r, mut d) = (0, 0, 0);
        let mut i = 0;
        while i < run {
            let k = lane * run + i;
            if k < number {
                let size = sizes.at(k);
                n += size.x;
                r += size.y;
                d = if size.z > d { size.z } else { d };
            }
            i += 1;
        }
        nodes.put(lane, n);
        refs.put(lane, r);
        deep.put(lane, d);
    });
    lanes!(group, |lane| {
        // Three serial scans of 1024 words; a few microseconds, once a build.
        if lane < 2 {
            let mut sum = if lane == 0 { top } else { 0 };
            let mut i = 0;
            while i < LANES {
                let value = if lane == 0 { nodes.at(i) } else { refs.at(i) };
                if lane == 0 {
                    nodes.put(i, sum);
                } else {
                    refs.put(i, sum);
                }
                sum += value;
                i += 1;
            }
            state.put(if lane == 0 { STATE_NODES } else { STATE_REFS }, sum);
        } else if lane == 2 {
            let mut most = 0;
            let mut i = 0;
            while i < LANES {
                let value = deep.at(i);
                most = if value > most { value } else { most };
                i += 1;
            }
            state.put(STATE_DEPTH, most);
            if level.at(LEVEL_ACTIVE) > 0 {
                let old = state.at(STATE_STATUS);
                state.put(STATE_STATUS, old | status::LEVELS);
            }
        }
    });
    lanes!(group, |lane| {
        let (mut n, mut r) = (nodes.at(lane), refs.at(lane));
        let mut i = 0;
        while i < run {
            let k = lane * run + i;
            if k < number {
                let size = sizes.at(k);
                places.put(k, UVec2::new(n, r));
                n += size.x;
                r += size.y;
            }
            i += 1;
        }
    });
}

kernel! {
    /// [`place`]; a single workgroup.
    group PLACE = place, threads 1024, shared [nodes: WIDTH, refs: WIDTH, deep: WIDTH], {
        0 level: read u32, 1 sizes: read UVec4, 2 places: write UVec2, 3 state: write u32,
    }
}
