//! Tracing rays: one ray an invocation.
//!
//! A ray is made ready ([`frame`]), goes to the leaves it meets ([`traverse`]) and tests their triangles
//! ([`intersect`]). [`queries`] declares kernels that answer, [`prepare`] has those that run once a tree; [`single`]
//! answers one ray at a time, on a CPU or in a shader of one's own.

#[macro_use]
pub mod queries;
#[macro_use]
pub mod left;
#[cfg(target_arch = "x86_64")]
mod apart;
#[cfg(target_arch = "x86_64")]
mod candidates;
pub mod crossings;
pub mod frame;
pub mod intersect;
pub mod job;
pub mod listed;
pub mod locate;
#[cfg(target_arch = "x86_64")]
pub mod packet;
pub mod place;
pub mod prepare;
pub mod single;
#[cfg(target_arch = "x86_64")]
mod tallies;
pub mod tally;
pub mod traverse;
