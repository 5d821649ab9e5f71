//! Parameters of one build, as the kernels read them.

use bytemuck::{Pod, Zeroable};

/// What every build kernel knows about its scene: one 64-byte record.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct BuildParams {
    /// Lower corner of the box around all triangles, scaled.
    pub lo: [f32; 3],
    /// Triangles in the mesh, those kept out of the tree included.
    pub triangles: u32,
    /// Upper corner of that box.
    pub hi: [f32; 3],
    /// References of the root: the triangles that take part.
    pub references: u32,
    /// SAH cost of one traversal step (Wald & Havran 2006, section 2).
    pub cost_step: f32,
    /// SAH cost of one triangle test.
    pub cost_test: f32,
    /// Deepest level a leaf may lie on.
    pub max_depth: u32,
    /// Room in each list of references of the level loop.
    pub level_refs: u32,
    /// Room in the list of references of finished large leaves and treelets.
    pub treelet_refs: u32,
    /// Room in the list of active nodes of a level.
    pub active: u32,
    /// Room for the nodes above the treelets.
    pub top_nodes: u32,
    /// Room in the list of treelets.
    pub treelets: u32,
}

const _: () = assert!(size_of::<BuildParams>() == 64, "sixteen words");
