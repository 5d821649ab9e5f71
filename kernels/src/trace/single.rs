//! One ray at a time on a CPU: what the kernels of queries do, without buffers of theirs, for any Rust program. Nothing
//! takes memory, and the answers are the same bytes.

use super::{
    frame::Frame,
    intersect::{Best, Intersector, strict::Strict},
    job::record,
    prepare::corners::kept,
    queries::crossed,
    traverse::{
        Steps,
        leaf::{After, Choice, Every},
        stack::{ASIDE, walk},
    },
};
use crate::{
    glam::{UVec4, Vec3, Vec4},
    mem::View,
};
use core::ops::ControlFlow;
use raykd_shared::{Crossings, Hit, MISS, Node, Ray, TreeHeader, TreeView};

/// A triangle as a leaf keeps it: see [`lay_out`].
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct LeafTriangle(pub [[f32; 4]; 3]);

/// Lays out the triangles that the leaves of a tree list, one a reference, of a mesh whose positions are in its own units:
/// what [`Tree::new`] wants.
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
/// let hit = tree.closest(&Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -1.0])).expect("a hit");
/// assert_eq!((hit.triangle, hit.t), (0, 1.0));
/// ```
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

/// A tree and the triangles of its leaves, to trace single rays through.
#[derive(Clone, Copy, Debug)]
pub struct Tree<'a> {
    header: &'a TreeHeader,
    pairs: &'a [UVec4],
    corners: &'a [Vec4],
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

    /// The closest hit; of several, that of the triangle with the lowest number.
    #[inline]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.find::<Strict>(ray, false)
    }

    /// Some hit, if there is one.
    #[inline]
    pub fn any(&self, ray: &Ray) -> Option<Hit> {
        self.find::<Strict>(ray, true)
    }

    /// The closest hit, or if `any` will do some hit, by a triangle test, for which the triangles were laid out.
    #[inline]
    pub fn find<I: Intersector>(&self, ray: &Ray, any: bool) -> Option<Hit> {
        let mut frame = self.frame::<I>(ray);
        let best = self.walk::<I, Every>(&mut frame, Every, any);
        hit(&frame, &best)
    }

    /// Calls `each` with all hits, by rising (`t`, triangle), until it breaks.
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
        let mut frame = self.frame::<I>(ray);
        let mut after = After::NOTHING;
        loop {
            let best = self.walk::<I, After>(&mut frame, after, false);
            let Some(hit) = hit(&frame, &best) else { return ControlFlow::Continue(()) };
            each(hit)?;
            after.pass(&mut frame, (best.t, best.triangle));
        }
    }

    /// How often the ray crosses the surface in its range, see [`Crossings`].
    #[inline]
    pub fn crossings(&self, ray: &Ray) -> Crossings {
        let (pairs, corners) = (View::new(self.pairs), View::new(self.corners));
        let found = crossed(&Frame::of(ray, self.header), &pairs, &corners, &mut Steps::default());
        Crossings { leaving: found.leaving, entering: found.entering }
    }

    #[inline(always)]
    fn frame<I: Intersector>(&self, ray: &Ray) -> Frame {
        let frame = Frame::of(ray, self.header);
        if I::WHOLE { frame.whole() } else { frame }
    }

    #[inline(always)]
    fn walk<I: Intersector, C: Choice>(&self, ray: &mut Frame, choice: C, any: bool) -> Best {
        // No valid tree is deeper than the stack, and no loop is cut short on a CPU.
        let (pairs, corners) = (View::new(self.pairs), View::new(self.corners));
        walk::<I, C, false>(ray, &pairs, &corners, choice, any, &mut [0; ASIDE], &mut Steps::default())
    }
}

#[inline(always)]
fn hit(ray: &Frame, best: &Best) -> Option<Hit> {
    let words = record(ray, best);
    let [t, u, v] = [words.y, words.z, words.w].map(f32::from_bits);
    (words.x != MISS).then_some(Hit { triangle: words.x, t, u, v })
}
