//! Rays and points eight at a time, on a CPU: of those of a workgroup some are answered here, and each of the rest by a
//! lane.

#[cfg_attr(not(target_arch = "x86_64"), path = "nowhere.rs")]
mod by_eight;

pub(super) use by_eight::{Left, closest, crossings, exact, locate};
