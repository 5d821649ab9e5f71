//! Scenes of meshes that lie on a wgpu program's own device.

use super::{
    Scene,
    encode::{InEncoder, bind, refused, room},
};
use crate::{
    BuildOptions, Error,
    build::Copies,
    exec::{Buffer, Device, Gpu, Size, Step},
};
use raykd_kernels::{
    Bindings,
    build::survey::{indices, vertices},
};

/// Bytes of a vertex and of a triangle.
const THREE: u64 = 12;

impl Scene {
    /// Builds the tree of a mesh that lies in buffers of a wgpu program.
    ///
    /// `positions` holds three `f32` a vertex, `indices` three `u32` a triangle, the numbers of its vertices: 12 bytes
    /// each, with nothing between. Both are parts of buffers with `BufferUsages::STORAGE`, perhaps of one, and begin at
    /// a multiple of the device's `min_storage_buffer_offset_alignment`; how many there are is told by their sizes.
    /// They are read as commands that were submitted before have left them, and copied on the device: they may be
    /// changed as soon as this returns. If the mesh changes often, [`Scene::rebuild_on`] spares memory.
    ///
    /// The scene is the one that [`Scene::build`] makes of the same numbers: the same tree, the same hits, byte for
    /// byte. Nothing of the mesh passes the bus. What comes back are some words that say how large mesh and tree are.
    /// Duplicates are not counted, nor is anything else of [`Repairs`](crate::mesh::Repairs). The mesh is never moved,
    /// as none of `f32` is.
    ///
    /// [`BuildTimes::upload`](crate::BuildTimes::upload) is what making the mesh ready took, by the clock on the wall.
    /// On a device of [`Device::recycling`] it is as much of that as the host waits for.
    /// [`Builder::Exact`](crate::Builder::Exact) is not helped out by the host if the device lacks the room. Later,
    /// [`Scene::tree`] brings the mesh to the host, for the digest of a saved tree, and [`Scene::tracer`] what leaves
    /// hold.
    ///
    /// # Errors
    /// As for [`Scene::build`] and [`Mesh::new`](crate::Mesh::new), naming the first vertex that is not finite, else
    /// the first triangle with an index out of range. The device is the CPU, or a buffer lacks a usage or holds no
    /// whole number of vertices or triangles.
    pub fn build_on(
        device: &Device,
        positions: wgpu::BufferSlice<'_>,
        indices: wgpu::BufferSlice<'_>,
        options: &BuildOptions,
    ) -> Result<Self, Error> {
        let gpu = device
            .as_gpu()
            .ok_or_else(|| refused("the device is the CPU; a mesh in buffers of wgpu is built on a GPU"))?;
        let vertices = threes(gpu, "vertices", positions)?;
        let triangles = threes(gpu, "triangles", indices)?;
        Self::surveyed(device, vertices, triangles, options, |copies, then| {
            copy_by_encoder(gpu, copies, (vertices, triangles), positions, indices, then)
        })
    }
}

/// How many elements of three words a part of a buffer holds.
fn threes(gpu: &Gpu, what: &str, part: wgpu::BufferSlice<'_>) -> Result<u32, Error> {
    if part.size() % THREE != 0 {
        let bytes = part.size();
        let why =
            format!("{bytes} bytes hold no whole number of {what} of {THREE} bytes; give the part that does");
        return Err(refused(why));
    }
    match room::<[u32; 3]>(gpu, what, part)? {
        0 => Err(refused(format!("there are no {what}"))),
        // Of all numbers of a word's width the largest means none.
        count if u64::from(count) * 3 < u64::from(u32::MAX) => Ok(count),
        count => Err(refused(format!("{count} {what} are too many to number their words by 32 bits"))),
    }
}

/// The whole of a buffer.
fn own(buffer: &Buffer<u32>) -> wgpu::BindingResource<'_> {
    buffer.as_wgpu().as_entire_binding()
}

/// Copies the mesh by commands of its own, which are submitted with some steps behind them, but not waited for.
fn copy_by_encoder(
    gpu: &Gpu,
    copies: Copies<'_>,
    (vertices, triangles): (u32, u32),
    positions: wgpu::BufferSlice<'_>,
    indices: wgpu::BufferSlice<'_>,
    then: &[Step<'_>],
) -> Result<(), Error> {
    let copy_vertices = vertices::Buffers::<InEncoder> {
        job: own(copies.job),
        given: bind(positions),
        positions: own(copies.positions),
        found: own(copies.found),
    };
    let copy_indices = indices::Buffers::<InEncoder> {
        job: own(copies.job),
        given: bind(indices),
        indices: own(copies.indices),
        found: own(copies.found),
    };
    let (device, _) = gpu.parts();
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let (first, second) = (copy_vertices.list(), copy_indices.list());
    gpu.encode_one(&mut encoder, &vertices::VERTICES, &first, Size::Lanes(3 * vertices))?;
    gpu.encode_one(&mut encoder, &indices::INDICES, &second, Size::Lanes(3 * triangles))?;
    gpu.begin_after(encoder, then)
}
