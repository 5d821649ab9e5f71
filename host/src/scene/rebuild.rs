//! Scenes of meshes that change, in memory that is used again.

use super::Scene;
use crate::{BuildOptions, Device, Error, Mesh};

/// Memory is used again: the second rebuild takes the last there is to take, as long as the mesh does not
/// grow by more than an eighth; see [`Device::recycling`]. The tree is built anew, to the same bytes as ever. Clones
/// stay what they are, and may be traced while this goes on, by other threads too: so a program that shows the old
/// mesh meanwhile keeps one. Traversal and triangle test stay as they were chosen. If it fails, the scene stays as it
/// was.
///
/// ```
/// use raykd::{BuildOptions, Device, Mesh, Ray, Scene};
///
/// # fn main() -> Result<(), raykd::Error> {
/// let mut scene = Scene::build(&Device::best(), &Mesh::teapot(4), &BuildOptions::default())?;
/// let ray = [Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0])];
/// let old = scene.clone();
/// scene.rebuild(&Mesh::teapot(5), &BuildOptions::default())?;
/// assert_ne!(scene.closest(&ray)?, old.closest(&ray)?);
/// # Ok(())
/// # }
/// ```
impl Scene {
    /// Becomes the scene of another mesh, or of the same one with other vertices.
    ///
    /// # Errors
    /// As for [`Scene::build`].
    pub fn rebuild(&mut self, mesh: &Mesh, options: &BuildOptions) -> Result<(), Error> {
        self.become_of(|device| Self::build(device, mesh, options))
    }

    /// Becomes the scene of a mesh that lies in buffers of a wgpu program, as [`Scene::build_on`] builds it.
    ///
    /// ```no_run
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let (mut scene, options): (raykd::Scene, raykd::BuildOptions) = todo!();
    /// # let [positions, indices, rays, hits]: [raykd::wgpu::Buffer; 4] = todo!();
    /// # let (queue, mut encoder): (raykd::wgpu::Queue, raykd::wgpu::CommandEncoder) = todo!();
    /// // Once a frame, after a shader has moved the vertices.
    /// scene.rebuild_on(positions.slice(..), indices.slice(..), &options)?;
    /// scene.encode(&mut encoder, raykd::Query::Closest, rays.slice(..), hits.slice(..), 1000)?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As for [`Scene::build_on`].
    #[cfg(feature = "gpu")]
    pub fn rebuild_on(
        &mut self,
        positions: wgpu::BufferSlice<'_>,
        indices: wgpu::BufferSlice<'_>,
        options: &BuildOptions,
    ) -> Result<(), Error> {
        self.become_of(|device| Self::build_on(device, positions, indices, options))
    }

    fn become_of(&mut self, build: impl FnOnce(&Device) -> Result<Self, Error>) -> Result<(), Error> {
        if !self.device.recycles() {
            self.device = self.device.recycling();
        }
        let mut built = build(&self.device)?;
        built.traverse_by(self.traversal)?;
        built.intersect_by(self.intersector)?;
        *self = built;
        Ok(())
    }
}
