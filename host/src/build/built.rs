//! Meshes and trees on a device.

use super::{room::Arena, times::BuildTimes};
use crate::{
    Error,
    clock::Instant,
    exec::{Buffer, Device},
    mesh::Mesh,
};
use raykd_kernels::glam::Vec4;
use raykd_shared::{Node, TreeHeader};
use std::{fmt, sync::Arc, time::Duration};

/// A tree on a device.
#[derive(Debug)]
pub(crate) struct Built {
    pub header: TreeHeader,
    pub nodes: Buffer<Node>,
    pub refs: Buffer<u32>,
    pub times: BuildTimes,
    pub laid: Laid,
}

/// What is on the device already of what is laid out for tracing: a tree's header, and the triangles of its leaves.
#[derive(Debug, Default)]
pub(crate) struct Laid {
    pub header: Option<Buffer<TreeHeader>>,
    pub corners: Option<Buffer<Vec4>>,
}

impl Built {
    /// With what getting ready took.
    pub(crate) fn after(mut self, upload: Duration) -> Self {
        self.times.upload += upload;
        self
    }
}

/// What a try leaves of it.
#[derive(Debug)]
pub(super) struct Grown {
    pub nodes: Buffer<Node>,
    pub refs: Buffer<u32>,
    /// Numbers of nodes and references.
    pub counts: [u32; 2],
    pub depth: u32,
    pub times: BuildTimes,
    pub laid: Laid,
}

/// An indexed mesh on a device.
#[derive(Clone, Debug)]
pub(crate) struct MeshBuffers {
    pub positions: Buffer<f32>,
    /// Numbers in it.
    pub coordinates: usize,
    pub indices: Buffer<u32>,
}

/// What a build has to know of a mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facts {
    pub triangles: u32,
    /// How many of them take part.
    pub kept: u32,
    /// The box around those, scaled.
    pub bounds: ([f32; 3], [f32; 3]),
    pub scale: f32,
}

impl From<&Mesh> for Facts {
    fn from(mesh: &Mesh) -> Self {
        Self {
            triangles: mesh.triangles().len() as u32,
            kept: mesh.kept().len() as u32,
            bounds: mesh.scaled_bounds(),
            scale: mesh.scale(),
        }
    }
}

/// Where the numbers of the triangles that take part are, in ascending order.
#[derive(Clone, Copy, Debug)]
pub(crate) enum KeptIn<'a> {
    /// The host has the mesh.
    Host(&'a Mesh),
    /// Only the device has it, and the list.
    Device(&'a Buffer<u32>),
}

/// A mesh on a device, to be built from.
#[derive(Debug)]
pub(crate) struct Given<'a> {
    pub facts: Facts,
    pub on_device: MeshBuffers,
    pub kept: KeptIn<'a>,
}

impl<'a> Given<'a> {
    /// A mesh of the host, copied to the device.
    pub(crate) fn of(device: &Device, mesh: &'a Mesh) -> Result<Self, Error> {
        Ok(Self { facts: mesh.into(), on_device: upload(device, mesh)?, kept: KeptIn::Host(mesh) })
    }

    /// Bytes of its buffers.
    pub(super) fn bytes(&self) -> u64 {
        let MeshBuffers { positions, indices, .. } = &self.on_device;
        let kept = match self.kept {
            KeptIn::Host(_) => 0,
            KeptIn::Device(kept) => kept.bytes(),
        };
        positions.bytes() + indices.bytes() + kept
    }
}

/// The triangles that take part, as a scene keeps them.
#[derive(Clone)]
pub(crate) enum Kept {
    Host(Arc<[u32]>),
    Device { list: Buffer<u32>, count: u32 },
}

/// Without the list, which may be long.
impl fmt::Debug for Kept {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Kept").field("count", &self.count()).finish_non_exhaustive()
    }
}

impl Kept {
    /// How many there are.
    pub(crate) fn count(&self) -> u32 {
        match self {
            Self::Host(list) => list.len() as u32,
            Self::Device { count, .. } => *count,
        }
    }

    /// Bytes that it takes there.
    pub(crate) fn bytes_on_device(&self) -> u64 {
        match self {
            Self::Host(_) => 0,
            Self::Device { list, .. } => list.bytes(),
        }
    }

    /// The list, on the device.
    pub(crate) fn on(&self, device: &Device) -> Result<Buffer<u32>, Error> {
        match self {
            Self::Host(list) => device.upload("kept", list),
            Self::Device { list, .. } => Ok(list.clone()),
        }
    }

    /// The list, on the host.
    pub(crate) fn list(&self, device: &Device) -> Result<Arc<[u32]>, Error> {
        match self {
            Self::Host(list) => Ok(list.clone()),
            Self::Device { list, count } => Ok(device.read(list, 0, *count as usize)?.into()),
        }
    }
}

/// Copies the mesh to the device.
pub(crate) fn upload(device: &Device, mesh: &Mesh) -> Result<MeshBuffers, Error> {
    let coordinates = mesh.scaled_positions();
    let positions = device.put("positions", &coordinates)?;
    let indices = device.put("indices", mesh.triangles().as_flattened())?;
    Ok(MeshBuffers { positions, coordinates: coordinates.len(), indices })
}

impl Grown {
    /// Puts what the host has built on the device.
    pub(super) fn put(
        arena: &mut Arena<'_>,
        nodes: &[Node],
        refs: &[u32],
        depth: u32,
        times: BuildTimes,
    ) -> Result<Self, Error> {
        let counts = [nodes.len() as u32, refs.len() as u32];
        let begin = Instant::now();
        let (nodes, refs) = (arena.upload("nodes", nodes)?, arena.upload("refs", refs)?);
        Ok(Self {
            nodes,
            refs,
            counts,
            depth,
            times: BuildTimes { upload: begin.elapsed(), ..times },
            laid: Laid::default(),
        })
    }
}
