//! Which references of a chunk go below and above its node's plane, and how many; these are the children's
//! sizes.

use super::{LEVEL_CHUNKS, SplitPlane, ahead, chunk_of, clip::clip_plane, plane_of, reference::Reference};
use crate::{
    Group,
    glam::{UVec2, UVec4},
    mem::{Atomics, Buf, Slots},
    mesh::triangle,
};
use raykd_shared::{BuildParams, rule};

/// How many of `number` references from `start` on go below and above `plane`; boxes that straddle it, of
/// triangles that do not, are clipped.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
pub fn sides_of(
    group: Group,
    sums: &mut [u32; 2],
    clips: bool,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    refs: &mut Buf<UVec4>,
    start: u32,
    number: u32,
    plane: SplitPlane,
) {
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut sum = lane;
        while sum < 2 {
            sums.put(sum, 0);
            sum += step;
        }
    });
    lanes!(group, ..step, |lane| {
        let (mut below, mut above) = (0, 0);
        // In batches: triangles are looked at together, in which lanes meet and for which a CPU asks ahead.
        let mut i = lane;
        while i < number {
            let mut straddling = 0u32;
            let mut k = 0;
            while k < 32 && i + k * step < number {
                let at = i + k * step;
                let reference = Reference::load(refs, start + at);
                let s = reference.sides(plane);
                if clips && s == 3 {
                    straddling |= 1 << k;
                    indices.soon(3 * reference.triangle);
                } else {
                    below += s & 1;
                    above += s >> 1;
                }
                k += 1;
            }
            ahead::triangles(group, positions, indices, straddling, |k| {
                Reference::load(refs, start + i + k * step).triangle
            });
            while straddling != 0 {
                let at = start + i + straddling.trailing_zeros() * step;
                straddling &= straddling - 1;
                let mut reference = Reference::load(refs, at);
                let (a, b, c) = triangle(positions, indices, reference.triangle);
                let (under, over) = clip_plane(a, b, c, &reference.bounds, plane.axis, plane.at);
                let s = !under.is_empty() as u32 | ((!over.is_empty() as u32) << 1);
                if s != 3 {
                    reference.bounds = if s == 2 { over } else { under };
                    reference.store(refs, at);
                }
                below += s & 1;
                above += s >> 1;
            }
            i += 32 * step;
        }
        if below + above > 0 {
            sums.add(0, below);
            sums.add(1, above);
        }
    });
}

/// Adds what chunk `group.id` sends either way to its node's, if that has several; [`super::alone`] has
/// cleared that.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
pub fn count(
    group: Group,
    sums: &mut [u32; 2],
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    chunks: &Buf<u32>,
    refs: &mut Buf<UVec4>,
    planes: &Buf<UVec2>,
    sides: &mut Buf<UVec2>,
    sizes: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) {
        let (node, item, start, number) = chunk_of(group.id, chunks, active);
        if !item.is_alone() {
            let clips = (params.at(0).rule & rule::CLIP) != 0;
            let plane = plane_of(planes, node);
            sides_of(group, sums, clips, positions, indices, refs, start, number, plane);
            lanes!(group, ..2, |lane| {
                if lane == 0 {
                    sides.put(group.id, UVec2::new(sums.at(0), sums.at(1)));
                }
                sizes.add(2 * node + lane, sums.at(lane));
            });
        }
    }
}

kernel! {
    /// [`count`] over all chunks of a level.
    group COUNT = count, threads 128, shared [sums: 2], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32,
        4 active: read UVec4, 5 chunks: read u32, 6 refs: write UVec4, 7 planes: read UVec2,
        8 sides: write UVec2, 9 sizes: write u32,
    }
}
