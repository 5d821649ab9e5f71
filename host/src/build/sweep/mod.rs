//! The best tree a greedy builder finds: every face of every reference's box is a candidate, in O(N log N)
//! (Wald & Havran 2006, section 4.2), and references that straddle a plane are clipped (section 4.3).
//!
//! [`kernels`] go breadth first, on any device. [`host`] goes depth first and is many times as fast on a CPU.
//! Both leave the same bytes.

mod events;
pub(super) mod host;
#[cfg_attr(target_arch = "wasm32", allow(dead_code, reason = "browsers build by the host"))]
pub(super) mod kernels;
mod split;

/// Nodes of more references keep the faces of their boxes in order on a device; in others they are counted one by one.
pub const LISTED: u32 = 64;
