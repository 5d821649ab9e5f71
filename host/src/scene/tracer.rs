//! One ray at a time, on the CPU.

use super::Scene;
use crate::{Error, Intersector, exec::cpu::Kept, rays::AnyRay};
use raykd_kernels::trace::single::Tree;
use raykd_shared::{Crossings, Hit, Ray, TreeHeader};
use std::{ops::ControlFlow, sync::Arc};

/// Traces single rays on the CPU, without allocation, threads or system calls. The hits are the same bytes as a
/// [`Scene`]'s. Clones share all memory, and may be used by any number of threads.
///
/// ```
/// use raykd::{BuildOptions, Device, Mesh, Ray, Scene};
///
/// # fn main() -> Result<(), raykd::Error> {
/// let scene = Scene::build(&Device::cpu(), &Mesh::teapot(4), &BuildOptions::default())?;
/// let tracer = scene.tracer()?;
/// let ray = Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0]);
/// assert_eq!(tracer.closest(&ray), Some(scene.closest(&[ray])?[0]));
/// assert_eq!(tracer.closest(&Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, 1.0])), None);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Tracer {
    shared: Arc<Shared>,
    intersector: Intersector,
}

#[derive(Debug)]
struct Shared {
    header: TreeHeader,
    nodes: Kept,
    corners: Kept,
    /// What the leaves keep instead for the scene's triangle test.
    transforms: Option<Kept>,
    translation: [f64; 3],
}

impl Scene {
    /// Makes the scene ready for single rays on the CPU, by its triangle test. A scene on a GPU is copied from there,
    /// one on the CPU is not.
    ///
    /// # Errors
    /// The device failed, or memory ran out.
    pub fn tracer(&self) -> Result<Tracer, Error> {
        let shared = Shared {
            header: self.header,
            nodes: self.device.kept(&self.nodes)?,
            corners: self.device.kept(&self.corners)?,
            transforms: self.own_transforms().map(|own| self.device.kept(own)).transpose()?,
            translation: self.translation,
        };
        Ok(Tracer { shared: Arc::new(shared), intersector: self.intersector })
    }
}

impl Tracer {
    /// The closest hit, if there is one; of several, that of the triangle with the lowest number.
    pub fn closest(&self, ray: &impl AnyRay) -> Option<Hit> {
        self.find(&self.local(ray), false)
    }

    /// Some hit, if there is one.
    pub fn any(&self, ray: &impl AnyRay) -> Option<Hit> {
        self.find(&self.local(ray), true)
    }

    /// Calls `each` with all hits, by rising (`t`, triangle), until it breaks; returns what it broke with. If the ray
    /// hits many triangles in one place, which lie on one another, its time grows with the square of their number.
    ///
    /// # Errors
    /// The scene's triangle test was neither the default nor `exact`. Then `each` is not called.
    pub fn for_each_hit<B>(
        &self,
        ray: &impl AnyRay,
        mut each: impl FnMut(Hit) -> ControlFlow<B>,
    ) -> Result<ControlFlow<B>, Error> {
        let mut broken = ControlFlow::Continue(());
        self.find_all(&self.local(ray), &mut |hit| {
            broken = each(hit);
            broken.is_continue()
        })?;
        Ok(broken)
    }

    /// How often the ray crosses the mesh in its range, as [`Scene::crossings`] counts.
    pub fn crossings(&self, ray: &impl AnyRay) -> Crossings {
        self.count_crossings(&self.local(ray))
    }

    fn local(&self, ray: &impl AnyRay) -> Ray {
        ray.alone(self.shared.translation)
    }

    // These are not generic, so that they are compiled here, and not in a user's crate, which may be less optimised.

    fn find(&self, ray: &Ray, any: bool) -> Option<Hit> {
        self.intersector.single(&self.tree(), ray, any)
    }

    /// Calls `each` with all hits until it says no.
    fn find_all(&self, ray: &Ray, each: &mut dyn FnMut(Hit) -> bool) -> Result<(), Error> {
        self.intersector.single_all(&self.tree(), ray, each)
    }

    fn count_crossings(&self, ray: &Ray) -> Crossings {
        self.tree_of(&self.shared.corners).crossings(ray)
    }

    fn tree(&self) -> Tree<'_> {
        self.tree_of(self.shared.transforms.as_ref().unwrap_or(&self.shared.corners))
    }

    fn tree_of<'a>(&'a self, leaves: &'a Kept) -> Tree<'a> {
        let Shared { header, nodes, .. } = &*self.shared;
        Tree::of_parts(header, nodes.slice(), leaves.slice()).expect("a scene's nodes are pairs")
    }
}
