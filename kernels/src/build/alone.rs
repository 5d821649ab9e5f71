//! Nodes of one chunk, and below [`raykd_shared::BuildParams::alone`] all nodes: what [`super::bin`],
//! [`super::split`] and [`super::count`] do in passes over the others, by one workgroup at once, which needs no
//! histogram in memory.

use super::{
    Item, LEVEL_ACTIVE, LEVEL_DEPTH,
    bin::{HIST_WORDS, TABLE, fill},
    count::sides_of,
    split::{FOUND, chosen, find},
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::{BuildParams, limits::CHUNK, rule};

/// Chooses the plane of active node `group.id` and finds its children's sizes; or, if it has several chunks and
/// the level is above [`BuildParams::alone`], clears room for its histogram and those sizes.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
pub fn alone(
    group: Group,
    table: &mut [u32; TABLE],
    rate: &mut [u32; 3],
    found: &mut [u32; FOUND],
    sums: &mut [u32; 2],
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    refs: &mut Buf<UVec4>,
    planes: &mut Buf<UVec2>,
    sizes: &mut Buf<u32>,
    hists: &mut Buf<u32>,
    sides: &mut Buf<UVec2>,
) {
    let node = group.id;
    if node < level.at(LEVEL_ACTIVE) {
        let item = Item::load(active, node);
        let depth = level.at(LEVEL_DEPTH);
        if item.is_alone() | (depth >= params.at(0).alone) {
            let params = params.at(0);
            fill(group, table, rate, &item, refs, item.first, item.count);
            find(group, table, found, &params, depth, &item);
            let plane = chosen(table, found);
            let clips = (params.rule & rule::CLIP) != 0;
            let mut done = 0;
            while done < item.count {
                let rest = item.count - done;
                let number = if rest < CHUNK { rest } else { CHUNK };
                sides_of(group, sums, clips, positions, indices, refs, item.first + done, number, plane);
                lanes!(group, ..2, |lane| {
                    if lane == 0 {
                        planes.put(node, plane.words());
                        sides.put(item.extra + done / CHUNK, UVec2::new(sums.at(0), sums.at(1)));
                    }
                    let before = if done == 0 { 0 } else { sizes.at(2 * node + lane) };
                    sizes.put(2 * node + lane, before + sums.at(lane));
                });
                done += CHUNK;
            }
        } else {
            let step = group.sharers();
            lanes!(group, ..step, |lane| {
                let mut word = lane;
                while word < HIST_WORDS {
                    hists.put(node * HIST_WORDS + word, 0);
                    word += step;
                }
                let mut child = lane;
                while child < 2 {
                    sizes.put(2 * node + child, 0);
                    child += step;
                }
            });
        }
    }
}

kernel! {
    /// [`alone`] over all active nodes of a level.
    group ALONE = alone, threads 96, shared [table: TABLE, rate: 3, found: FOUND, sums: 2], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32,
        4 active: read UVec4, 5 refs: write UVec4, 6 planes: write UVec2, 7 sizes: write u32, 8 hists: write u32,
        9 sides: write UVec2,
    }
}
