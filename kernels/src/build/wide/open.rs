//! The children of the wide nodes of a level, and the slots that they take.

use super::{
    Binary, COUNT, FIRST, JOB_TRIANGLES, PARTS, SUMS, centre, children_of, number,
    scan::{LANES, before, scan, word},
    share,
};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    kernel::Bits,
    mem::{Buf, Slots},
};

/// Children of a wide node.
pub(super) const SLOTS: u32 = 8;
/// No child is in a slot.
pub(super) const NONE: u32 = u32::MAX;
/// Words for the children that lanes find.
const FOUND: usize = (SLOTS * LANES) as usize;
/// Bits of how many a child may be represented by.
const MOST_BITS: u32 = 4;

/// Finds what represents node `i` by at most eight wide nodes or slots with triangles, and says how many those are.
#[inline(always)]
fn represent(
    i: u32,
    lane: u32,
    triangles: u32,
    nodes: &Buf<UVec4>,
    children: &Buf<UVec2>,
    found: &mut [u32; FOUND],
) -> u32 {
    let at = |k: u32| k * LANES + lane;
    let node = Binary::load(nodes, i);
    if node.is_slot() {
        found.put(lane, i);
        return 1;
    }
    let two = children_of(children, triangles, i);
    let low = share(node.shares, SLOTS);
    found.put(at(0), two.x);
    found.put(at(1), two.y);
    // By how many each may be represented: together by eight.
    let mut mosts = low | (SLOTS - low) << MOST_BITS;
    let (mut number, mut k) = (2, 0);
    while k < number {
        let child = found.at(at(k));
        let shares = Binary::load(nodes, child).shares;
        let mut most = mosts >> (k * MOST_BITS) & ((1 << MOST_BITS) - 1);
        let mut low = 0;
        while low == 0 && most > 1 {
            low = share(shares, most);
            if low == 0 {
                most -= 1;
            }
        }
        if low == 0 {
            k += 1;
        } else {
            let two = children_of(children, triangles, child);
            found.put(at(k), two.x);
            found.put(at(number), two.y);
            mosts &= !(((1 << MOST_BITS) - 1) << (k * MOST_BITS));
            mosts |= low << (k * MOST_BITS) | (most - low) << (number * MOST_BITS);
            number += 1;
        }
    }
    number
}

/// Gives each child in turn the slot, of those that are free, where it lies farthest that way from the middle. Says how
/// many are nodes, and how many triangles the others have.
#[inline(always)]
fn give_slots(
    i: u32,
    lane: u32,
    number: u32,
    to: u32,
    nodes: &Buf<UVec4>,
    found: &[u32; FOUND],
    slots: &mut Buf<u32>,
) -> (u32, u32) {
    let middle = centre(&Binary::load(nodes, i).bounds);
    let (mut free, mut wide, mut own) = ((1 << SLOTS) - 1, 0, 0);
    let mut k = 0;
    while k < number {
        let at = found.at(k * LANES + lane);
        let child = Binary::load(nodes, at);
        let away = centre(&child.bounds) - middle;
        let (mut farthest, mut chosen) = (f32::NEG_INFINITY, 0);
        for slot in Bits(free) {
            let along = |bit: u32, x: f32| if (slot >> bit & 1) == 1 { x } else { -x };
            let far = along(0, away.x) + along(1, away.y) + along(2, away.z);
            if far > farthest {
                farthest = far;
                chosen = slot;
            }
        }
        slots.put(to + chosen, at);
        if child.is_slot() {
            own += child.count;
        } else {
            wide += 1;
        }
        free ^= 1 << chosen;
        k += 1;
    }
    for slot in Bits(free) {
        slots.put(to + slot, NONE);
    }
    (wide, own)
}

/// Opens a block of the wide nodes of a level. `queue` then tells how many wide nodes the children of those before each
/// in its block are, and how many triangles it has itself.
pub fn open(
    group: Group,
    found: &mut [u32; FOUND],
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    job: &Buf<u32>,
    level: &Buf<u32>,
    nodes: &Buf<UVec4>,
    children: &Buf<UVec2>,
    queue: &mut Buf<UVec4>,
    slots: &mut Buf<u32>,
    totals: &mut Buf<UVec2>,
) {
    let (triangles, count, first) = (job.at(JOB_TRIANGLES), level.at(COUNT), level.at(FIRST));
    lanes!(group, |lane| {
        let i = group.id * LANES + lane;
        let mut wide = 0;
        if i < count {
            let entry = queue.at(first + i);
            let number = represent(entry.x, lane, triangles, nodes, children, found);
            let own;
            (wide, own) = give_slots(entry.x, lane, number, SLOTS * (first + i), nodes, found, slots);
            queue.put(first + i, UVec4::new(entry.x, entry.y, 0, own));
        }
        sums.put(word(0, lane), wide);
        sums.put(word(1, lane), (i < count) as u32);
    });
    scan(group, 2, sums, parts);
    lanes!(group, |lane| {
        let i = group.id * LANES + lane;
        if i < count {
            let entry = queue.at(first + i);
            queue.put(first + i, UVec4::new(entry.x, entry.y, before(sums, parts, 0, lane), entry.w));
        }
        // Workgroups come in whole rows.
        if lane == 0 && group.id < count.div_ceil(LANES) {
            totals.put(group.id, UVec2::new(number(parts, 0), number(parts, 1)));
        }
    });
}

kernel! {
    /// [`open`] over the blocks of a level.
    group OPEN = open, threads 256, shared [found: FOUND, sums: SUMS, parts: PARTS], {
        0 job: read u32, 1 level: read u32, 2 nodes: read UVec4, 3 children: read UVec2, 4 queue: write UVec4,
        5 slots: write u32, 6 totals: write UVec2,
    }
}
