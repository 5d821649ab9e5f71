//! raykd: kd-trees for ray tracing triangle meshes, one kernel source for CPU and GPU, identical bytes.

mod build;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
mod error;
mod exact;
mod exec;
mod intersector;
pub mod mesh;
mod output;
#[cfg(feature = "plan")]
pub mod plan;
pub mod rays;
#[cfg(feature = "cli")]
mod render;
#[cfg(feature = "cli")]
mod report;
mod scene;
#[cfg(feature = "stress")]
pub mod stress;
mod traversal;
mod tree;

pub use build::{BuildOptions, BuildTimes, Builder, KernelTimes};
pub use error::Error;
#[cfg(feature = "gpu")]
pub use exec::{AdapterReport, Verdict, adapters};
pub use exec::{Device, Limit};
pub use intersector::Intersector;
pub use mesh::Mesh;
pub use raykd_kernels as kernels;
pub use raykd_shared as shared;
pub use raykd_shared::{Hit, Ray};
pub use rays::Ray64;
pub use scene::{AllHits, Query, RaySteps, Resident, Scene, Traced};
pub use traversal::Traversal;
#[cfg(feature = "cli")]
use tree::digest_of;
pub use tree::{KdTree, hits_digest};

/// What raykd's own tests look at: executors, buffers, steps. No version promises anything about it.
#[doc(hidden)]
pub mod internals {
    #[cfg(feature = "gpu")]
    pub use crate::exec::Gpu;
    pub use crate::exec::{Buffer, Cpu, Groups, Step, Timing, watch};
    use crate::{BuildOptions, KdTree, Mesh};

    /// The host's form of [`Builder::Exact`](crate::Builder::Exact).
    pub fn exact_by_host(mesh: &Mesh, options: &BuildOptions) -> KdTree {
        let KdTree { header, nodes, refs } = crate::exact::build(mesh, options);
        KdTree::sealed(header, nodes, refs, mesh.digest())
    }
}
