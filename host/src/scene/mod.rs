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
mod order;
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
        let kept = self.kept.list(&self.device)?.to_vec();
        Ok(Mesh::of_scene(positions, indices, kept, &self.header)?.moved(self.translation))
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

    /// Bytes of the tree on the device as its traversal uses it: nodes, references, and parents, boxes or ropes; or of
    /// the nodes that it uses instead.
    pub fn tree_bytes(&self) -> u64 {
        let more = self.extras.bytes(self.traversal);
        match self.extras.wide(self.traversal) {
            Some(_) => more,
            None => u64::from(self.header.nodes) * 8 + u64::from(self.header.refs) * 4 + more,
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuildOptions;

    /// Coordinates that are 0 for kernels, others next to them that are not, and a triangle on one line that has area
    /// without the former, which counts if others have such coordinates, too; small, too, so that such a triangle would
    /// make the mesh larger.
    #[test]
    fn a_scene_has_the_mesh_of_which_it_was_built() {
        let dust = 2f32.powi(-60);
        let solid = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let on_lines = [[0.9 * dust, 0.5, 0.0], [1.8 * dust, 1.0, 0.0]];
        let tiny = solid.map(|p| p.map(|x| x * 2f32.powi(-100)));
        let huge = [[1e8, 1e-20, 0.0], [4e8, 4e-20, 0.0]];
        let (dusty, small) = ([solid.as_slice(), &on_lines].concat(), [tiny.as_slice(), &huge].concat());
        let three = [[0, 1, 2], [0, 1, 3], [0, 4, 5]];
        let four = [three.as_slice(), &[[2, 3, 4]]].concat();
        for (corners, triangles, kept) in [
            (&dusty, three.as_slice(), &[0, 1][..]),
            (&dusty, &four, &[0, 1, 2, 3]),
            (&small, &three, &[0, 1]),
        ] {
            let mesh = Mesh::new(corners.clone(), triangles.to_vec()).unwrap();
            assert_eq!(mesh.kept(), kept);
            let scene = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default()).unwrap();
            let back = scene.mesh().unwrap();
            assert_eq!((back.kept(), back.triangles()), (mesh.kept(), mesh.triangles()));
            assert_eq!((back.bounds(), back.scale()), (mesh.bounds(), mesh.scale()));
            assert_eq!(
                (back.scaled_positions(), back.tree_key()),
                (mesh.scaled_positions(), mesh.tree_key())
            );
            assert!(scene.contacts(&back).is_ok());
        }
    }

    #[test]
    fn what_is_printed_of_a_scene_does_not_grow_with_it() {
        let printed = |level| {
            let scene = Scene::build(&Device::cpu(), &Mesh::teapot(level), &BuildOptions::default()).unwrap();
            let tracer = scene.tracer().unwrap();
            format!("{scene:?}{tracer:?}").len()
        };
        assert!(printed(20) < printed(2) + 100, "{} and {}", printed(20), printed(2));
    }

    /// As many as there are, where a process has not as many addresses as asked for.
    #[test]
    fn all_hits_take_memory_for_those_there_are() {
        let scene = Scene::build(&Device::cpu(), &Mesh::teapot(1), &BuildOptions::default()).unwrap();
        let rays = vec![raykd_shared::Ray::new([0.0; 3], [1.0, 0.0, 0.0]); 4096];
        let all = scene.all(&rays, u32::MAX).unwrap();
        assert!(all.totals[0] > 0 && all.hits.len() == 4096 * all.totals[0] as usize);
    }

    #[test]
    fn all_hits_that_do_not_fit_at_once_come_in_parts() {
        let mesh = Mesh::teapot(4);
        let scene = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default()).unwrap();
        let mut rays = crate::rays::random(mesh.bounds(), 1000, 1);
        rays.push(raykd_shared::Ray::new([f32::NAN; 3], [0.0; 3]));
        let whole = scene.all(&rays, 3).unwrap();
        // A single ray's hits are asked for whatever the room.
        for room in [0, 1, 100, whole.hits.len() as u64 - 1] {
            let mut parts = AllHits { begins: vec![0], ..AllHits::default() };
            scene.all_of(&rays, 3, room, &mut parts).unwrap();
            assert!(parts.hits == whole.hits && parts.begins == whole.begins && parts.totals == whole.totals);
            assert_eq!((parts.invalid, whole.invalid), (1, 1));
        }
    }
}
