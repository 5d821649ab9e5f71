//! Tracing rays: one ray an invocation.
//!
//! A ray is made ready ([`frame`]), goes to the leaves it meets ([`traverse`]) and tests their triangles
//! ([`intersect`]). [`queries`] declares kernels that answer, [`prepare`] has those that run once a tree; [`single`]
//! answers one ray at a time, on a CPU or in a shader of one's own. `side_by_side` is what a CPU does with eight rays
//! at once.

#[macro_use]
pub mod queries;
#[macro_use]
pub mod left;
pub mod all;
pub mod crossings;
pub mod frame;
pub mod intersect;
pub mod job;
pub mod listed;
pub mod locate;
pub mod place;
pub mod prepare;
#[cfg(target_arch = "x86_64")]
mod side_by_side;
pub mod single;
pub mod tally;
pub mod traverse;
