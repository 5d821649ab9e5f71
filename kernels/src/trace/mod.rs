//! Tracing rays: one ray an invocation.
//!
//! `stack` is what raykd uses; the other traversals are the literature's, made exact. All visit the leaves that a
//! ray meets in the same order, near before far at every node, so all find the same hits.

/// Declares the kernel of a query: how it answers ray `i`, whether it writes counts of its steps too, and buffers that only
/// it binds.
macro_rules! query {
    ($(#[$doc:meta])* $name:ident $($counts:ident)? = |$i:pat_param, $ray:ident, $pairs:ident, $corners:ident,
     $any:pat_param, $steps:ident| $walk:expr, { $($b:tt $more:ident: $t:ty),* $(,)? }) => {
        /// Answers the ray of invocation `i`.
        #[cfg_attr(not(target_arch = "spirv"), inline(always))]
        #[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
        pub fn answer(
            i: u32,
            job: &$crate::mem::Buf<u32>,
            header: &$crate::mem::Buf<raykd_shared::TreeHeader>,
            $pairs: &$crate::mem::Buf<$crate::glam::UVec4>,
            $corners: &$crate::mem::Buf<$crate::glam::Vec4>,
            rays: &$crate::mem::Buf<$crate::glam::Vec4>,
            hits: &mut $crate::mem::Buf<$crate::glam::UVec4>,
            outcome: &mut $crate::mem::Buf<u32>,
            $($counts: &mut $crate::mem::Buf<$crate::glam::UVec4>,)?
            $($more: &$crate::mem::Buf<$t>),*
        ) {
            use $crate::{mem::{Atomics as _, Slots as _}, trace};
            if i < job.at(trace::JOB_RAYS) {
                let $ray = &trace::load(i, rays, &header.at(0), outcome);
                let ($i, $any) = (i, job.at(trace::JOB_ANY) != 0);
                let $steps = &mut trace::Steps::default();
                let best = $walk;
                hits.put(i, trace::record($ray, &best));
                $($counts.put(i, $steps.words());)?
                if $steps.status != 0 {
                    outcome.or(trace::OUTCOME_STATUS, $steps.status);
                }
            }
        }

        kernel! {
            $(#[$doc])*
            map $name = answer, threads 64, {
                0 job: read u32, 1 header: read raykd_shared::TreeHeader, 2 $pairs: read $crate::glam::UVec4,
                3 $corners: read $crate::glam::Vec4, 4 rays: read $crate::glam::Vec4,
                5 hits: write $crate::glam::UVec4, 6 outcome: write u32,
                $(7 $counts: write $crate::glam::UVec4,)?
                $($b $more: read $t),*
            }
        }
    };
}

pub mod all;
pub mod backtrack;
pub mod baldwin;
pub mod brute;
pub mod corners;
pub mod crossing;
pub mod exact;
pub mod frame;
pub mod integers;
pub mod intersector;
pub mod leaf;
pub mod moeller;
pub mod node_boxes;
pub mod optimised_ropes;
pub mod pair;
pub mod parents;
pub mod plane;
pub mod pushdown;
pub mod restart;
pub mod rope_links;
pub mod ropes;
pub mod sequential;
pub mod shortstack;
pub mod stack;
pub mod trail;
pub mod triangle;
pub mod woop;

use crate::{
    glam::{UVec4, Vec4},
    math::{div, ldexp},
    mem::{Atomics, Buf, Slots},
};
use frame::Frame;
use intersector::Best;
use raykd_shared::{MISS, Node, TreeHeader};

/// Words of the job record: how many rays this dispatch has.
pub const JOB_RAYS: u32 = 0;
/// Brute force: where in the list of triangles this dispatch starts.
pub const JOB_FROM: u32 = 1;
/// Brute force: where it ends.
pub const JOB_TO: u32 = 2;
/// Queries of either kind: 1 if any hit will do, 0 for the closest.
pub const JOB_ANY: u32 = 3;
/// All hits: how many of a ray to write at most.
pub const JOB_LIMIT: u32 = 3;
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
    /// How often a traversal without a full stack had to find its way: restarts, climbs, ropes followed.
    pub turns: u32,
    /// Status bits raised on the way.
    pub status: u32,
}

impl Steps {
    /// Counts the visit of a leaf.
    #[inline(always)]
    fn visit(&mut self, leaf: Node) {
        self.leaves += 1;
        self.tests += leaf.count();
    }

    /// As counts are stored.
    #[inline(always)]
    fn words(&self) -> UVec4 {
        UVec4::new(self.inner, self.leaves, self.tests, self.turns)
    }
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
