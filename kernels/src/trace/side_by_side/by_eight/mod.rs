//! On an x86-64 processor, if it has AVX2.

mod apart;
mod candidates;
mod packet;
mod points;
mod tallies;

pub(in crate::trace) use candidates::exact;
pub(in crate::trace) use packet::closest;
pub(in crate::trace) use points::locate;
pub(in crate::trace) use tallies::crossings;

/// The rays of a workgroup that have no answer yet, a bit a ray.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct Left(u64);

impl Left {
    /// None has.
    pub(in crate::trace) const ALL: Self = Self(u64::MAX);

    /// Those that neither has answered.
    #[inline(always)]
    pub(in crate::trace) fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Whether the ray of a lane is left.
    #[inline(always)]
    pub(in crate::trace) fn has(self, lane: u32) -> bool {
        self.0 >> lane & 1 != 0
    }
}
