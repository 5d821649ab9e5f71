//! How often rays cross the mesh, and which points are inside of it.

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
    rays::{AnyPoint, AnyRay},
};
use raykd_kernels::{
    glam::Vec4,
    trace::{queries, tally::UNDECIDED},
};
use raykd_shared::{Crossings, Ray};
use rayon::prelude::*;
use std::{ops::Range, time::Duration};

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
            self.count_local(&self.device.keeping_nothing(), &local, &mut counted)?;
        }
        Ok(counted)
    }

    /// How often the surface goes round each point: 0 outside of a closed mesh, 1 inside if triangles are
    /// counterclockwise seen from outside, -1 if clockwise, and larger numbers where it overlaps itself. Points on
    /// the surface count as if moved by `(e, e^2, e^3)`, see [`Scene::crossings`].
    ///
    /// Only of closed meshes ([`Edges::are_closed`](crate::mesh::Edges::are_closed)) is that a property of the point;
    /// of others it is what a ray crosses that goes almost straight to the nearest face of the scene's box.
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
        let local = |point: &_| AnyPoint::local(point, self.translation);
        let fill = |range: Range<usize>, part: &mut Vec<_>| {
            points[range].par_iter().map(local).collect_into_vec(part);
        };
        self.winding_of_parts(points.len(), &fill)
    }

    /// [`Self::winding`] of so many points, of which `fill` makes a part what the mesh's positions are.
    fn winding_of_parts(&self, number: usize, fill: Fill<'_>) -> Result<Counted<i32>, Error> {
        // A CPU takes rays in an order in which they go side by side, so many at a time that its cache holds what is
        // kept of them.
        let on_cpu = self.device.is_cpu();
        let at_once = if on_cpu { AT_ONCE } else { self.batch_limit() };
        let device = &if on_cpu { self.device.recycling() } else { self.device.keeping_nothing() };
        let grid = self.grid(at_once.min(number));
        let mut counted = Counted::default();
        let mut windings = vec![0; number];
        let (mut points, mut rays, mut order) = (Vec::new(), Vec::new(), Vec::new());
        for (i, windings) in windings.chunks_mut(at_once).enumerate() {
            let start = Instant::now();
            let first = i * at_once;
            device.install(|| {
                fill(first..first + windings.len(), &mut points);
                if on_cpu {
                    order = grid.order(&points);
                    let ray = |&i: &u32| grid.ray(points[i as usize]);
                    order.par_iter().map(ray).collect_into_vec(&mut rays);
                } else {
                    points.par_iter().map(|point| grid.ray(*point)).collect_into_vec(&mut rays);
                }
            });
            counted.times.upload += start.elapsed();
            self.count_local(device, &rays, &mut counted)?;
            let start = Instant::now();
            let found = counted.counts.drain(..).map(Crossings::winding);
            if on_cpu {
                order.iter().zip(found).for_each(|(&i, found)| windings[i as usize] = found);
            } else {
                windings.iter_mut().zip(found).for_each(|(winding, found)| *winding = found);
            }
            counted.times.download += start.elapsed();
        }
        let Counted { times, invalid, .. } = counted;
        Ok(Counted { counts: windings, times, invalid })
    }

    /// For so many rays.
    fn grid(&self, rays: usize) -> Grid {
        let scale = 1.0 / self.header.scale;
        Grid::new(self.header.lo.map(|x| x * scale), self.header.hi.map(|x| x * scale), rays)
    }

    /// For tests: the rays by which [`Self::winding`] tells of points.
    #[doc(hidden)]
    pub fn winding_rays(&self, points: &[[f32; 3]]) -> Vec<Ray> {
        let grid = self.grid(points.len());
        points.iter().map(|point| grid.ray(AnyPoint::local(point, self.translation))).collect()
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
    fn count_local(
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

/// Points that a CPU takes at once.
const AT_ONCE: usize = 1 << 17;

/// How far a ray goes aside for each unit along an axis. Meshes often have edges and triangles along the axes, and
/// points lie in line with them: a ray straight along an axis would meet one edge after the other, and floats tell of
/// none.
const ASIDE: [f32; 2] = [0.0039, 0.0025];

/// Directions almost along the axes, down and up.
const WAYS: [[f32; 3]; 6] = {
    let [y, z] = ASIDE;
    [[-1.0, y, z], [1.0, y, z], [z, -1.0, y], [z, 1.0, y], [y, z, -1.0], [y, z, 1.0]]
};

/// Makes a part of some points what a mesh's positions are.
type Fill<'a> = &'a (dyn Fn(Range<usize>, &mut Vec<[f32; 3]>) + Sync);

/// Cells of a box, of each direction `8^bits` in the order of Morton 1966: rays of a cell start near each other, and
/// mostly those of the next one, too.
struct Grid {
    lo: Vec4,
    hi: Vec4,
    /// Cells to a unit of length.
    rates: Vec4,
    bits: u32,
}

/// The first way, in the order of [`WAYS`], of those whose bits are set: three down, three up. Without any it is one
/// up.
const FIRST: [u8; 64] = {
    let mut first = [1; 64];
    let mut bits = 1usize;
    while bits < 64 {
        let (down, up) = (bits & 7, bits >> 3);
        let axis = (down | up).trailing_zeros();
        first[bits] = (2 * axis + (down >> axis & 1 == 0) as u32) as u8;
        bits += 1;
    }
    first
};

impl Grid {
    /// Some eight of so many rays start in a cell.
    fn new(lo: [f32; 3], hi: [f32; 3], rays: usize) -> Self {
        let bits = ((rays / 48).max(1).ilog2() / 3).min(7);
        let [x, y, z] = [0, 1, 2].map(|axis| (1 << bits) as f32 / (hi[axis] - lo[axis]));
        // A fourth axis on which the box has no end.
        let lo = Vec4::new(lo[0], lo[1], lo[2], f32::NEG_INFINITY);
        let hi = Vec4::new(hi[0], hi[1], hi[2], f32::INFINITY);
        Self { lo, hi, rates: Vec4::new(x, y, z, 0.0), bits }
    }

    /// The way on which a point leaves the box soonest. All are asked: a processor would guess wrong.
    #[inline]
    fn way(&self, point: [f32; 3]) -> u32 {
        let at = Vec4::new(point[0], point[1], point[2], 0.0);
        let (down, up) = (at - self.lo, self.hi - at);
        let least = Vec4::splat(down.min(up).min_element());
        let bits = down.cmpeq(least).bitmask() & 7 | (up.cmpeq(least).bitmask() & 7) << 3;
        u32::from(FIRST[bits as usize])
    }

    /// The ray from a point on that way.
    fn ray(&self, point: [f32; 3]) -> Ray {
        Ray::new(point, WAYS[self.way(point) as usize])
    }

    /// The number of the cell in which it starts.
    #[inline]
    fn cell(&self, point: [f32; 3]) -> u32 {
        let most = ((1u32 << self.bits) - 1) as f32;
        let at = Vec4::new(point[0], point[1], point[2], 0.0);
        // Points outside, and what is no number, are in a cell at the border.
        let [x, y, z, _] = ((at - self.lo) * self.rates).min(Vec4::splat(most)).to_array().map(|x| x as u32);
        let cell = spread(x) | spread(y) << 1 | spread(z) << 2;
        self.way(point) << (3 * self.bits) | cell
    }

    /// The numbers of points in the order of their cells.
    fn order(&self, points: &[[f32; 3]]) -> Vec<u32> {
        let cells: Vec<u32> = points.par_iter().map(|point| self.cell(*point)).collect();
        let mut next = vec![0u32; (WAYS.len() << (3 * self.bits)) + 1];
        for &cell in &cells {
            next[cell as usize + 1] += 1;
        }
        for i in 1..next.len() {
            next[i] += next[i - 1];
        }
        let mut order = vec![0; points.len()];
        for (i, &cell) in (0..).zip(&cells) {
            let next = &mut next[cell as usize];
            order[*next as usize] = i;
            *next += 1;
        }
        order
    }
}

/// Eight bits, two zeros before each.
const fn spread(bits: u32) -> u32 {
    let bits = (bits | (bits << 8)) & 0x0000_F00F;
    let bits = (bits | (bits << 4)) & 0x000C_30C3;
    (bits | (bits << 2)) & 0x0024_9249
}
