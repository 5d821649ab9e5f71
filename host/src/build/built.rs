//! Meshes and trees on a device.

use super::{options::BuildTimes, room::Arena};
use crate::{
    Error,
    exec::{Buffer, Device},
    mesh::Mesh,
};
use raykd_shared::{Node, TreeHeader};
use std::time::Instant;

/// A tree on a device.
#[derive(Debug)]
pub(crate) struct Built {
    pub header: TreeHeader,
    pub nodes: Buffer<Node>,
    pub refs: Buffer<u32>,
    pub times: BuildTimes,
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
}

/// An indexed mesh on a device.
#[derive(Clone, Debug)]
pub(crate) struct MeshBuffers {
    pub positions: Buffer<f32>,
    /// Numbers in it.
    pub coordinates: usize,
    pub indices: Buffer<u32>,
}

/// Copies the mesh to the device.
pub(crate) fn upload(device: &Device, mesh: &Mesh) -> Result<MeshBuffers, Error> {
    let coordinates = mesh.scaled_positions();
    let positions = device.upload("positions", &coordinates)?;
    let indices = device.upload("indices", mesh.triangles().as_flattened())?;
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
        Ok(Self { nodes, refs, counts, depth, times: BuildTimes { upload: begin.elapsed(), ..times } })
    }
}
