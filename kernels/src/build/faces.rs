//! How a CPU weighs the faces of a small node's boxes on one axis: eight side by side, as a GPU's lanes do.

use super::Across;
use crate::{
    glam::Vec4,
    math::Number,
};

/// The most references a node may have.
const MOST: usize = 32;
/// Both faces of their boxes, and up to seven more than are full.
const ROOM: usize = 2 * MOST + 8;

/// The cheapest cut at a face: its cost, and which face it is; of equally cheap ones, the first. Low faces come first,
/// then high ones. Numbers are given as bits. What lies in a plane counts as below.
#[inline(always)]
pub(super) fn cheapest(lows: &[u32], highs: &[u32], across: &Across) -> (f32, u32) {
    let (mut places, mut faces) = ([f32::INFINITY; ROOM], [0.0f32; ROOM]);
    let mut held = 0;
    let mut face = 0.0;
    for side in [lows, highs] {
        for &place in side {
            let place = f32::from_bits(place);
            places[held] = place;
            faces[held] = face;
            held += across.holds(place) as usize;
            face += 1.0;
        }
    }
    places[held] = f32::INFINITY;
    let all = Vec4::splat(lows.len() as f32);
    let (mut costs, mut cheapest) = (Vec4::INFINITY, Vec4::ZERO);
    let mut first = 0;
    while first < held {
        let at = [Vec4::from_slice(&places[first..]), Vec4::from_slice(&places[first + 4..])];
        let (mut apart, mut above) = ([Vec4::ZERO; 2], [Vec4::ZERO; 2]);
        for (&low, &high) in lows.iter().zip(highs) {
            let (low, high) = (Vec4::splat(f32::from_bits(low)), Vec4::splat(f32::from_bits(high)));
            for half in 0..2 {
                let ends_above = high.cmpgt(at[half]);
                above[half] += Vec4::select(ends_above, Vec4::ONE, Vec4::ZERO);
                apart[half] += Vec4::select(ends_above & low.cmpge(at[half]), Vec4::ONE, Vec4::ZERO);
            }
        }
        for half in 0..2 {
            let cost = across.cut(at[half], all - apart[half], above[half]);
            let cheaper = costs.exceeds(cost);
            costs = Vec4::select(cheaper, cost, costs);
            cheapest = Vec4::select(cheaper, Vec4::from_slice(&faces[first + 4 * half..]), cheapest);
        }
        first += 8;
    }
    let least = costs.min_element();
    let first = Vec4::select(costs.cmpeq(Vec4::splat(least)), cheapest, Vec4::INFINITY).min_element();
    (least, first as u32)
}
