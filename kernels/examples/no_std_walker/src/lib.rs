//! Traces rays through a tree that `raykd build MESH -o FILE` saved, without the standard library, and without memory
//! but what the caller lends: for a controller, or the kernel of a system.
#![no_std]
#![forbid(unsafe_code)]

use raykd_kernels::trace::single::{LeafTriangle, Tree, lay_out};
use raykd_shared::{Hit, LAYOUT_VERSION, Ray, TreeHeader, TreeView};

/// The tree in a file's words, as they lie in memory or flash: magic, version, header, nodes, references and a SHA-256,
/// which is for files on their way.
pub fn tree(words: &[u32]) -> Option<TreeView<'_>> {
    let (magic, rest) = words.split_first_chunk::<2>()?;
    let (version, rest) = rest.split_first()?;
    if bytemuck::bytes_of(magic) != b"raykd-kd" || *version != LAYOUT_VERSION {
        return None;
    }
    let (header, rest) = rest.split_first_chunk::<{ size_of::<TreeHeader>() / 4 }>()?;
    let header: &TreeHeader = bytemuck::cast_ref(header);
    let (nodes, rest) = rest.split_at_checked(2 * header.nodes as usize)?;
    let (refs, _) = rest.split_at_checked(header.refs as usize)?;
    Some(TreeView { header, nodes: bytemuck::cast_slice(nodes), refs })
}

/// Memory that a walk needs.
#[derive(Debug)]
pub struct Lent<'a> {
    /// As many as the tree has references.
    pub leaves: &'a mut [LeafTriangle],
    /// [`TreeView::scratch_words`] at least.
    pub scratch: &'a mut [u32],
}

/// Writes the closest hit of each ray. Nothing comes back if the tree is damaged or not this mesh's, or memory is
/// short.
pub fn trace(
    tree: TreeView<'_>,
    (positions, triangles): (&[[f32; 3]], &[[u32; 3]]),
    lent: Lent<'_>,
    rays: &[Ray],
    hits: &mut [Hit],
) -> Option<()> {
    let scratch = lent.scratch.get_mut(..tree.scratch_words())?;
    // From here on no index leads outside, and every walk ends.
    tree.validate_in(scratch).ok()?;
    lay_out(tree, positions, triangles, lent.leaves)?;
    let tree = Tree::new(tree, lent.leaves)?;
    for (hit, ray) in hits.iter_mut().zip(rays) {
        *hit = tree.closest(ray).unwrap_or(Hit::NONE);
    }
    Some(())
}
