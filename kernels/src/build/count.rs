//! Which references of a chunk go below and above its node's plane, and how many; these are the children's sizes.

#[cfg(not(target_arch = "spirv"))]
use super::ahead;
use super::{LEVEL_CHUNKS, boxes::triangle, chunk_of, cut, overlap::overlaps, plane_of, side};
use crate::{
    Group,
    glam::{UVec2, UVec4, Vec4},
    mem::{Atomics, Buf, Slots},
};
use raykd_shared::{BuildParams, rule};

/// The number of a reference's triangle; above it stand two bits that say where it goes.
pub const TRIANGLE: u32 = (1 << 30) - 1;

/// Counts of chunk `group.id`; each reference's sides are put in its top bits.
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
    refs: &mut Buf<u32>,
    boxes: &Buf<Vec4>,
    planes: &Buf<UVec2>,
    sides: &mut Buf<UVec2>,
    sizes: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_CHUNKS) {
        let (node, item, start, number) = chunk_of(group.id, chunks, active);
        let plane = plane_of(planes, node);
        let clips = (params.at(0).rule & rule::CLIP) != 0;
        let (hi_below, lo_above) = cut(item.lo, item.hi, plane);
        let step = group.sharers();
        #[cfg(not(target_arch = "spirv"))]
        ahead::first(group, refs, start, number, boxes);
        lanes!(group, ..2, |lane| {
            sums.put(lane, 0);
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
                    #[cfg(not(target_arch = "spirv"))]
                    ahead::next(group, refs, start, at, number, boxes);
                    let id = refs.at(start + at);
                    let s = side(boxes, id, plane);
                    if clips && s == 3 {
                        straddling |= 1 << k;
                        indices.soon(3 * id);
                    } else {
                        refs.put(start + at, id | (s << 30));
                        below += s & 1;
                        above += s >> 1;
                    }
                    k += 1;
                }
                #[cfg(not(target_arch = "spirv"))]
                ahead::triangles(group, positions, indices, refs, start + i, straddling);
                while straddling != 0 {
                    let at = start + i + straddling.trailing_zeros() * step;
                    straddling &= straddling - 1;
                    let id = refs.at(at);
                    let (a, b, c) = triangle(positions, indices, id);
                    let s = overlaps(a, b, c, item.lo, hi_below) as u32
                        | ((overlaps(a, b, c, lo_above, item.hi) as u32) << 1);
                    refs.put(at, id | (s << 30));
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
        lanes!(group, ..2, |lane| {
            if lane == 0 {
                sides.put(group.id, UVec2::new(sums.at(0), sums.at(1)));
            }
            sizes.add(2 * node + lane, sums.at(lane));
        });
    }
}

kernel! {
    /// [`count`] over all chunks of a level.
    group COUNT = count, threads 128, shared [sums: 2], {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32,
        4 active: read UVec4, 5 chunks: read u32, 6 refs: write u32, 7 boxes: read Vec4, 8 planes: read UVec2,
        9 sides: write UVec2, 10 sizes: write u32,
    }
}
