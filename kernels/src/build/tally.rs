//! What the children of a level's nodes need, in sums over blocks of nodes; [`super::alloc`] then gives each
//! its place.

use super::{
    LEVEL_ACTIVE,
    branch::room,
    scan::{self, LANES, scan, total, word},
};
use crate::{
    Group,
    glam::UVec2,
    mem::{Buf, Slots},
};
use raykd_shared::{
    BuildParams, Node,
    limits::{BRANCH, chunk},
};

// What is counted.
/// Pairs of tree slots.
pub const PAIRS: u32 = 0;
/// Active nodes of the next level.
pub const ACTIVE: u32 = 1;
/// Their chunks.
pub const CHUNKS: u32 = 2;
/// Their references.
pub const REFS: u32 = 3;
/// Branches.
pub const BRANCHES: u32 = 4;
/// Room for their references.
pub const BRANCH_ROOM: u32 = 5;
/// How many kinds there are.
pub const KINDS: u32 = 6;
/// Words for the sums of a block's lanes.
pub const SUMS: usize = scan::sums(KINDS);
/// Words for the sums that a scan of them needs.
pub const BLOCKS: usize = scan::blocks(KINDS);

/// Active nodes or treelets in a block.
pub const BLOCK: u32 = LANES;

/// Blocks of so many active nodes or treelets: one at least, or nothing would end the level loop.
#[inline(always)]
pub fn blocks_of(number: u32) -> u32 {
    if number > 0 { number.div_ceil(LANES) } else { 1 }
}

/// What a child of so many references adds to a lane's sums.
#[inline(always)]
fn add(sums: &mut [u32; SUMS], lane: u32, count: u32, params: &BuildParams) {
    let mut bump = |kind: u32, by: u32| sums.put(word(kind, lane), sums.at(word(kind, lane)) + by);
    if count > BRANCH {
        bump(ACTIVE, 1);
        bump(CHUNKS, count.div_ceil(chunk(params.references)));
        bump(REFS, count);
    } else {
        bump(BRANCHES, 1);
        bump(BRANCH_ROOM, room(count, params.small, 0));
    }
}

/// Counts for block `group.id`, a node a lane, and scans the counts.
#[inline(always)]
pub fn count(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; BLOCKS],
    number: u32,
    params: &BuildParams,
    planes: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
) {
    lanes!(group, |lane| {
        let mut kind = 0;
        while kind < KINDS {
            sums.put(word(kind, lane), 0);
            kind += 1;
        }
        let k = group.id * LANES + lane;
        if k < number {
            let size = sizes.at(k);
            if planes.at(k).x == Node::LEAF {
                // The node itself as a leaf.
                sums.put(word(BRANCHES, lane), 1);
                sums.put(word(BRANCH_ROOM, lane), room(size.x, params.small, 0));
            } else {
                sums.put(word(PAIRS, lane), 1);
                add(sums, lane, size.x, params);
                add(sums, lane, size.y, params);
            }
        }
    });
    scan(group, KINDS, sums, parts);
}

/// The sums of block `group.id`, if it is not alone.
pub fn tally(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; BLOCKS],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    planes: &Buf<UVec2>,
    sizes: &Buf<UVec2>,
    blocks: &mut Buf<u32>,
) {
    let number = level.at(LEVEL_ACTIVE);
    if number > LANES {
        count(group, sums, parts, number, &params.at(0), planes, sizes);
        lanes!(group, |lane| {
            if lane < KINDS {
                blocks.put(group.id * KINDS + lane, total(KINDS, parts, lane));
            }
        });
    }
}

kernel! {
    /// [`tally`] over all blocks of a level.
    group TALLY = tally, threads 256, shared [sums: SUMS, parts: BLOCKS], {
        0 params: read BuildParams, 1 level: read u32, 2 planes: read UVec2, 3 sizes: read UVec2,
        4 blocks: write u32,
    }
}
