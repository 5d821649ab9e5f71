//! What some traversals and triangle tests need beside the tree.

use super::{Scene, build::lay_out};
use crate::{
    Error, Intersector,
    exec::{Buffer, Step},
    traversal::{Needs, Traversal},
};
use raykd_kernels::trace::prepare::{
    corners::transforms::TRANSFORMS, node_boxes::NODE_BOXES, parents::PARENTS, rope_links::ROPE_LINKS,
};

/// What some traversals and triangle tests need beside the tree.
#[derive(Clone, Debug, Default)]
pub(super) struct Extras {
    transforms: Option<Buffer>,
    parents: Option<Buffer>,
    boxes: Option<Buffer>,
    /// As they are, and optimised.
    ropes: [Option<Buffer>; 2],
}

impl Scene {
    /// Chooses how rays find their way through the tree from now on, except for [`Scene::all`]; the hits stay the
    /// same. Makes what the traversal needs beside the tree, once.
    ///
    /// # Errors
    /// It does not go with the scene's triangle test, see [`Intersector::check`]; what it needs does not fit the device, or
    /// the device failed.
    pub fn traverse_by(&mut self, traversal: Traversal) -> Result<(), Error> {
        self.intersector.check(traversal)?;
        let (device, header, nodes, count) =
            (&self.device, &self.header_buffer, &self.nodes, self.header.nodes);
        let needs = traversal.needs();
        if needs != Needs::Nothing {
            let extras = &mut self.extras;
            let parents = match extras.parents.take() {
                Some(parents) => parents,
                None => {
                    let parents = device.alloc("parents", u64::from(count / 2) * 4)?;
                    device.dispatch(&[Step::over(&PARENTS, count, vec![header, nodes, &parents])], false)?;
                    parents
                }
            };
            if needs == Needs::Boxes && extras.boxes.is_none() {
                let boxes = device.alloc("node boxes", u64::from(count) * 32)?;
                let buffers = vec![header, nodes, &parents, &boxes];
                device.dispatch(&[Step::over(&NODE_BOXES, count, buffers)], false)?;
                extras.boxes = Some(boxes);
            }
            if let Needs::Ropes { optimised } = needs
                && extras.ropes[usize::from(optimised)].is_none()
            {
                let job = device.alloc("job", 16)?;
                device.write(&job, 0, bytemuck::cast_slice(&[u32::from(optimised), 0, 0, 0]))?;
                let ropes = device.alloc("ropes", u64::from(count) * 48)?;
                let buffers = vec![&job, header, nodes, &parents, &ropes];
                device.dispatch(&[Step::over(&ROPE_LINKS, count, buffers)], false)?;
                extras.ropes[usize::from(optimised)] = Some(ropes);
            }
            extras.parents = Some(parents);
        }
        self.traversal = traversal;
        Ok(())
    }

    /// Chooses how it is told from now on whether a ray hits a triangle, by the closest and any hits of `stack` and `brute`.
    /// Makes what the test needs beside the tree, once. Only the default keeps what [`Scene::closest`] promises.
    ///
    /// # Errors
    /// It does not go with the scene's traversal, see [`Intersector::check`]; what it needs does not fit the device, or
    /// the device failed.
    pub fn intersect_by(&mut self, intersector: Intersector) -> Result<(), Error> {
        intersector.check(self.traversal)?;
        if intersector == Intersector::Baldwin && self.extras.transforms.is_none() {
            let (header, buffer, mesh) = (&self.header, &self.header_buffer, &self.mesh);
            let (transforms, _) = lay_out(&self.device, &TRANSFORMS, header, buffer, mesh, &self.refs)?;
            self.extras.transforms = Some(transforms);
        }
        self.intersector = intersector;
        Ok(())
    }

    /// Refuses what only the default triangle test does.
    pub(super) fn needs_default(&self, asked: &str) -> Result<(), Error> {
        match self.intersector {
            Intersector::Strict => Ok(()),
            other => Err(Error::Intersector { name: other.name(), asked: asked.to_owned() }),
        }
    }

    /// The triangles of the leaves as the scene's test wants them.
    pub(super) fn leaf_triangles(&self) -> &Buffer {
        let transforms = self.extras.transforms.as_ref().filter(|_| self.intersector == Intersector::Baldwin);
        transforms.unwrap_or(&self.corners)
    }

    /// Buffers that only the scene's traversal binds.
    pub(super) fn more(&self) -> Vec<&Buffer> {
        let extras = &self.extras;
        let [first, second] = match self.traversal.needs() {
            Needs::Nothing => [None, None],
            Needs::Boxes => [extras.boxes.as_ref(), None],
            Needs::Ropes { optimised } => {
                [extras.parents.as_ref(), extras.ropes[usize::from(optimised)].as_ref()]
            }
        };
        first.into_iter().chain(second).collect()
    }
}
