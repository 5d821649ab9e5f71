//! The ways through the tree. `stack` is what raykd uses; the others are the literature's, made exact. All but `wide`
//! visit the leaves that a ray meets in the same order, near before far at every node, so all find the same
//! hits; `wide` has leaves of its own, so its any hits may be others.

pub mod backtrack;
pub mod brute;
pub mod crossing;
pub mod leaf;
pub mod narrow;
pub mod next;
pub mod pushdown;
pub mod rest;
pub mod restart;
pub mod ropes;
pub mod sequential;
pub mod settle;
pub mod shortstack;
pub mod stack;
pub mod trail;
pub mod wide;

kernels! {
    /// The kernels of ways other than `stack`, and those of exact hits.
    restart::RESTART,
    pushdown::PUSHDOWN,
    shortstack::shortstack1::SHORTSTACK1,
    shortstack::shortstack2::SHORTSTACK2,
    shortstack::shortstack4::SHORTSTACK4,
    shortstack::shortstack8::SHORTSTACK8,
    backtrack::BACKTRACK,
    ropes::ROPES,
    ropes::optimised_ropes::OPTIMISED_ROPES,
    sequential::SEQUENTIAL,
    wide::WIDE,
    wide::wide_any::WIDE_ANY,
    wide::wide_steps::WIDE_STEPS,
    narrow::NARROW,
    narrow::any::NARROW_ANY,
    settle::SETTLE,
    rest::REST,
}

use crate::glam::UVec4;
use raykd_shared::Node;

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
    pub fn visit(&mut self, leaf: Node) {
        self.leaves += 1;
        self.tests += leaf.count();
    }

    /// As counts are stored.
    #[inline(always)]
    pub fn words(&self) -> UVec4 {
        UVec4::new(self.inner, self.leaves, self.tests, self.turns)
    }
}
