//! How a CPU weighs the faces of a small node's boxes on one axis: eight side by side, as a GPU's lanes do.

use super::Across;
use crate::{glam::Vec4, math::Number};
use raykd_shared::limits::TREELET;

/// The most references a node may have.
pub const MOST: usize = TREELET as usize;
/// Both faces of their boxes, and up to seven more than are full.
const ROOM: usize = 2 * MOST + 8;

/// On which side a box lies that is flat and in the plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flat {
    /// Below, as in all kernels but those of `sweep`.
    Below,
    /// Above.
    Above,
}

/// The cheapest cut at a face of the boxes: its cost and rank. Of equally cheap ones that of the lowest rank,
/// which is made of a face's place and number: first come the low ones. `faces` tells those of a box, low and
/// high.
#[inline(always)]
pub fn cheapest(
    number: usize,
    faces: impl Fn(usize) -> (f32, f32),
    across: &Across,
    flat: Flat,
    rank: impl Fn(f32, f32) -> f32,
) -> (f32, f32) {
    let (mut places, mut ranks) = ([f32::INFINITY; ROOM], [0.0f32; ROOM]);
    let mut held = 0;
    let mut keep = |place: f32, face: usize| {
        places[held] = place;
        ranks[held] = rank(place, face as f32);
        held += across.holds(place) as usize;
    };
    for i in 0..number {
        keep(faces(i).0, i);
    }
    for i in 0..number {
        keep(faces(i).1, number + i);
    }
    places[held] = f32::INFINITY;
    let all = Vec4::splat(number as f32);
    let (mut least, mut first) = (Vec4::INFINITY, Vec4::INFINITY);
    let mut next = 0;
    while next < held {
        let mut at = [0.0; 8];
        at.copy_from_slice(&places[next..next + 8]);
        // What reaches to the one side, and what lies on the other only. Sums of floats a compiler leaves in
        // their order, so it makes vectors of faces, not of boxes.
        let (mut here, mut there) = ([0.0f32; 8], [0.0f32; 8]);
        for i in 0..number {
            let (low, high) = faces(i);
            for k in 0..8 {
                let (reaches, beyond) = match flat {
                    Flat::Below => (high > at[k], low >= at[k]),
                    Flat::Above => (low < at[k], high <= at[k]),
                };
                here[k] += if reaches { 1.0 } else { 0.0 };
                there[k] += if reaches & beyond { 1.0 } else { 0.0 };
            }
        }
        for half in [0, 4] {
            let four = |numbers: &[f32; 8]| Vec4::from_slice(&numbers[half..half + 4]);
            let (at, here, there) = (four(&at), four(&here), all - four(&there));
            let (below, above) = match flat {
                Flat::Below => (there, here),
                Flat::Above => (here, there),
            };
            let cost = across.cut(at, below, above);
            let rank = Vec4::from_slice(&ranks[next + half..]);
            let better = least.exceeds(cost) | (least.is(cost) & first.exceeds(rank));
            least = Vec4::select(better, cost, least);
            first = Vec4::select(better, rank, first);
        }
        next += 8;
    }
    let cost = least.min_element();
    (cost, Vec4::select(least.is(Vec4::splat(cost)), first, Vec4::INFINITY).min_element())
}
