//! Rays and points eight at a time, on an x86-64 processor with AVX2: of those of a workgroup some are answered here,
//! and each of the rest by a lane.

mod all;
mod apart;
mod candidates;
mod packet;
mod points;
mod tallies;

pub(super) use all::all;
pub(super) use candidates::exact;
pub(super) use packet::closest;
pub(super) use points::locate;
pub(super) use tallies::crossings;

use crate::{
    glam::{UVec4, Vec4},
    mem::{Buf, Slots},
    trace::frame::Frame,
};
use raykd_shared::TreeHeader;

/// What all of it reads.
#[derive(Clone, Copy)]
struct Scene<'a> {
    header: &'a TreeHeader,
    pairs: &'a Buf<UVec4>,
    corners: &'a Buf<Vec4>,
    rays: &'a Buf<Vec4>,
}

impl Scene<'_> {
    /// Ray `i`, if `whole` as [`Frame::whole`] makes it.
    #[inline(always)]
    fn frame(&self, i: u32, whole: bool) -> Frame {
        let frame = Frame::new(self.rays.at(2 * i), self.rays.at(2 * i + 1), self.header);
        if whole { frame.whole() } else { frame }
    }
}
