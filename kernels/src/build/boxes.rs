//! The references of the root: the triangles that take part, each with its box.

use super::{bin::HIST_WORDS, branch::room, reference::Reference};
use crate::{
    glam::UVec4,
    mem::{Buf, Slots},
};
use raykd_shared::{BuildParams, limits::BRANCH};

/// Where the first stands: if they are a branch, they come last in its room.
#[inline(always)]
pub const fn first(references: u32, small: u32) -> u32 {
    if references > BRANCH { 0 } else { room(references, small, 0) - references }
}

/// Writes reference `i`, and clears a word of the root's histogram and sizes.
pub fn bound(
    i: u32,
    params: &Buf<BuildParams>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    kept: &Buf<u32>,
    refs: &mut Buf<UVec4>,
    hists: &mut Buf<u32>,
    sizes: &mut Buf<u32>,
) {
    if i < HIST_WORDS {
        hists.put(i, 0);
    }
    if i < 2 {
        sizes.put(i, 0);
    }
    let params = params.at(0);
    if i < params.references {
        let first = first(params.references, params.small);
        Reference::whole(positions, indices, kept.at(i)).store(refs, first + i);
    }
}

kernel! {
    /// [`bound`] over all references of the root, and all words of its histogram.
    map BOXES = bound, threads 64, {
        0 params: read BuildParams, 1 positions: read f32, 2 indices: read u32, 3 kept: read u32, 4 refs: write UVec4,
        5 hists: write u32, 6 sizes: write u32,
    }
}
