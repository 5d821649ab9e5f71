//! Where every reference of a level goes.

use super::{ABOVE, BELOW, CLIPPED_SHIFT, CUT, Cell, HEAD, LEAF, LEVEL_REFS, LISTED, Reference, decide};
use crate::{
    build::{clip::clip_plane, sides},
    glam::UVec4,
    math::component,
    mem::{Buf, Slots},
    mesh::triangle,
};
use raykd_shared::{BuildParams, Node, rule};

/// The code of reference `i`.
pub fn classify(
    i: u32,
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    level: &Buf<u32>,
    refs: &Buf<UVec4>,
    cells: &Buf<UVec4>,
    bests: &Buf<UVec4>,
    codes: &mut Buf<u32>,
) {
    if i < level.at(LEVEL_REFS) {
        let params = params.at(0);
        let reference = Reference::load(refs, i);
        let cell = Cell::load(cells, reference.cell);
        let cutting = decide(&cell, bests);
        let mut code = LEAF;
        if cutting.plane.axis != Node::LEAF {
            let (bounds, at) = (reference.bounds, cutting.plane.at);
            let (lo, hi) =
                (component(bounds.lo, cutting.plane.axis), component(bounds.hi, cutting.plane.axis));
            let (below, above) = sides(lo, hi, at, cutting.flat_above);
            code = (below as u32) * BELOW + (above as u32) * ABOVE;
            let large = cell.count > params.small;
            if below && above {
                if (params.rule & rule::CLIP) != 0 {
                    let (a, b, c) = triangle(positions, indices, reference.triangle);
                    let (under, over) = clip_plane(a, b, c, &bounds, cutting.plane.axis, at);
                    code = (!under.is_empty() as u32) * BELOW + (!over.is_empty() as u32) * ABOVE;
                }
                code = CUT | if large { code << CLIPPED_SHIFT } else { code };
            }
            code |= if i == cell.first { HEAD } else { 0 };
            code |= if large { LISTED } else { 0 };
        }
        codes.put(i, code);
    }
}

kernel! {
    /// [`classify`] over all references of a level.
    map CLASSIFY = classify, threads 128, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 level: read u32, 4 refs: read UVec4,
        5 cells: read UVec4, 6 bests: read UVec4, 7 codes: write u32,
    }
}
