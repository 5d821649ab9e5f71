//! How a CPU weighs the faces of a small node's boxes: some side by side, as a GPU's lanes do.

use super::{Across, is_above, is_below};
use crate::{
    Usual,
    glam::Vec4,
    math::{Row, ones},
};
use raykd_shared::limits::TREELET;

/// The most references a node may have.
pub const MOST: usize = TREELET as usize;

/// Boxes are read by so many.
pub const STEP: u32 = 4;

/// On which side a box lies that is flat and in the plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flat {
    /// Below, as in all kernels but those of `sweep`.
    Below,
    /// Above.
    Above,
}

/// Of equally cheap cuts, which is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum First {
    /// That at the face of the lowest number: first come the low faces, then the high ones.
    Number,
    /// The lowest one.
    Place,
}

/// The bits of the low and the high faces of some boxes on an axis, with room up to a multiple of [`STEP`].
pub type Faces<'a> = (&'a [u32], &'a [u32]);

/// [`cheapest`], row by row.
#[inline(always)]
fn row_by_row<N: Row>(
    faces: [Faces<'_>; 3],
    number: u32,
    across: &[Across; 3],
    flat: Flat,
    first: First,
) -> [(f32, f32); 3] {
    let all = N::all;
    let float = |n: u32| n as i32 as f32;
    let count = all(float(number));
    // So long, and no more is checked in the loop.
    let mut boxes = faces;
    for (lows, highs) in &mut boxes {
        (*lows, *highs) = (&lows[..number as usize], &highs[..number as usize]);
    }
    let mut best = [(all(f32::INFINITY), all(f32::INFINITY)); 3];
    let mut next = 0;
    while next < number {
        let mut at = [all(0.0); 3];
        for (at, (lows, highs)) in at.iter_mut().zip(faces) {
            *at = N::of(&lows[next as usize..], &highs[next as usize..]);
        }
        // What reaches to the one side, and what lies on the other only; all axes in turn, as each waits for its own
        // sums.
        let mut sums = [(N::never(), N::never()); 3];
        for i in 0..number as usize {
            for ((here, there), (&at, (lows, highs))) in sums.iter_mut().zip(at.iter().zip(boxes)) {
                let (low, high) = (all(f32::from_bits(lows[i])), all(f32::from_bits(highs[i])));
                let (reaches, astride) = match flat {
                    Flat::Below => (high.exceeds(at), at.exceeds(low)),
                    Flat::Above => (at.exceeds(low), high.exceeds(at)),
                };
                *here = N::once_more(*here, reaches);
                *there = N::once_more(*there, reaches & !astride);
            }
        }
        let left = all(float(number - next)).exceeds(N::numbers(0.0, 0.0));
        for ((best, across), (&at, &(here, there))) in best.iter_mut().zip(across).zip(at.iter().zip(&sums)) {
            let (here, there) = (N::times(here), count - N::times(there));
            let (below, above) = match flat {
                Flat::Below => (there, here),
                Flat::Above => (here, there),
            };
            let cost = N::choose(left, across.cut(at, below, above), all(f32::INFINITY));
            let rank = match first {
                First::Number => N::numbers(float(next), float(number + next)),
                First::Place => at,
            };
            let (least, least_rank) = *best;
            let better = least.exceeds(cost) | (least.is(cost) & least_rank.exceeds(rank));
            *best = (N::choose(better, cost, least), N::choose(better, rank, least_rank));
        }
        next += N::BOXES;
    }
    let mut found = [(0.0, 0.0); 3];
    for (found, (least, rank)) in found.iter_mut().zip(best) {
        let cost = least.smallest();
        *found = (cost, N::choose(least.is(all(cost)), rank, all(f32::INFINITY)).smallest());
    }
    found
}

/// The cheapest cuts at faces of `number` boxes, one across each axis: what each costs, and the face's number or place,
/// whichever comes `first`; both infinite if there is none.
#[inline(always)]
pub fn cheapest(
    usual: Usual,
    faces: [Faces<'_>; 3],
    number: u32,
    across: &[Across; 3],
    flat: Flat,
    first: First,
) -> [(f32, f32); 3] {
    by_eight!(
        usual,
        row_by_row::<Eight>(faces, number, across, flat, first),
        else row_by_row::<Vec4>(faces, number, across, flat, first)
    )
}

/// A bit for each of `number` boxes, 32 at most, which goes below a plane, and one for each which goes above.
#[inline(always)]
pub fn parted(usual: Usual, (lows, highs): Faces<'_>, number: u32, plane: f32) -> (u32, u32) {
    let own = ones(number);
    let (belows, aboves) =
        by_eight!(usual, Eight::parted(lows, highs, plane), else one_by_one(lows, highs, number, plane));
    (belows & own, aboves & own)
}

/// [`parted`] without AVX2.
#[inline(always)]
fn one_by_one(lows: &[u32], highs: &[u32], number: u32, plane: f32) -> (u32, u32) {
    let (mut belows, mut aboves) = (0, 0);
    for (i, (low, high)) in (0..number).zip(lows.iter().zip(highs)) {
        let (low, high) = (f32::from_bits(*low), f32::from_bits(*high));
        belows |= (is_below(low, high, plane) as u32) << i;
        aboves |= (is_above(high, plane) as u32) << i;
    }
    (belows, aboves)
}
