//! Restarting at the push-down node (Horn, Sugerman, Houston & Hanrahan 2007, "Interactive k-d tree GPU
//! raytracing"): the lowest node that holds all that is left of the ray.
//!
//! The paper stops pushing down at the first node of which the ray meets both children, since rounding may
//! make a node look so. Here a near child that is done does not hold the node up: the trail knows that, `t`
//! would not. The walk is that of [`restart`], with `PUSHDOWN`.

use super::restart;

/// Bytes that a ray keeps between two leaves, beside its best hit: as for `restart`, and the node with its
/// level and interval.
pub const STATE: u32 = restart::STATE + 20;

query! {
    /// Restarts at the push-down node.
    PUSHDOWN counts = |_, ray, pairs, corners, any, _, steps|
        restart::walk::<true>(ray, pairs, corners, any, steps)
}
