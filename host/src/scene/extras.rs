//! What some traversals and triangle tests need beside the tree.

use super::Scene;
use crate::{
    Error, Intersector,
    exec::{Buffer, Launch},
    traversal::{Needs, Traversal},
};
use raykd_kernels::{
    glam::{UVec4, Vec4},
    trace::prepare::{corners::transforms, node_boxes, parents, rope_links},
};

/// What some traversals and triangle tests need beside the tree.
#[derive(Clone, Debug, Default)]
pub(super) struct Extras {
    transforms: Option<Buffer<Vec4>>,
    parents: Option<Buffer<u32>>,
    boxes: Option<Buffer<UVec4>>,
    /// As they are, and optimised.
    ropes: [Option<Buffer<UVec4>>; 2],
}

impl Scene {
    /// Chooses how rays find their way through the tree from now on, except for [`Scene::all`]; the hits stay the
    /// same. Makes what the traversal needs beside the tree, once.
    ///
    /// # Errors
    /// It does not go with the scene's triangle test, see [`Intersector::check`]; what it needs does not fit
    /// the device, or the device failed.
    pub fn traverse_by(&mut self, traversal: Traversal) -> Result<(), Error> {
        self.intersector.check(traversal)?;
        let (device, header, pairs, count) =
            (&self.device, &self.header_buffer, &self.nodes, self.header.nodes);
        let needs = traversal.needs();
        if needs != Needs::Nothing {
            let extras = &mut self.extras;
            let parents = match extras.parents.take() {
                Some(parents) => parents,
                None => {
                    let made = device.alloc("parents", u64::from(count / 2))?;
                    let parents = parents::Buffers { header, pairs, parents: made.out() };
                    device.dispatch(&[parents.over(count)], false)?;
                    made
                }
            };
            if needs == Needs::Boxes && extras.boxes.is_none() {
                let made = device.alloc("node boxes", 2 * u64::from(count))?;
                let boxes = node_boxes::Buffers { header, pairs, parents: &parents, boxes: made.out() };
                device.dispatch(&[boxes.over(count)], false)?;
                extras.boxes = Some(made);
            }
            if let Needs::Ropes { optimised } = needs
                && extras.ropes[usize::from(optimised)].is_none()
            {
                let job = &device.upload("job", &[u32::from(optimised), 0, 0, 0])?;
                let made = device.alloc("ropes", 3 * u64::from(count))?;
                let ropes = rope_links::Buffers { job, header, pairs, parents: &parents, links: made.out() };
                device.dispatch(&[ropes.over(count)], false)?;
                extras.ropes[usize::from(optimised)] = Some(made);
            }
            extras.parents = Some(parents);
        }
        self.traversal = traversal;
        Ok(())
    }

    /// Chooses how it is told from now on whether a ray hits a triangle, by the closest and any hits of
    /// `stack` and `brute`. Makes what the test needs beside the tree, once. Only the default keeps what
    /// [`Scene::closest`] promises.
    ///
    /// # Errors
    /// It does not go with the scene's traversal, see [`Intersector::check`]; what it needs does not fit the device, or
    /// the device failed.
    pub fn intersect_by(&mut self, intersector: Intersector) -> Result<(), Error> {
        intersector.check(self.traversal)?;
        if intersector == Intersector::Baldwin && self.extras.transforms.is_none() {
            let made = self.device.alloc("transforms", 3 * u64::from(self.header.refs))?;
            let transforms = transforms::Buffers {
                header: &self.header_buffer,
                positions: &self.mesh.positions,
                indices: &self.mesh.indices,
                refs: &self.refs,
                corners: made.out(),
            };
            self.device.dispatch(&[transforms.over(self.header.refs)], false)?;
            self.extras.transforms = Some(made);
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
    pub(super) fn leaf_triangles(&self) -> &Buffer<Vec4> {
        let transforms = self.extras.transforms.as_ref().filter(|_| self.intersector == Intersector::Baldwin);
        transforms.unwrap_or(&self.corners)
    }

    /// Parents of nodes, which [`Self::traverse_by`] made.
    pub(super) fn parents(&self) -> &Buffer<u32> {
        self.extras.parents.as_ref().expect("the traversal needs them")
    }

    /// Boxes of nodes, which it made.
    pub(super) fn boxes(&self) -> &Buffer<UVec4> {
        self.extras.boxes.as_ref().expect("the traversal needs them")
    }

    /// Ropes, which it made.
    pub(super) fn ropes(&self, optimised: bool) -> &Buffer<UVec4> {
        self.extras.ropes[usize::from(optimised)].as_ref().expect("the traversal needs them")
    }

    /// Bytes of what only the scene's traversal binds.
    pub(super) fn more_bytes(&self) -> u64 {
        match self.traversal.needs() {
            Needs::Nothing => 0,
            Needs::Boxes => self.boxes().bytes(),
            Needs::Ropes { optimised } => self.parents().bytes() + self.ropes(optimised).bytes(),
        }
    }
}
