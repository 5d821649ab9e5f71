//! A mesh with its tree on a device, ready to trace.

mod batch;
mod build;
mod choose;
mod contacts;
mod crossings;
#[cfg(feature = "gpu")]
mod encode;
mod file;
#[cfg(feature = "gpu")]
mod on;
mod rebuild;
mod regions;
mod trace;
mod tracer;
mod winding;
mod world;

pub use batch::ResidentRays;
pub use contacts::{Contact, ContactCount, Contacts};
pub use crossings::Counted;
#[cfg(feature = "gpu")]
pub use encode::{Encoded, RayCount, SceneBuffers, WGSL};
pub use trace::{AllHits, RaySteps, Stepped, TraceTimes, Traced};
pub use tracer::Tracer;
pub use world::{World, WorldHit, WorldTraced};

use crate::{
    BuildTimes, Error, Intersector, KdTree, Mesh,
    build::{Kept, MeshBuffers},
    exec::{Buffer, Device},
    mesh::digest,
    traversal::{Extras, Traversal},
};
use raykd_kernels::glam::{UVec4, Vec4};
use raykd_shared::TreeHeader;
use regions::Regions;

/// A mesh and its tree, resident on a device. Clones share all memory; each has a traversal and a triangle test of its
/// own.
#[derive(Clone, Debug)]
pub struct Scene {
    device: Device,
    header: TreeHeader,
    header_buffer: Buffer<TreeHeader>,
    /// Node by node a `Node`, of which kernels read pairs.
    nodes: Buffer<UVec4>,
    refs: Buffer<u32>,
    mesh: MeshBuffers,
    corners: Buffer<Vec4>,
    kept: Kept,
    /// What rays lose of their origins, as the mesh did.
    translation: [f64; 3],
    times: BuildTimes,
    traversal: Traversal,
    intersector: Intersector,
    /// What the triangle test `baldwin` keeps instead of corners.
    transforms: Option<Buffer<Vec4>>,
    extras: Extras,
    regions: Regions,
}

impl Scene {
    /// The device the scene lives on.
    pub const fn device(&self) -> &Device {
        &self.device
    }

    /// How long the build took and what it needed.
    pub const fn times(&self) -> &BuildTimes {
        &self.times
    }

    /// The tree's header. Its digest of the mesh and its checksum are zeros: [`Scene::tree`] fills them in.
    pub const fn header(&self) -> &TreeHeader {
        &self.header
    }

    /// Downloads the tree.
    ///
    /// # Errors
    /// The device failed.
    pub fn tree(&self) -> Result<KdTree, Error> {
        let nodes = self.device.read(&self.nodes.view(), 0, self.header.nodes as usize)?;
        let refs = self.device.read(&self.refs, 0, self.header.refs as usize)?;
        let (positions, indices) = self.coordinates_and_indices()?;
        let kept = self.kept.list(&self.device)?;
        let mesh = self.device.install(|| digest(&positions, &indices, &kept));
        Ok(KdTree::sealed(self.header, nodes, refs, mesh))
    }

    /// The mesh of which the scene was built, as kernels see it: coordinates are rounded as [`Mesh::positions`] are,
    /// and what is too small for them is 0. Brought from the device and checked again.
    ///
    /// # Errors
    /// The device failed.
    pub fn mesh(&self) -> Result<Mesh, Error> {
        let (positions, indices) = self.coordinates_and_indices()?;
        let larger = 1.0 / self.header.scale;
        let vertex = |p: &[f32; 3]| p.map(|x| x * larger);
        let positions = positions.as_chunks().0.iter().map(vertex).collect();
        Ok(Mesh::new(positions, indices)?.moved(self.translation))
    }

    /// The mesh as it lies on the device, scaled.
    fn coordinates_and_indices(&self) -> Result<(Vec<f32>, Vec<[u32; 3]>), Error> {
        let positions = self.device.read(&self.mesh.positions, 0, self.mesh.coordinates)?;
        let indices = self.device.read(&self.mesh.indices.view(), 0, self.header.triangles as usize)?;
        Ok((positions, indices))
    }

    /// The scene for rays that are where its mesh was moved to.
    #[doc(hidden)]
    #[must_use]
    pub fn into_local(self) -> Self {
        Self { translation: [0.0; 3], ..self }
    }

    /// How rays find their way through the tree.
    pub const fn traversal(&self) -> Traversal {
        self.traversal
    }

    /// How it is told whether a ray hits a triangle.
    pub const fn intersector(&self) -> Intersector {
        self.intersector
    }

    /// Bytes of the tree on the device as its traversal uses it: nodes, references, and parents, boxes or ropes.
    pub fn tree_bytes(&self) -> u64 {
        u64::from(self.header.nodes) * 8 + u64::from(self.header.refs) * 4 + self.extras.bytes(self.traversal)
    }

    /// Bytes of all that the scene keeps on its device: mesh, tree, and what its traversals and triangle tests needed
    /// so far. On the CPU those of a scene that [`Scene::open`] opened are mostly the file's.
    pub fn bytes_on_device(&self) -> u64 {
        let MeshBuffers { positions, indices, .. } = &self.mesh;
        let transforms = self.transforms.as_ref().map_or(0, |buffer| buffer.bytes());
        let tree = self.header_buffer.bytes() + self.nodes.bytes() + self.refs.bytes() + self.corners.bytes();
        let mesh = positions.bytes() + indices.bytes() + self.kept.bytes_on_device();
        tree + mesh + transforms + self.extras.all_bytes() + self.regions.bytes()
    }
}
