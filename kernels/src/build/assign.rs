//! Gives what the branches of a round became its places: an exclusive scan by one workgroup.

use super::{
    ARGS_TREELETS, ROUND_EARLIER, ROUND_FROM, ROUND_NUMBER, ROUND_ROOM, ROUND_TOP, ROUND_TREELETS,
    STATE_ROUNDS, STATE_STATUS, STATE_TOP, STATE_TREELETS,
    branch::{Next, branches, put_round},
    scan::{self, LANES, before, scan, total, word},
};
use crate::{
    Group,
    glam::UVec4,
    mem::{Atomics, Buf, Slots},
    put_groups,
};
use raykd_shared::{BuildParams, status};

// What is scanned: treelets, splits, branches that are left, and the room for their references.
const KINDS: u32 = 4;
const SUMS: usize = scan::sums(KINDS);
const PARTS: usize = scan::blocks(KINDS);

/// What branch `k` became, nothing from `end` on.
#[inline(always)]
fn became(k: u32, end: u32, sizes: &Buf<UVec4>) -> UVec4 {
    if k < end { sizes.at(k) } else { UVec4::ZERO }
}

/// Writes the place of branch `k`, if it is before `end`; the next one's comes behind `size`.
#[inline(always)]
fn placed(k: u32, end: u32, place: UVec4, size: UVec4, places: &mut Buf<UVec4>) -> UVec4 {
    if k < end {
        places.put(k, place);
    }
    place + UVec4::new(size.x, 2 * size.y, size.z, size.w)
}

/// Places what each branch of a round became: its first treelet, its first node but the root, its first branch of the
/// next round, and that one's room.
pub fn assign(
    group: Group,
    sums: &mut [u32; SUMS],
    parts: &mut [u32; PARTS],
    params: &Buf<BuildParams>,
    round: &Buf<u32>,
    sizes: &Buf<UVec4>,
    places: &mut Buf<UVec4>,
    next: &mut Buf<u32>,
    state: &mut Buf<u32>,
) {
    let number = if state.at(STATE_STATUS) == 0 { round.at(ROUND_NUMBER) } else { 0 };
    let share = number.div_ceil(LANES);
    lanes!(group, |lane| {
        let mut all = UVec4::ZERO;
        let mut k = lane * share;
        let end = if k + share < number { k + share } else { number };
        while k < end {
            // Read side by side: a GPU would wait for each.
            let (a, b) = (became(k, end, sizes), became(k + 1, end, sizes));
            let (c, d) = (became(k + 2, end, sizes), became(k + 3, end, sizes));
            all += (a + b) + (c + d);
            k += 4;
        }
        sums.put(word(0, lane), all.x);
        sums.put(word(1, lane), all.y);
        sums.put(word(2, lane), all.z);
        sums.put(word(3, lane), all.w);
    });
    scan(group, KINDS, sums, parts);
    let (from, top, treelets, room) =
        (round.at(ROUND_FROM), round.at(ROUND_TOP), round.at(ROUND_TREELETS), round.at(ROUND_ROOM));
    lanes!(group, |lane| {
        let sum = |kind: u32| before(sums, parts, kind, lane);
        let mut place =
            UVec4::new(treelets + sum(0), top + 2 * sum(1), from + number + sum(2), room + sum(3));
        let mut k = lane * share;
        let end = if k + share < number { k + share } else { number };
        while k < end {
            let (a, b) = (became(k, end, sizes), became(k + 1, end, sizes));
            let (c, d) = (became(k + 2, end, sizes), became(k + 3, end, sizes));
            place = placed(k, end, place, a, places);
            place = placed(k + 1, end, place, b, places);
            place = placed(k + 2, end, place, c, places);
            place = placed(k + 3, end, place, d, places);
            k += 4;
        }
        if lane == 0 {
            let all = |kind: u32| total(KINDS, parts, kind);
            let left = all(2);
            let earlier = round.at(ROUND_EARLIER) + (number > 0) as u32;
            let after = Next {
                earlier,
                from: from + number,
                number: left,
                top: top + 2 * all(1),
                treelets: treelets + all(0),
                room: room + all(3),
            };
            let params = params.at(0);
            let fits = after.treelets <= params.treelets
                && after.top <= 2 * params.treelets
                && after.from + left <= branches(params.treelets)
                && after.room <= params.treelet_refs;
            put_round(next, if fits { after } else { Next { number: 0, ..after } });
            if number > 0 {
                let ready = if fits && left == 0 { after.treelets } else { 0 };
                state.put(STATE_TOP, after.top);
                state.put(STATE_ROUNDS, earlier);
                state.put(STATE_TREELETS, ready);
                put_groups(state, ARGS_TREELETS, ready);
                if !fits {
                    state.or(STATE_STATUS, status::CAPACITY);
                }
            }
        }
    });
}

kernel! {
    /// [`assign`], by one workgroup.
    group ASSIGN = assign, threads 256, shared [sums: SUMS, parts: PARTS], {
        0 params: read BuildParams, 1 round: read u32, 2 sizes: read UVec4, 3 places: write UVec4, 4 next: write u32,
        5 state: write u32,
    }
}
