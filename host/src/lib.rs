//! Ray tracing of triangle meshes with kd-trees, on a GPU or a CPU, with identical bytes on both.
//!
//! ```
//! use raykd::{BuildOptions, Device, Mesh, Ray, Scene};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Or from a file, `Mesh::load(path)`, or from your own numbers, `Mesh::new(positions, triangles)`.
//! let mesh = Mesh::teapot(4);
//! let device = Device::best();
//! let scene = Scene::build(&device, &mesh, &BuildOptions::default())?;
//!
//! let ray = Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0]);
//! let hit = scene.closest(&[ray])?[0];
//! assert!(hit.is_hit() && hit.t > 30.0 && hit.t < 50.0);
//!
//! // The corners of the triangle that was hit. Look up normals of your own by the same number.
//! let corners = mesh.triangles()[hit.triangle as usize].map(|vertex| mesh.positions()[vertex as usize]);
//! assert!(corners.iter().all(|corner| corner[2] > 0.0));
//! # Ok(())
//! # }
//! ```
//!
//! # What there is
//! * [`Mesh`]: a checked triangle mesh, from a file or from memory. [`mesh`] lists what is repaired and refused.
//! * [`Device`]: the CPU, or a GPU with Vulkan. A GPU that rounds differently from the CPU is refused.
//! * [`Scene`]: a mesh and its tree on a device, ready for rays. [`BuildOptions`] choose the [`Builder`].
//! * [`World`]: several scenes, or one several times, each moved, turned and scaled.
//! * [`Scene::crossings`] and [`Scene::winding`]: how often rays cross the mesh, and which points are inside;
//!   [`Mesh::edges`] tells whether it is closed, [`Scene::contacts`] where it meets itself.
//! * [`Traversal`] and [`Intersector`]: traversals of the tree, and triangle tests.
//! * [`KdTree`]: the tree as data, to save and to load. [`single`] walks through one on any CPU, or in a shader by
//!   rust-gpu.
//! * [`Scene::save`], [`Scene::open`] and [`Scene::open_mapped`]: a whole scene in a file, which processes may share.
//!
//! # What is promised
//! Triangles are closed: no ray passes between two that share an edge or a vertex. Of hits with equal `t`, the
//! triangle with the lowest number wins. `t_min` and `t_max` are inclusive. Closest hits are the same bytes for every
//! device, builder and traversal, and those of testing every triangle; [`Query::Any`] may find any hit. Triangles
//! without area are never hit. Invalid rays (NaN, infinite numbers, a zero direction) miss, and are counted.
//!
//! # Features
//! * `gpu` (default): run kernels on Vulkan devices, by wgpu. Without it there is the CPU alone.
//! * `gltf`: read glTF files, `.gltf` and `.glb`.
//! * `plan`: choose device, builder and traversal by costs measured once on each device.
//! * `stress`: scenes in which ray tracers fail, and the exact judge of what happens there.
//! * `traffic`: count the bytes that kernels move on the CPU, which slows them. For work on raykd itself.
//!
//! The minimum supported Rust version is 1.88. The crate `wgpu` is part of the interface: its
//! next major version is a breaking change here.

mod build;
mod choices;
mod clock;
mod error;
mod exec;
mod intersector;
mod lock;
pub mod mesh;
mod output;
mod picture;
#[cfg(feature = "plan")]
pub mod plan;
mod query;
mod quoted;
mod random;
pub mod rays;
mod read;
mod scene;
#[cfg(feature = "stress")]
pub mod stress;
mod traversal;
mod tree;
mod vector;

pub use build::{BuildOptions, BuildTimes, Builder, KernelTimes};
pub use error::{Error, TreeError};
#[cfg(feature = "gpu")]
pub use exec::{AdapterReport, AdapterVerdict, adapters, required_features, required_limits};
pub use exec::{BufferLimit, Device, DeviceKind};
pub use intersector::Intersector;
pub use mesh::Mesh;
pub use query::Query;
pub use raykd_kernels::trace::single;
pub use raykd_shared as shared;
pub use raykd_shared::{Crossings, Hit, MISS, Ray};
pub use rays::{AnyPoint, AnyRay, Ray64};
pub use read::default_max_bytes;
pub use scene::{
    AllHits, Contact, ContactCount, Contacts, Counted, RaySteps, ResidentRays, Scene, Stepped, TraceTimes,
    Traced, Tracer, World, WorldHit, WorldTraced,
};
#[cfg(feature = "gpu")]
pub use scene::{Encoded, RayCount, SceneBuffers, WGSL};
pub use traversal::Traversal;
pub use tree::KdTree;
#[cfg(feature = "gpu")]
pub use wgpu;

// The example in the README is compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;

/// What raykd's own program and tests use beyond the library. No version promises anything about it.
#[doc(hidden)]
pub mod internals {
    #[cfg(feature = "gpu")]
    pub use crate::exec::Gpu;
    #[cfg(feature = "plan")]
    pub use crate::plan::{
        best_of,
        calibration::rays_for,
        cost::{Moving, measure, speed, usual_rays, wake},
    };
    pub use crate::{
        build::LISTED as SWEEP_LISTED,
        exec::{AnyBuffer, Buffer, Cpu, Groups, Launch, OnDevice, Out, Step, Timing, reserve, watch},
        intersector::WithTest,
        mesh::{known_formats, mesh_extensions, ply_vertices, teapot_level_for},
        quoted::{QUOTED, quoted},
        read::all_of,
        tree::{digest_of, hits_digest},
    };
    pub use raykd_kernels as kernels;

    #[cfg(feature = "gltf")]
    pub use crate::mesh::files_beside;
    /// Pictures of scenes.
    pub mod picture {
        pub use crate::picture::{
            Picture, Rgb, Shading, camera, encode, full_scale, heat, rays_of, render, render_while, rows,
            samples_of,
        };
    }
    /// Files that appear whole or not at all.
    pub mod output {
        pub use crate::output::{abandon, check, check_folder, write_folder, write_whole};
    }
}
