//! The references of the root, and their faces in no order.

use super::{LEVEL_REFS, LISTS, Reference, face, room};
use crate::{
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
};
use raykd_shared::BuildParams;

/// Makes reference `i` of the root.
pub fn start(
    i: u32,
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    kept: &Buf<u32>,
    level: &Buf<u32>,
    refs: &mut Buf<UVec4>,
    faces: &mut Buf<UVec2>,
) {
    if i < level.at(LEVEL_REFS) {
        let room = room(&params.at(0));
        let reference = Reference::whole(positions, indices, kept.at(i));
        reference.store(refs, i);
        let mut list = 0;
        while list < LISTS {
            faces.put(list * room + i, face(&reference.bounds, list, i));
            list += 1;
        }
    }
}

kernel! {
    /// [`start`] over all triangles that take part.
    map START = start, threads 128, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 kept: read u32, 4 level: read u32,
        5 refs: write UVec4, 6 faces: write UVec2,
    }
}
