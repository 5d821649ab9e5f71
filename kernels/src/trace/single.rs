//! One ray at a time: what the kernels of queries do, without buffers of theirs, for any Rust program on a CPU and for
//! shaders of one's own by rust-gpu. Nothing takes memory, and the answers are the same bytes.

use super::{
    frame::Frame,
    intersect::{Best, Intersector, strict::Strict},
    job::record,
    traverse::{
        Steps,
        leaf::Every,
        stack::{ASIDE, walk},
    },
};
use crate::{
    glam::{UVec4, Vec4},
    mem::view,
};
use raykd_shared::{Hit, Ray, TreeHeader};
#[cfg(not(target_arch = "spirv"))]
use {
    super::{
        crossings::crossings,
        prepare::corners::kept,
        traverse::next::{self, AT_ONCE, After, Next, next_hits},
    },
    crate::glam::Vec3,
    core::ops::ControlFlow,
    raykd_shared::{Crossings, MISS, Node, TreeView},
};

/// A triangle as a leaf keeps it, 48 bytes: three corners of four words each. The first three are the coordinates,
/// times the scale of the tree's header. The fourth of the first corner is the triangle's number with bit 30 set, so
/// that it is no subnormal number; the other two are 0. [`lay_out`] makes them.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct LeafTriangle(pub [[f32; 4]; 3]);

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
/// Returns nothing if a triangle or vertex is not there, or `leaves` has another length than the tree's references.
#[cfg(not(target_arch = "spirv"))]
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
///
/// A shader makes it of storage buffers, see [`Tree::of_buffers`]; what it does with it then runs on a CPU too.
#[derive(Clone, Copy, Debug)]
pub struct Tree<'a> {
    header: &'a TreeHeader,
    pairs: &'a [UVec4],
    corners: &'a [Vec4],
}

/// What became of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Answer {
    /// The hit, or [`Hit::NONE`].
    pub hit: Hit,
    /// Whether all was looked at that had to be. False only on a GPU, if its driver leaves loops early, and the hit is
    /// not to be used then. llvmpipe does so once an invocation has gone 65,535 rounds in all its loops.
    pub whole: bool,
}

#[cfg(not(target_arch = "spirv"))]
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
            next_hits::<I>(&mut frame, (&pairs, &corners), after, aside, own, steps);
            let count = Next::count(own);
            for i in 0..count {
                let best = Next::hit(own, i);
                each(hit(&frame, &best))?;
                after.pass(&mut frame, &best);
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

impl<'a> Tree<'a> {
    /// Of storage buffers as a shader binds them: header, nodes and leaf triangles, the two latter in words of 16
    /// bytes. A host gets them from `Scene::buffers` of the crate `raykd`, as `header`, `nodes` and `corners`.
    ///
    /// The tree must be valid: a GPU checks nothing, and may go on for ever.
    #[inline(always)]
    pub fn of_buffers(header: &'a TreeHeader, nodes: &'a [UVec4], corners: &'a [Vec4]) -> Self {
        Self { header, pairs: nodes, corners }
    }

    /// The closest hit; of several, that of the triangle with the lowest number. [`Tree::answer`] is
    /// for drivers that leave loops early.
    #[inline]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.find::<Strict>(ray, false)
    }

    /// Some hit, if there is one. [`Tree::answer`] is for drivers that leave loops early.
    #[inline]
    pub fn any(&self, ray: &Ray) -> Option<Hit> {
        self.find::<Strict>(ray, true)
    }

    /// The closest hit, or if `any` will do some hit, by a triangle test, for which the triangles were laid out.
    #[inline]
    pub fn find<I: Intersector>(&self, ray: &Ray, any: bool) -> Option<Hit> {
        let hit = self.answer_by::<I>(ray, any).hit;
        if hit.is_hit() { Some(hit) } else { None }
    }

    /// What [`Tree::closest`] finds, or [`Tree::any`], and whether the driver let it finish.
    #[inline]
    pub fn answer(&self, ray: &Ray, any: bool) -> Answer {
        self.answer_by::<Strict>(ray, any)
    }

    #[inline(always)]
    fn answer_by<I: Intersector>(&self, ray: &Ray, any: bool) -> Answer {
        let mut frame = Frame::of(ray, self.header);
        let mut steps = Steps::default();
        let best = self.walk::<I>(&mut frame, any, &mut steps);
        Answer { hit: hit(&frame, &best), whole: steps.status == 0 }
    }

    #[inline(always)]
    fn walk<I: Intersector>(&self, ray: &mut Frame, any: bool, steps: &mut Steps) -> Best {
        // No valid tree is deeper than the stack.
        let (pairs, corners) = (view(self.pairs), view(self.corners));
        walk::<I, Every, false>(ray, &pairs, &corners, Every, any, &mut [0; ASIDE], steps)
    }
}

#[inline(always)]
fn hit(ray: &Frame, best: &Best) -> Hit {
    let words = record(ray, best);
    Hit {
        triangle: words.x,
        t: f32::from_bits(words.y),
        u: f32::from_bits(words.z),
        v: f32::from_bits(words.w),
    }
}
