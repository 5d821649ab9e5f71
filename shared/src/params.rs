//! Parameters of one build, as the kernels read them.

use bytemuck::{Pod, Zeroable};

/// What every build kernel knows about its scene: one 80-byte record.
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
    /// Room in the list of references of branches and treelets; in the sweep, of all leaves.
    pub treelet_refs: u32,
    /// Room in the list of active nodes of a level.
    pub active: u32,
    /// Room in the list of treelets, and for as many pairs of nodes above them; in the sweep, for all nodes.
    pub treelets: u32,
    /// References have hardly any price in nodes of more.
    pub long: u32,
    /// How planes are chosen: bits of [`rule`].
    pub rule: u32,
    /// Nodes of at most this many references become treelets; at most [`crate::limits::TREELET`]. In the
    /// builder `exact`, they have no lists of faces.
    pub small: u32,
    /// What listing a triangle in one more leaf costs, in units of cost times half area; less in nodes where
    /// it cannot be saved.
    pub price: f32,
    /// Factor on the cost of planes that cut off empty space.
    pub empty: f32,
}

/// Bits of [`BuildParams::rule`].
pub mod rule {
    /// Large nodes are cut at empty space or in the middle, not by the surface area heuristic.
    pub const MEDIAN: u32 = 1;
    /// Small nodes are leaves.
    pub const LEAVES: u32 = 2;
    /// References whose triangle does not reach into a child's box are dropped there.
    pub const CLIP: u32 = 4;
}

const _: () = assert!(size_of::<BuildParams>() == 80, "20 words");
