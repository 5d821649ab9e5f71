//! The kernels' traversals, and what they need that remembers.

#![allow(
    unreachable_pub,
    dead_code,
    reason = "the kernels' sources are public there, and not all is used here"
)]

pub(crate) use raykd_kernels::trace::{frame, intersect};

pub(crate) mod place;
pub(crate) mod prepare;
pub(crate) mod traverse;
