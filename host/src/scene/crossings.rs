//! How often rays cross the mesh, and which points are inside of it.

use super::{
    Scene,
    batch::Batch,
    trace::{TraceTimes, Traced, traced},
};
use crate::{
    Error,
    clock::Instant,
    exec::{Buffer, Step, To},
    intersector,
    rays::{AnyPoint, AnyRay},
};
use raykd_kernels::trace::{crossings::UNDECIDED, queries};
use raykd_shared::{Crossings, Ray};
use rayon::prelude::*;
use std::time::Duration;

/// What was counted for every ray or point, and what that took: see [`Scene::crossings`] and [`Scene::winding`].
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Counted<T> {
    /// One a ray or point.
    pub counts: Vec<T>,
    /// What it took.
    pub times: TraceTimes,
    /// Rays that were none, or points with NaN, infinite or too large coordinates: they cross nothing.
    pub invalid: u64,
}

impl Scene {
    /// How often every ray crosses the mesh in its range of `t`, and from which sides. A ray through an edge or a
    /// vertex of a closed surface crosses it there once or not at all, never once for each triangle; one along a
    /// triangle's plane does not cross that triangle. Signs are exact, whatever the scene's triangle test is.
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
            self.count_local(&local, &mut counted)?;
        }
        Ok(counted)
    }

    /// How often the surface goes round each point: 0 outside of a closed mesh, 1 inside if triangles are
    /// counterclockwise seen from outside, -1 if clockwise, and larger numbers where it overlaps itself. Points on
    /// the surface count as if moved by `(e, e^2, e^3)`, see [`Scene::crossings`].
    ///
    /// Only of closed meshes ([`Edges::are_closed`](crate::mesh::Edges::are_closed)) is that a property of the point;
    /// of others it is what the ray to the nearest face of the scene's box crosses.
    ///
    /// ```
    /// use raykd::{BuildOptions, Device, Mesh, Scene};
    ///
    /// # fn main() -> Result<(), raykd::Error> {
    /// // A tetrahedron.
    /// let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// let mesh = Mesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
    /// let scene = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default())?;
    /// assert_eq!(scene.winding(&[[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]])?.counts, [1, 0]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The device failed.
    pub fn winding(&self, points: &[impl AnyPoint]) -> Result<Counted<i32>, Error> {
        let scale = 1.0 / self.header.scale;
        let (lo, hi) = (self.header.lo.map(|x| x * scale), self.header.hi.map(|x| x * scale));
        let mut counted = Counted::default();
        let mut windings = Vec::with_capacity(points.len());
        for part in points.chunks(self.batch_limit()) {
            let start = Instant::now();
            let ray = |point: &_| shortest(AnyPoint::local(point, self.translation), lo, hi);
            let rays: Vec<Ray> = self.device.install(|| part.par_iter().map(ray).collect());
            counted.times.upload += start.elapsed();
            // These are where the mesh is already.
            self.count_local(&rays, &mut counted)?;
            windings.extend(counted.counts.drain(..).map(Crossings::winding));
        }
        let Counted { times, invalid, .. } = counted;
        Ok(Counted { counts: windings, times, invalid })
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
        batch.run(&self.device, &[first], 0, vec![wanted])?;
        Ok(found.iter().filter(|found| found.leaving & UNDECIDED != 0).count())
    }

    /// Counts for rays that are where the mesh is, as many as fit the device.
    fn count_local(&self, rays: &[Ray], counted: &mut Counted<Crossings>) -> Result<(), Error> {
        let start = Instant::now();
        let batch = Batch::of_local(self, rays, 1)?;
        let crossings = self.device.alloc("crossings", 2 * rays.len() as u64)?;
        counted.times.upload += start.elapsed();
        let steps = self.counting(&batch, &crossings);
        let Traced { times, invalid, .. } = traced(Duration::ZERO, || {
            let wanted = crossings.back(To::End(&mut counted.counts, rays.len()));
            batch.run(&self.device, &steps, 0, vec![wanted])
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

/// The ray from a point along the axis on which it leaves the box soonest.
fn shortest(point: [f32; 3], lo: [f32; 3], hi: [f32; 3]) -> Ray {
    let (mut direction, mut best) = ([1.0, 0.0, 0.0], f32::INFINITY);
    for axis in 0..3 {
        for (side, distance) in [(-1.0, point[axis] - lo[axis]), (1.0, hi[axis] - point[axis])] {
            if distance < best {
                (direction, best) = ([0.0; 3], distance);
                direction[axis] = side;
            }
        }
    }
    // Of a point that is none the ray is none.
    Ray::new(point, direction)
}
