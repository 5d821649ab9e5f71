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
    eight::SIDE_BY_SIDE,
    glam::{UVec4, Vec4},
    math::Sides,
    mem::{Buf, Slots},
    trace::{
        frame::Frame,
        job::{JOB_APART, JOB_RAYS, Left},
    },
};
use packet::{Packet, Scaled, extent};
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

    /// Answers those of the rays from `first` to `end` that go together, and returns which are left.
    #[inline(always)]
    fn answer<N: Sides, E: Eights<N>>(&self, (first, end): Range, eights: &mut E) -> Left {
        let mut left = Left::first(end.saturating_sub(first));
        let Some(extent) = extent(self.header) else { return left };
        let mut i = first;
        while i + SIDE_BY_SIDE <= end {
            if let Some((mut packet, scaled, together)) = Packet::<N>::of(i, self, E::NEAR * extent, E::WHOLE)
            {
                left.answer(i - first, eights.answer(i, &mut packet, self, &scaled, together));
            }
            i += SIDE_BY_SIDE;
        }
        left
    }

    /// Whether rays are enough to go each at a node of its own.
    #[inline(always)]
    fn are_many(&self, left: &Left) -> bool {
        // What is gathered is not counted.
        !cfg!(feature = "traffic") && extent(self.header).is_some() && left.count() >= MANY
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

/// What is made of eight rays that go together.
trait Eights<N: Sides> {
    /// Whether rays are as [`Frame::whole`] makes them.
    const WHOLE: bool = false;
    /// How near to each other rays start that go together, of the scene's largest extent.
    const NEAR: f32 = 1.0 / 16.0;
    /// Answers some of the rays from `i` on, and returns which.
    fn answer(
        &mut self,
        i: u32,
        packet: &mut Packet<N>,
        scene: &Scene<'_>,
        scaled: &Scaled<N>,
        together: u32,
    ) -> u32;
}
