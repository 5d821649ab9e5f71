//! raykd: kd-trees for ray tracing triangle meshes, one kernel source for CPU and GPU, identical bytes.

mod build;
#[cfg(feature = "cli")]
pub mod cli;
mod error;
pub mod exact;
pub mod exec;
mod intersector;
pub mod mesh;
pub mod output;
#[cfg(feature = "plan")]
pub mod plan;
pub mod rays;
mod read;
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
pub use exec::Device;
pub use intersector::Intersector;
pub use mesh::Mesh;
pub use raykd_kernels as kernels;
pub use raykd_shared as shared;
pub use raykd_shared::{Hit, Ray};
pub use read::usual_max_bytes;
pub use scene::{AllHits, Query, RaySteps, Resident, Scene, Traced};
pub use traversal::Traversal;
#[cfg(feature = "cli")]
use tree::digest_of;
pub use tree::{KdTree, hits_digest};
