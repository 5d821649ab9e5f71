//! How often rays cross the mesh.

use super::{
    Scene,
    batch::Batch,
    trace::{TraceTimes, Traced, traced},
};
use crate::{
    Device, Error,
    clock::Instant,
    exec::{Buffer, Step, To},
    intersector,
    rays::AnyRay,
};
use raykd_kernels::trace::{queries, tally::UNDECIDED};
use raykd_shared::{Crossings, Ray};
use std::time::Duration;

/// What was counted for every ray or point, and what that took: see [`Scene::crossings`] and [`Scene::winding`].
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Counted<T> {
    /// One a ray or point, in their order.
    pub counts: Vec<T>,
    /// What it took.
    pub times: TraceTimes,
    /// Invalid rays, or points with NaN, infinite or too large coordinates: they cross nothing, and get zeros.
    pub invalid: u64,
}

impl Scene {
    /// How often every ray crosses the mesh in its range of `t`, and from which sides. A ray through an edge or a
    /// vertex of a closed surface crosses it there once or not at all, never once for each triangle; one along a
    /// triangle's plane does not cross that triangle. Signs are exact, whatever the scene's triangle test is. If a ray
    /// crosses many triangles in one place, which lie on one another, its time grows with the square of their number.
    ///
    /// The rule: the ray counts as if its origin were moved by `(e, e^2, e^3)` for an infinitely small positive `e`
    /// (Edelsbrunner & Mücke 1990, "Simulation of simplicity"). So an origin on the surface is on one side of it,
    /// always the same.
    ///
    /// # Errors
    /// The device failed.
    pub fn crossings(&self, rays: &[impl AnyRay]) -> Result<Counted<Crossings>, Error> {
        let mut counted = Counted::default();
        for part in rays.chunks(self.batch_limit()) {
            let start = Instant::now();
            let local = AnyRay::local(part, self.translation);
            counted.times.upload += start.elapsed();
            self.count_local(&self.device.for_rays(local.len()), &local, &mut counted)?;
        }
        Ok(counted)
    }

    /// For tests: of how many rays the first kernel leaves triangles to the second.
    ///
    /// # Errors
    /// The device failed, or more rays than a batch holds.
    #[doc(hidden)]
    pub fn undecided(&self, rays: &[Ray]) -> Result<usize, Error> {
        let batch = Batch::new(self, rays)?;
        let crossings = self.device.alloc("crossings", 2 * rays.len() as u64)?;
        let [first, _] = self.counting(&batch, &crossings);
        let mut found: Vec<Crossings> = Vec::new();
        let wanted = crossings.back(To::End(&mut found, rays.len()));
        batch.job.run(&self.device, &[first], 0, vec![wanted])?;
        Ok(found.iter().filter(|found| found.leaving & UNDECIDED != 0).count())
    }

    /// Counts for rays as the mesh's positions are, as many as fit the device.
    pub(super) fn count_local(
        &self,
        device: &Device,
        rays: &[Ray],
        counted: &mut Counted<Crossings>,
    ) -> Result<(), Error> {
        let start = Instant::now();
        let batch = Batch::of_local(device, rays, 1)?;
        let crossings = device.room("crossings", 2 * rays.len() as u64)?;
        counted.times.upload += start.elapsed();
        let steps = self.counting(&batch, &crossings);
        let Traced { times, invalid, .. } = traced(Duration::ZERO, || {
            let wanted = crossings.back(To::End(&mut counted.counts, rays.len()));
            batch.job.run(&self.device, &steps, 0, vec![wanted])
        })?;
        counted.times += times;
        counted.invalid += invalid;
        Ok(())
    }

    /// Both kernels over a batch.
    fn counting<'a>(&'a self, batch: &'a Batch, crossings: &'a Buffer<u32>) -> [Step<'a>; 2] {
        let query = || queries::Query { corners: &self.corners, ..batch.query(self) };
        let more = (batch.counts.out(), &batch.counts);
        intersector::crossings(query, || crossings.out(), more).map(|bound| bound.step(batch.lanes()))
    }
}
