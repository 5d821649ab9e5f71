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
