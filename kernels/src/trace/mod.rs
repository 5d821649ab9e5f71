//! Tracing rays: one ray an invocation.
//!
//! A ray is made ready ([`frame`]), goes to the leaves it meets ([`traverse`]) and tests their triangles
//! ([`intersect`]). [`queries`] has the kernels, [`prepare`] those that run once a tree; [`single`] answers one ray
//! at a time, on a CPU or in a shader of one's own.

pub mod frame;
pub mod intersect;
pub mod job;
pub mod place;
pub mod prepare;
pub mod queries;
pub mod single;
pub mod traverse;
pub mod workgroups;
