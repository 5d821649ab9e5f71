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
mod slices;
#[cfg(not(target_arch = "spirv"))]
pub use slices::lay_out;

/// A triangle as a leaf keeps it, 48 bytes: three corners of four words each. The first three are the coordinates,
/// times the scale of the tree's header. The fourth of the first corner is the triangle's number with bit 30 set, so
/// that it is no subnormal number; the other two are 0. [`lay_out`] makes them.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct LeafTriangle(pub [[f32; 4]; 3]);

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
