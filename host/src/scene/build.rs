//! A mesh becomes a scene: its tree is built on the device, or put there.

use super::{Scene, regions::Regions};
use crate::{
    BuildOptions, BuildTimes, Error, Intersector, KdTree, Mesh, Traversal,
    build::{
        Built, Copies, Given, Kept, Laid, MeshBuffers, Survey, build, survey_and_build, sweep_by_kernels,
        upload,
    },
    clock::Instant,
    exec::{Buffer, Device, Launch, Step},
    traversal::Extras,
};
use raykd_kernels::{glam::Vec4, trace::prepare::corners};
use raykd_shared::TreeHeader;

impl Scene {
    /// Builds the tree of a mesh on a device.
    ///
    /// # Errors
    /// An option is out of its range, the mesh does not fit the device, or the device failed.
    pub fn build(device: &Device, mesh: &Mesh, options: &BuildOptions) -> Result<Self, Error> {
        Self::of(device, mesh, options, |given| build(device, given, options))
    }

    /// For tests: [`Builder::Exact`] by its kernels, on any device, with lists in nodes of more than `small`
    /// references.
    #[doc(hidden)]
    pub fn sweep_by_kernels(
        device: &Device,
        mesh: &Mesh,
        options: &BuildOptions,
        small: u32,
    ) -> Result<Self, Error> {
        Self::of(device, mesh, options, |given| sweep_by_kernels(device, given, options, small))
    }

    fn of(
        device: &Device,
        mesh: &Mesh,
        options: &BuildOptions,
        build: impl FnOnce(&Given<'_>) -> Result<Built, Error>,
    ) -> Result<Self, Error> {
        options.check()?;
        let start = Instant::now();
        let given = Given::of(device, mesh)?;
        let upload = start.elapsed();
        let built = build(&given)?.after(upload);
        Self::assemble(device, given.on_device, Kept::Host(mesh.kept().into()), mesh.translation(), built)
    }

    /// For tests: `Scene::build_on` of any device's own buffers.
    ///
    /// # Errors
    /// The numbers are no mesh, an option is out of its range, or the device failed.
    #[doc(hidden)]
    pub fn build_from(
        device: &Device,
        positions: &Buffer<u32>,
        indices: &Buffer<u32>,
        [vertices, triangles]: [u32; 2],
        options: &BuildOptions,
    ) -> Result<Self, Error> {
        Self::surveyed(device, vertices, triangles, options, |copies, then| {
            device.begin(&[&copies.steps(positions, indices), then].concat())
        })
    }

    /// Builds from a mesh that `copy` makes the device copy, and then run some steps.
    pub(super) fn surveyed(
        device: &Device,
        vertices: u32,
        triangles: u32,
        options: &BuildOptions,
        copy: impl FnOnce(Copies<'_>, &[Step<'_>]) -> Result<(), Error>,
    ) -> Result<Self, Error> {
        options.check()?;
        let start = Instant::now();
        let survey = Survey::begin(device, vertices, triangles, copy)?;
        let upload = start.elapsed();
        let (surveyed, built) = survey_and_build(device, survey, options)?;
        let kept = Kept::Device { list: surveyed.kept.clone(), count: surveyed.count() };
        Self::assemble(device, surveyed.given().on_device, kept, [0.0; 3], built.after(upload))
    }

    /// Puts a mesh and a tree built earlier on a device.
    ///
    /// # Errors
    /// The tree is damaged or not this mesh's, or does not fit the device.
    pub fn with_tree(device: &Device, mesh: &Mesh, tree: &KdTree) -> Result<Self, Error> {
        tree.validate()?;
        tree.check_mesh(mesh)?;
        let header = TreeHeader { mesh: [0; 2], checksum: 0, ..tree.header };
        let start = Instant::now();
        let nodes = device.upload("nodes", &tree.nodes)?;
        let refs = device.upload("refs", &tree.refs)?;
        let on_device = upload(device, mesh)?;
        let times = BuildTimes { upload: start.elapsed(), ..BuildTimes::default() };
        let (kept, built) =
            (Kept::Host(mesh.kept().into()), Built { header, nodes, refs, times, laid: Laid::default() });
        Self::assemble(device, on_device, kept, mesh.translation(), built)
    }

    /// Lays the tree out for tracing, if that is not done.
    pub(super) fn assemble(
        device: &Device,
        on_device: MeshBuffers,
        kept: Kept,
        translation: [f64; 3],
        mut built: Built,
    ) -> Result<Self, Error> {
        let header = match built.laid.header.take() {
            Some(header) => header,
            None => device.put("header", &[built.header])?,
        };
        let corners = match built.laid.corners.take() {
            Some(corners) => corners,
            None => lay_out(device, &header, &on_device, &mut built)?,
        };
        Ok(Self {
            device: device.clone(),
            header: built.header,
            header_buffer: header,
            nodes: built.nodes.view(),
            refs: built.refs,
            mesh: on_device,
            corners,
            kept,
            translation,
            times: built.times,
            traversal: Traversal::default(),
            intersector: Intersector::default(),
            transforms: None,
            extras: Extras::default(),
            regions: Regions::default(),
        })
    }
}

/// Lays the triangles of the leaves out.
fn lay_out(
    device: &Device,
    header: &Buffer<TreeHeader>,
    mesh: &MeshBuffers,
    built: &mut Built,
) -> Result<Buffer<Vec4>, Error> {
    let corners = device.room("corners", 3 * u64::from(built.header.refs))?;
    let steps = corners::Buffers {
        header,
        positions: &mesh.positions,
        indices: &mesh.indices,
        refs: &built.refs,
        corners: corners.out(),
    };
    built.times.layout = device.dispatch(&[steps.over(built.header.refs)], false)?.total;
    Ok(corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Builder;
    use raykd_shared::limits::MAX_DEPTH;

    #[test]
    fn leaves_are_no_deeper_than_a_tree_may_be() {
        let (device, mesh) = (Device::cpu(), Mesh::teapot(1));
        let build = |depth| Scene::build(&device, &mesh, &BuildOptions::default().with_max_depth(depth));
        assert!(build(MAX_DEPTH).is_ok());
        for depth in [MAX_DEPTH + 1, u32::MAX] {
            let error = build(depth).unwrap_err().to_string();
            assert!(error.contains("max_depth") && error.contains("from 0 to 48"), "{error}");
        }
    }

    /// A tree that such costs are written into is no valid one.
    #[test]
    fn options_out_of_range_are_refused() {
        let (device, mesh) = (Device::cpu(), Mesh::teapot(1));
        for cost in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0] {
            for &builder in Builder::ALL {
                let usual = BuildOptions { builder, ..BuildOptions::default() };
                for (name, options) in [
                    ("cost_step", BuildOptions { cost_step: cost, ..usual.clone() }),
                    ("cost_test", BuildOptions { cost_test: cost, ..usual.clone() }),
                    ("price", BuildOptions { price: cost, ..usual.clone() }),
                    ("empty", BuildOptions { empty: cost, ..usual.clone() }),
                    ("budget", BuildOptions { budget: Some(cost.min(0.5)), ..usual.clone() }),
                ] {
                    let error = Scene::build(&device, &mesh, &options).unwrap_err().to_string();
                    assert!(error.contains(name) && error.contains("must be from"), "{error}");
                }
            }
        }
    }
}
