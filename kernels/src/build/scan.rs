//! Exclusive scan of several sums over the 1024 lanes of one workgroup.

use crate::{Group, mem::Table};

/// Lanes of a scanning workgroup.
pub(super) const LANES: u32 = 1024;
const BLOCK: u32 = 32;
const BLOCKS: u32 = LANES / BLOCK;

/// Words for the sums of `kinds` kinds: what each lane adds, then what comes before it in its block of lanes.
pub(super) const fn sums(kinds: u32) -> usize {
    (kinds * LANES) as usize
}

/// Words for the blocks: what comes before each block, then the total of each kind.
pub(super) const fn blocks(kinds: u32) -> usize {
    (kinds * BLOCKS + kinds) as usize
}

/// Scans in place: first within blocks of lanes, then over blocks.
#[inline(always)]
pub(super) fn scan(group: Group, kinds: u32, sums: &mut impl Table, blocks: &mut impl Table) {
    lanes!(group, |lane| {
        if lane < kinds * BLOCKS {
            let mut sum = 0;
            let mut i = 0;
            while i < BLOCK {
                let at = lane * BLOCK + i;
                let value = sums.at(at);
                sums.put(at, sum);
                sum += value;
                i += 1;
            }
            blocks.put(lane, sum);
        }
    });
    lanes!(group, |lane| {
        if lane < kinds {
            let mut sum = 0;
            let mut i = 0;
            while i < BLOCKS {
                let at = lane * BLOCKS + i;
                let value = blocks.at(at);
                blocks.put(at, sum);
                sum += value;
                i += 1;
            }
            blocks.put(kinds * BLOCKS + lane, sum);
        }
    });
}

/// What all lanes before `lane` add to `kind`, after [`scan`].
#[inline(always)]
pub(super) fn before(sums: &impl Table, blocks: &impl Table, kind: u32, lane: u32) -> u32 {
    sums.at(kind * LANES + lane) + blocks.at(kind * BLOCKS + lane / BLOCK)
}

/// What all lanes add to `kind`, after [`scan`].
#[inline(always)]
pub(super) fn total(kinds: u32, blocks: &impl Table, kind: u32) -> u32 {
    blocks.at(kinds * BLOCKS + kind)
}
