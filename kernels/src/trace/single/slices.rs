//! Trees of slices, and what a CPU asks of one ray that a shader does not.

use super::{LeafTriangle, Tree, hit};
use crate::{
    glam::{UVec4, Vec3, Vec4},
    mem::view,
    trace::{
        crossings::crossings,
        frame::Frame,
        intersect::{Intersector, strict::Strict},
        prepare::corners::kept,
        traverse::{
            Steps,
            next::{self, AT_ONCE, After, Next, next_hits},
            stack::ASIDE,
        },
    },
};
use core::ops::ControlFlow;
use raykd_shared::{Crossings, Hit, MISS, Node, Ray, TreeHeader, TreeView};

/// Lays out the triangles that the leaves of a tree list, one a reference, of a mesh whose positions are in its own
/// units: what [`Tree::new`] wants.
///
/// ```
/// use raykd_kernels::trace::single::{LeafTriangle, Tree, lay_out};
/// use raykd_shared::{Node, Ray, TreeHeader, TreeView};
///
/// // One triangle, and a tree that is one leaf.
/// let (positions, triangles) = ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0, 1, 2]]);
/// let (nodes, refs) = ([Node::leaf(0, 1), Node::PADDING], [0]);
/// let header = TreeHeader {
///     hi: [1.0, 1.0, 0.0],
///     nodes: 2,
///     refs: 1,
///     triangles: 1,
///     scale: 1.0,
///     ..bytemuck::Zeroable::zeroed()
/// };
/// let view = TreeView { header: &header, nodes: &nodes, refs: &refs };
///
/// let mut leaves = [LeafTriangle::default()];
/// lay_out(view, &positions, &triangles, &mut leaves).expect("numbers in range");
/// let tree = Tree::new(view, &leaves).expect("as many triangles as references");
/// let ray = Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -1.0]);
/// let hit = tree.closest(&ray).expect("a hit");
/// assert_eq!((hit.triangle, hit.t), (0, 1.0));
///
/// // The same, made of words as a shader has them.
/// let tree = Tree::of_buffers(&header, bytemuck::cast_slice(&nodes), bytemuck::cast_slice(&leaves));
/// assert_eq!(tree.any(&ray), Some(hit));
/// assert!(tree.answer(&ray, false).whole);
/// ```
///
/// Coordinates below 2^-60 of the mesh's largest extent, rounded down to a power of two, must be 0 already: a scene
/// takes them for that.
///
/// Returns nothing if a triangle or vertex is not there, or `leaves` has another length than the tree's references.
pub fn lay_out(
    tree: TreeView<'_>,
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    leaves: &mut [LeafTriangle],
) -> Option<()> {
    if leaves.len() != tree.refs.len() {
        return None;
    }
    for (&id, leaf) in tree.refs.iter().zip(leaves) {
        let [a, b, c] = triangles.get(id as usize)?.map(|vertex| {
            positions.get(vertex as usize).map(|&position| Vec3::from(position) * tree.header.scale)
        });
        let (a, b, c) = kept::<Strict>(id, (a?, b?, c?));
        leaf.0 = [a.to_array(), b.to_array(), c.to_array()];
    }
    Some(())
}

impl<'a> Tree<'a> {
    /// Nothing if there are not as many triangles as references, or the nodes are not pairs. A tree that is not valid
    /// ([`TreeView::validate_in`]) may have rays panic, or go on for ever.
    #[inline]
    pub fn new(tree: TreeView<'a>, leaves: &'a [LeafTriangle]) -> Option<Self> {
        Self::of_parts(tree.header, tree.nodes, leaves).filter(|_| leaves.len() == tree.refs.len())
    }

    /// The same without the references, which no ray reads.
    #[inline]
    pub fn of_parts(header: &'a TreeHeader, nodes: &'a [Node], leaves: &'a [LeafTriangle]) -> Option<Self> {
        let pairs: &[UVec4] = bytemuck::try_cast_slice(nodes).ok()?;
        let corners: &[Vec4] = bytemuck::cast_slice(leaves);
        (!pairs.is_empty()).then_some(Self { header, pairs, corners })
    }

    /// Calls `each` with all hits, by rising (`t`, triangle), until it breaks. A walk finds the first hit, each further
    /// one up to eight more. On a CPU only.
    #[inline]
    pub fn for_each_hit<B>(&self, ray: &Ray, each: impl FnMut(Hit) -> ControlFlow<B>) -> ControlFlow<B> {
        self.for_each::<Strict, B>(ray, each)
    }

    /// The same by a triangle test, for which the triangles were laid out.
    #[inline]
    pub fn for_each<I: Intersector, B>(
        &self,
        ray: &Ray,
        mut each: impl FnMut(Hit) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let mut frame = Frame::of(ray, self.header);
        let mut after = After::NOTHING;
        let first = self.walk::<I>(&mut frame, false, &mut Steps::default());
        if first.triangle == MISS {
            return ControlFlow::Continue(());
        }
        each(hit(&frame, &first))?;
        after.pass(&mut frame, &first);
        let (pairs, corners) = (view(self.pairs), view(self.corners));
        let (aside, own, steps) = (&mut [0; ASIDE], &mut [0; next::WORDS], &mut Steps::default());
        loop {
            let count = next_hits::<I>(&mut frame, (&pairs, &corners), &mut after, aside, own, steps);
            for i in 0..count {
                each(hit(&frame, &Next::hit(own, i)))?;
            }
            if count < AT_ONCE {
                return ControlFlow::Continue(());
            }
        }
    }

    /// How often the ray crosses the surface in its range, see [`Crossings`]. On a CPU only.
    #[inline]
    pub fn crossings(&self, ray: &Ray) -> Crossings {
        let (pairs, corners) = (view(self.pairs), view(self.corners));
        let mut frame = Frame::of(ray, self.header);
        crossings(&mut frame, (&pairs, &corners))
    }
}
