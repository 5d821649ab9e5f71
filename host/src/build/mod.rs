//! Building: a mesh and options become a tree on a device.
//!
//! [`options`] is what may be asked, [`room`] how long lists are, [`retry`] what happens if one is too short.
//! The trees of [`Builder::Exact`] are built by [`sweep`], all others by [`levels`].

mod built;
mod levels;
mod options;
mod retry;
mod room;
mod sweep;

pub(crate) use built::{Built, MeshBuffers, upload};
pub use options::{BuildOptions, BuildTimes, Builder, KernelTimes};
pub use sweep::LISTED;

use crate::{Error, exec::Device, mesh::Mesh};
use built::Grown;
use raykd_shared::{Node, TreeHeader};
use retry::{Setting, Stop, Way};
use room::Arena;
use std::time::{Duration, Instant};

/// Builds the tree of `mesh` on `device`.
pub(crate) fn build(
    device: &Device,
    mesh: &Mesh,
    options: &BuildOptions,
) -> Result<(MeshBuffers, Built), Error> {
    let way = match options.builder {
        _ if options.max_depth == 0 => Way::Leaf,
        Builder::Exact if device.is_cpu() => Way::SweepByHost,
        Builder::Exact => Way::SweepByKernels { small: LISTED },
        _ => Way::Levels,
    };
    until_built(device, mesh, options, way)
}

/// The same by the kernels of the sweep on any device, with lists of faces in nodes of more than `small` references.
pub(crate) fn sweep_by_kernels(
    device: &Device,
    mesh: &Mesh,
    options: &BuildOptions,
    small: u32,
) -> Result<(MeshBuffers, Built), Error> {
    until_built(device, mesh, options, Way::SweepByKernels { small })
}

/// Tries until there is a tree.
fn until_built(
    device: &Device,
    mesh: &Mesh,
    options: &BuildOptions,
    way: Way,
) -> Result<(MeshBuffers, Built), Error> {
    options.check()?;
    let begin = Instant::now();
    let on_device = upload(device, mesh)?;
    let upload = begin.elapsed();
    let mut setting = Setting::first(mesh, options, way);
    let (mut retries, mut failed) = (0, Duration::ZERO);
    loop {
        let begin = Instant::now();
        let bytes = on_device.positions.bytes() + on_device.indices.bytes();
        let mut arena = Arena { device, bytes };
        match attempt(&mut arena, mesh, &on_device, &setting, options.profile) {
            Ok(Grown { nodes, refs, counts, depth, times }) => {
                let header = header(mesh, options, counts, depth);
                let times = BuildTimes {
                    upload: upload + times.upload,
                    peak_bytes: arena.bytes,
                    retries,
                    failed,
                    by_host: setting.way == Way::SweepByHost && !device.is_cpu(),
                    ..times
                };
                return Ok((on_device, Built { header, nodes, refs, times }));
            }
            Err(stop) => setting.change(stop)?,
        }
        retries += 1;
        failed += begin.elapsed();
    }
}

/// One try.
fn attempt(
    arena: &mut Arena<'_>,
    mesh: &Mesh,
    on_device: &MeshBuffers,
    setting: &Setting<'_>,
    profile: bool,
) -> Result<Grown, Stop> {
    let params = setting.params();
    let grown = match setting.way {
        Way::Leaf => leaf(arena, mesh)?,
        Way::Levels => levels::build(arena, mesh, on_device, &params, setting.levels(), profile)?,
        Way::SweepByKernels { .. } => sweep::kernels::build(arena, mesh, on_device, &params, profile)?,
        Way::SweepByHost => sweep::host::build(arena, mesh, &params)?,
    };
    setting.check_budget(grown.counts[1])?;
    Ok(grown)
}

/// No tree: one leaf that lists every triangle.
fn leaf(arena: &mut Arena<'_>, mesh: &Mesh) -> Result<Grown, Error> {
    let nodes = [Node::leaf(0, mesh.kept().len() as u32), Node::PADDING];
    Grown::put(arena, &nodes, mesh.kept(), 0, BuildTimes::default())
}

/// The header of a tree, without the mesh's digest and the checksum.
fn header(mesh: &Mesh, options: &BuildOptions, [nodes, refs]: [u32; 2], depth: u32) -> TreeHeader {
    let (lo, hi) = mesh.scaled_bounds();
    TreeHeader {
        lo,
        nodes,
        hi,
        refs,
        triangles: mesh.triangles().len() as u32,
        depth,
        scale: mesh.scale(),
        cost_step: options.cost_step,
        cost_test: options.cost_test,
        mesh: [0; 2],
        checksum: 0,
    }
}
