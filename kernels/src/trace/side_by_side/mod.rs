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
    Group,
    eight::{Eight, SIDE_BY_SIDE},
    glam::{UVec4, Vec4},
    math::Sides,
    mem::{Buf, Slots},
    trace::{
        frame::Frame,
        job::{JOB_APART, JOB_RAYS, Left},
    },
};
use apart::Visits;
use packet::{Packet, extent};
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

    /// Answers those of some rays that go side by side, and returns which are left.
    #[inline(always)]
    fn side_by_side<B: Visits<Eight>>(self, range: Range, outcome: &mut Buf<u32>, by: &mut B) -> Left {
        let mut left = self.together(range, by);
        // What is gathered is not counted.
        if !cfg!(feature = "traffic") && extent(self.header).is_some() && left.count() >= MANY {
            apart::answer(range.0, &mut left, self, outcome, by);
        }
        left
    }

    /// Answers those of the rays from `first` to `end` that go together, and returns which are left.
    #[inline(always)]
    fn together<N: Sides, P: Packets<N>>(&self, (first, end): Range, packets: &mut P) -> Left {
        let mut left = Left::first(end.saturating_sub(first));
        let Some(extent) = extent(self.header) else { return left };
        let mut i = first;
        while i + SIDE_BY_SIDE <= end {
            if let Some(mut packet) = Packet::of(i, self, P::NEAR * extent, P::WHOLE) {
                left.answer(i - first, packets.answer(self, &mut packet));
            }
            i += SIDE_BY_SIDE;
        }
        left
    }
}

/// Of rays that do not go together fewer go one by one.
const MANY: u32 = 16;

/// The first and the end of some rays.
type Range = (u32, u32);

/// The rays of a workgroup, if they lie beside each other and the processor has AVX2.
#[inline(always)]
fn neighbours(group: &Group, job: &Buf<u32>) -> Option<Range> {
    let first = group.id * group.width;
    let may = group.usual.has() && job.at(JOB_APART) == 0;
    may.then(|| (first, job.at(JOB_RAYS).min(first + group.width)))
}

/// What is made of packets: eight rays each, of which some go together.
trait Packets<N: Sides> {
    /// Whether rays are as [`Frame::whole`] makes them.
    const WHOLE: bool = false;
    /// How near to each other rays start that go together, of the scene's largest extent.
    const NEAR: f32 = 1.0 / 16.0;
    /// Answers some of those that go together, and returns which.
    fn answer(&mut self, scene: &Scene<'_>, packet: &mut Packet<N>) -> u32;
}
