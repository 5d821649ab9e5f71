//! The numbers that builder, traversal and host must agree on; their only home.

/// No leaf lies deeper than this many edges below the root. It caps the builder and sizes the traversal
/// stack, which holds at most one entry per edge.
pub const MAX_DEPTH: u32 = 48;

/// Bins per axis in the SAH sweep of large nodes.
pub const BINS: u32 = 32;

/// Nodes of at most this many references are finished by one workgroup, with one bit a reference in a `u32`.
pub const TREELET: u32 = 32;

/// The subtree of a node of at most this many references is built by one workgroup, down to treelets.
pub const BRANCH: u32 = 256;

/// Most of [`chunk`].
pub const MOST_CHUNK: u32 = 2048;

/// References per workgroup in the passes over large nodes, in a mesh of so many: few keep a device busy where there
/// are not many, more save histograms.
pub const fn chunk(references: u32) -> u32 {
    if references < 1 << 19 {
        512
    } else if references < 1 << 21 {
        1024
    } else {
        MOST_CHUNK
    }
}

/// Node slots a treelet of `n` references may use, root excluded: bounds its memory.
pub const fn treelet_nodes(n: u32) -> u32 {
    if n > TREELET { 0 } else { 2 * n + 8 }
}

/// Most triangles in one mesh: ids and counts share 30-bit fields with tags.
pub const MAX_TRIANGLES: u32 = (1 << 28) - 1;

/// A mesh whose longest extent is at least two to this power, and at most two to [`MOST_UNSCALED`], is not scaled.
pub const LEAST_UNSCALED: i32 = -10;
/// See [`LEAST_UNSCALED`].
pub const MOST_UNSCALED: i32 = 20;

/// Coordinates are taken for 0 if their magnitude is below two to this power, for an extent from one to two.
pub const DUST: i32 = -60;

/// Workgroups per row of a dispatch; larger dispatches wrap into `y` (Vulkan promises 65,535 per dimension).
pub const GROUPS_X: u32 = 32_768;
