//! A stack of a few entries, the oldest being lost when it is full (Horn, Sugerman, Houston & Hanrahan 2007,
//! "Interactive k-d tree GPU raytracing"), with restarts at the push-down node when it runs empty.
//!
//! Where an entry was lost and the stack is empty, the paper goes on at the last `t`; programs written after
//! it lose nodes just there. Here the level of the deepest entry lost is kept: a [`Trail`] leads back to it,
//! and the descent pushes again what is above it. Where the first entry lost begins is kept, too: what lies
//! beyond the best hit is no loss.

use super::{
    Steps,
    crossing::Crossing,
    leaf::{self, Every},
    pushdown,
    restart::Base,
    trail::Trail,
};
use crate::{
    glam::{UVec4, Vec4},
    math::{high, low},
    mem::{Buf, Slots, scratch},
    trace::{
        frame::Frame,
        intersect::{Best, strict::Strict},
        place::Place,
    },
};
use raykd_shared::{limits::MAX_DEPTH, status};

/// Bytes that a ray keeps between two leaves with a stack of `entries`, beside its best hit: entries, their
/// place, how many they are, the deepest one lost, where the first lost begins, and what `pushdown` keeps.
pub const fn state(entries: u32) -> u32 {
    16 * entries + 16 + pushdown::STATE
}

/// Finds the closest hit, or if `any` will do the best one in the first leaf that has one, with a stack of
/// `ENTRIES`, a power of two.
#[inline(always)]
pub fn walk<const ENTRIES: usize>(
    ray: &Frame,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    any: bool,
    steps: &mut Steps,
) -> Best {
    let entries = ENTRIES as u32;
    let mut best = Best::NOTHING;
    // Entries: number of the far child, its parent's level, where the ray enters and leaves it.
    let mut ring = scratch::<UVec4, ENTRIES>();
    // Entries pushed less those popped, modulo the ring's size, and how many of them are still there.
    let (mut top, mut held) = (0u32, 0u32);
    // One more than the level of the deepest entry lost, 0 for none; and the first `t` in any that was lost.
    let (mut lost, mut first_lost) = (0, f32::INFINITY);
    let mut base = Base::root(ray, pairs);
    let Base { mut node, mut level, mut enter, mut exit } = base;
    let mut trail = Trail::ROOT;
    // Levels above this one follow the trail.
    let mut fixed = 0;
    let mut running = ray.valid && enter <= exit;
    // 1 until nothing is left.
    let mut open = running as u32;
    while running {
        while !node.is_leaf() && enter <= best.t {
            steps.inner += 1;
            let plane = Crossing::new(ray, node, pairs);
            let reached = plane.first <= low(exit, best.t);
            let far = if level < fixed { trail.is_far(level) } else { plane.skips_near(enter, reached) };
            if far {
                trail = if level < fixed { trail } else { trail.turned(level) };
                node = plane.far.node;
                enter = high(enter, plane.first);
            } else {
                if reached && !plane.far.node.is_empty() {
                    let slot = top & (entries - 1);
                    if held == entries {
                        let oldest = ring.at(slot);
                        lost = oldest.y + 1;
                        first_lost = low(first_lost, f32::from_bits(oldest.z));
                    } else {
                        held += 1;
                    }
                    let begin = high(enter, plane.first);
                    ring.put(slot, UVec4::new(plane.far.index, level, begin.to_bits(), exit.to_bits()));
                    top += 1;
                }
                node = plane.near.node;
                exit = low(exit, plane.last);
            }
            level += 1;
            if held == 0 && lost == 0 {
                base = Base { node, level, enter, exit };
            }
        }
        // Else a hit found since makes this subtree useless.
        if enter <= best.t {
            steps.visit(node);
            if !leaf::visit(Strict, ray, node, corners, &mut Every, &mut best) {
                steps.status |= status::CUT_SHORT;
            }
        }
        if level > MAX_DEPTH {
            steps.status |= status::STACK;
        }
        // What was lost beyond the best hit is no loss.
        if (held == 0 && (lost == 0 || first_lost > best.t)) || best.is_enough(any) {
            running = false;
            open = 0;
        } else if held != 0 {
            top = top.wrapping_sub(1);
            held -= 1;
            let entry = ring.at(top & (entries - 1));
            node = Place::load(entry.x, pairs).node;
            trail = trail.turned(entry.y);
            level = entry.y + 1;
            fixed = level;
            enter = f32::from_bits(entry.z);
            exit = f32::from_bits(entry.w);
        } else {
            trail = trail.turned(lost - 1);
            fixed = lost;
            (lost, first_lost) = (0, f32::INFINITY);
            Base { node, level, enter, exit } = base;
            steps.turns += 1;
        }
    }
    if open != 0 {
        steps.status |= status::CUT_SHORT;
    }
    best
}

query! {
    /// A stack of one entry.
    shortstack1::SHORTSTACK1 counts = |_, ray, pairs, corners, any, _, steps|
        walk::<1>(ray, pairs, corners, any, steps)
}
query! {
    /// A stack of two entries.
    shortstack2::SHORTSTACK2 counts = |_, ray, pairs, corners, any, _, steps|
        walk::<2>(ray, pairs, corners, any, steps)
}
query! {
    /// A stack of four entries.
    shortstack4::SHORTSTACK4 counts = |_, ray, pairs, corners, any, _, steps|
        walk::<4>(ray, pairs, corners, any, steps)
}
query! {
    /// A stack of eight entries.
    shortstack8::SHORTSTACK8 counts = |_, ray, pairs, corners, any, _, steps|
        walk::<8>(ray, pairs, corners, any, steps)
}
