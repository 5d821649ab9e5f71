//! Tracing rays: one ray an invocation.

pub mod any;
pub mod brute;
pub mod closest;
pub mod corners;
pub mod frame;
pub mod leaf;
pub mod stack;
pub mod steps;
pub mod triangle;

use crate::{
    glam::{UVec4, Vec4},
    math::{div, ldexp},
    mem::{Atomics, Buf, Slots},
};
use frame::Frame;
use raykd_shared::{MISS, TreeHeader};
use triangle::Best;

/// Words of the job record: how many rays this dispatch has.
pub const JOB_RAYS: u32 = 0;
/// Brute force: where in the list of triangles this dispatch starts.
pub const JOB_FROM: u32 = 1;
/// Brute force: where it ends.
pub const JOB_TO: u32 = 2;
/// Words of the job record.
pub const JOB_WORDS: u32 = 4;

/// Words of the outcome record: status bits, see [`raykd_shared::status`].
pub const OUTCOME_STATUS: u32 = 0;
/// How many rays were none: NaN, infinite or zero direction, origin out of range.
pub const OUTCOME_INVALID: u32 = 1;
/// Words of the outcome record.
pub const OUTCOME_WORDS: u32 = 4;

/// What a ray did on its way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steps {
    /// Inner nodes passed.
    pub inner: u32,
    /// Leaves visited.
    pub leaves: u32,
    /// Triangles tested.
    pub tests: u32,
    /// Status bits raised on the way.
    pub status: u32,
}

/// No hit yet.
pub const NOTHING: Best = Best { t: f32::INFINITY, triangle: MISS, u: 0.0, v: 0.0, det: 1.0 };

/// Loads and prepares ray `i`, and counts it if it is none.
#[inline(always)]
fn load(i: u32, rays: &Buf<Vec4>, header: &TreeHeader, outcome: &mut Buf<u32>) -> Frame {
    let ray = Frame::new(rays.at(2 * i), rays.at(2 * i + 1), header);
    if !ray.valid {
        outcome.add(OUTCOME_INVALID, 1);
    }
    ray
}

/// The bits of a number, without the sign of a zero.
#[inline(always)]
fn positive_zero(a: f32) -> u32 {
    if a == 0.0 { 0 } else { a.to_bits() }
}

/// The hit record of a finished ray: triangle, `t`, `u`, `v`.
#[inline(always)]
fn record(ray: &Frame, best: &Best) -> UVec4 {
    if best.triangle == MISS {
        UVec4::new(MISS, 0, 0, 0)
    } else {
        UVec4::new(
            best.triangle,
            positive_zero(ldexp(best.t, -ray.stretch)),
            positive_zero(div(best.u, best.det)),
            positive_zero(div(best.v, best.det)),
        )
    }
}
