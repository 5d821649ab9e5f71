//! Ropes pulled down to the smallest node that lies beyond a whole side (Popov et al. 2007, as `ropes`).
//!
//! Such a rope skips the children beside it. Those that come before the rope's end in the ray's order would be
//! missed if the ray still were inside the planes between: then, as at corners, the leaf's parents are asked.

use super::ropes::walk;
use crate::glam::UVec4;

query! {
    /// Follows ropes to the smallest node beyond a side.
    OPTIMISED_ROPES counts =
        |_, ray, pairs, corners, any, steps| walk::<true>(ray, pairs, corners, parents, links, any, steps),
    { 8 parents: u32, 9 links: UVec4 }
}
