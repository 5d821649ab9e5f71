//! What a triangle test that keeps the contract says of every triangle, one by one, without a tree and without a
//! kernel.

use raykd::{
    Hit, Intersector, Mesh, Ray,
    internals::kernels::{
        glam::Vec3,
        math::{div, ldexp},
        trace::{
            frame::Frame,
            intersect::{Best, Intersector as Test, exact::Exact, strict::Strict},
        },
    },
    shared::TreeHeader,
};
use std::borrow::Cow;

/// A mesh to be asked.
#[derive(Debug)]
pub struct OneByOne<'a> {
    mesh: &'a Mesh,
    header: TreeHeader,
    positions: Cow<'a, [f32]>,
    exact: bool,
}

impl<'a> OneByOne<'a> {
    /// Of a mesh and the header of any of its trees.
    pub fn new(mesh: &'a Mesh, header: &TreeHeader) -> Self {
        Self { mesh, header: *header, positions: mesh.scaled_positions(), exact: false }
    }

    /// By this test, which is `exact` or the default.
    #[must_use]
    pub fn by(self, test: Intersector) -> Self {
        assert!(test.keeps_contract());
        Self { exact: test == Intersector::Exact, ..self }
    }

    fn frame(&self, ray: &Ray) -> Frame {
        let frame = Frame::of(ray, &self.header);
        if self.exact { frame.whole() } else { frame }
    }

    /// A ray's hit with one triangle, if it has one, and the scaled `t` that hits are ordered by.
    fn test(&self, frame: &Frame, triangle: u32) -> Option<(f32, Hit)> {
        let corners = self.mesh.triangles()[triangle as usize];
        let [a, b, c] = corners.map(|v| Vec3::from_slice(&self.positions[3 * v as usize..]));
        let mut best = Best::NOTHING;
        if self.exact {
            Exact.test_unseen(frame, triangle, Exact::lay_out(a, b, c), &mut best);
        } else {
            Strict.test_unseen(frame, triangle, Strict::lay_out(a, b, c), &mut best);
        }
        (frame.valid && best.triangle == triangle).then(|| {
            // A zero has no sign in hits.
            let t = ldexp(best.t, -frame.stretch) + 0.0;
            let (u, v) = (div(best.u, best.det) + 0.0, div(best.v, best.det) + 0.0);
            (best.t + 0.0, Hit { triangle, t, u, v })
        })
    }

    /// A ray's hit with one triangle, if it has one.
    pub fn alone(&self, ray: &Ray, triangle: u32) -> Option<Hit> {
        Some(self.test(&self.frame(ray), triangle)?.1)
    }

    /// All hits of a ray, in order.
    pub fn all(&self, ray: &Ray) -> Vec<Hit> {
        let frame = self.frame(ray);
        let mut hits: Vec<_> =
            self.mesh.kept().iter().filter_map(|&triangle| self.test(&frame, triangle)).collect();
        hits.sort_by(|(a, x), (b, y)| a.total_cmp(b).then(x.triangle.cmp(&y.triangle)));
        hits.into_iter().map(|(_, hit)| hit).collect()
    }
}
