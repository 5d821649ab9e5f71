//! Choosing how rays are traced, and making what that needs beside the tree.

use super::Scene;
use crate::{
    Error, Intersector, Traversal,
    exec::{Buffer, Launch},
};
use raykd_kernels::{
    glam::{UVec4, Vec4},
    trace::prepare::corners::transforms,
};

impl Scene {
    /// Chooses how rays find their way through the tree from now on, for closest and any hits and for [`Scene::steps`];
    /// closest hits stay the same. Other queries use the full stack, and `Scene::encode` refuses traversals but that
    /// and [`Traversal::Wide`]. Makes what the traversal needs beside the tree, once.
    ///
    /// # Errors
    /// It does not go with the scene's triangle test, see [`Intersector::goes_with`]; what it needs does not fit
    /// the device or memory, or the device failed.
    pub fn traverse_by(&mut self, traversal: Traversal) -> Result<(), Error> {
        self.intersector.goes_with(traversal)?;
        let tree = (&self.header_buffer, &self.nodes, self.header.nodes);
        let mut extras = self.extras.clone();
        let needed = extras.make(traversal, &self.device, tree, (&self.mesh, &self.kept, &self.header))?;
        self.times.prepare += needed;
        self.extras = extras;
        self.traversal = traversal;
        Ok(())
    }

    /// The nodes and the triangles that rays go through by a traversal.
    pub(super) fn way(&self, traversal: Traversal) -> (&Buffer<UVec4>, &Buffer<Vec4>) {
        match self.extras.wide(traversal) {
            Some(wide) => (&wide.nodes, &wide.corners),
            None => (&self.nodes, self.leaf_triangles()),
        }
    }

    /// Chooses how it is told from now on whether a ray hits a triangle. Makes what the test needs beside the tree,
    /// once. The default and `exact` answer all queries and keep what they promise; the others answer closest and any
    /// hits.
    ///
    /// # Errors
    /// It does not go with the scene's traversal, see [`Intersector::goes_with`]; what it needs does not fit the
    /// device, or the device failed.
    pub fn intersect_by(&mut self, intersector: Intersector) -> Result<(), Error> {
        intersector.goes_with(self.traversal)?;
        if intersector == Intersector::Baldwin && self.transforms.is_none() {
            let made = self.device.room("transforms", 3 * u64::from(self.header.refs))?;
            let transforms = transforms::Buffers {
                header: &self.header_buffer,
                positions: &self.mesh.positions,
                indices: &self.mesh.indices,
                refs: &self.refs,
                corners: made.out(),
            };
            self.device.dispatch(&[transforms.over(self.header.refs)], false)?;
            self.transforms = Some(made);
        }
        #[cfg(feature = "gpu")]
        if intersector.narrows() {
            // Probes a GPU now, not when rays wait.
            self.device.by_doubles();
        }
        self.intersector = intersector;
        Ok(())
    }

    /// What leaves keep instead of corners for the scene's triangle test.
    pub(super) fn own_transforms(&self) -> Option<&Buffer<Vec4>> {
        self.transforms.as_ref().filter(|_| self.intersector == Intersector::Baldwin)
    }

    /// The triangles of the leaves as the scene's test wants them.
    pub(super) fn leaf_triangles(&self) -> &Buffer<Vec4> {
        self.own_transforms().unwrap_or(&self.corners)
    }
}
