//! Which points are inside of the mesh: how often the surface goes round each.

use super::{
    Scene,
    batch::Job,
    crossings::Counted,
    order::{Cells, by_keys},
    trace::{Traced, traced},
};
use crate::{
    Device, Error,
    clock::Instant,
    exec::{Buffer, Launch as _, To},
    rays::AnyPoint,
};
use raykd_kernels::{
    glam::{UVec4, Vec4},
    trace::locate::{self, UNKNOWN},
};
use raykd_shared::{Crossings, Ray};
use rayon::prelude::*;
use std::{ops::Range, time::Duration};

impl Scene {
    /// How often the surface goes round each point: 0 outside of a closed mesh, 1 inside if triangles are
    /// counterclockwise seen from outside, -1 if clockwise, and larger numbers where it overlaps itself. Points on
    /// the surface count as if moved by `(e, e^2, e^3)`, see [`Scene::crossings`].
    ///
    /// Only of closed meshes ([`Edges::are_closed`](crate::mesh::Edges::are_closed)) is that a property of the point;
    /// of others it is what a ray crosses that goes almost straight to the nearest face of the scene's box.
    ///
    /// A scene of a closed mesh that has been asked for many more points than it has triangles keeps a copy of the
    /// tree's nodes, with the number of each empty leaf; points in those are only looked up. Clones share it.
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

    /// [`Self::winding`] of so many points, of which `fill` gives a range as the mesh's positions are.
    fn winding_of_parts(&self, number: usize, fill: Fill<'_>) -> Result<Counted<i32>, Error> {
        let start = Instant::now();
        let regions = self.regions(number)?;
        let upload = start.elapsed();
        let Some(regions) = regions else {
            let mut counted = self.winding_by_rays(number, fill)?;
            counted.times.upload += upload;
            return Ok(counted);
        };
        let mut counted = Counted::default();
        counted.times.upload = upload;
        // Of some points numbers are known, the others are asked by rays.
        let (mut points, mut left, mut others) = (Vec::new(), Vec::new(), Vec::new());
        let (at_once, device) = self.portions();
        let mut worth = true;
        for first in (0..number).step_by(at_once) {
            let start = Instant::now();
            let end = number.min(first + at_once);
            self.device.install(|| fill(first..end, &mut points));
            counted.times.upload += start.elapsed();
            let before = left.len();
            if worth {
                self.locate(&device, regions, &points, &mut counted)?;
            } else {
                counted.counts.resize(end, UNKNOWN.cast_signed());
            }
            let start = Instant::now();
            for (i, point) in (first..end).zip(&points) {
                if counted.counts[i] == UNKNOWN.cast_signed() {
                    left.push(i);
                    others.push(*point);
                }
            }
            // Points close to the surface are seldom in empty leaves.
            worth &= 2 * (left.len() - before) < points.len();
            counted.times.upload += start.elapsed();
        }
        let rest = self.winding_by_rays(others.len(), &|range, part| others[range].clone_into(part))?;
        left.iter().zip(rest.counts).for_each(|(&i, number)| counted.counts[i] = number);
        counted.times += rest.times;
        counted.invalid += rest.invalid;
        Ok(counted)
    }

    /// Adds the numbers of points in empty leaves; the points are as the mesh's positions are, and fit the device.
    fn locate(
        &self,
        device: &Device,
        regions: &Buffer<UVec4>,
        points: &[[f32; 3]],
        counted: &mut Counted<i32>,
    ) -> Result<(), Error> {
        let start = Instant::now();
        let job = Job::new(device, points.len() as u32)?;
        let coordinates: &Buffer<f32> = &device.put("points", points)?.view();
        let found = device.room("found", points.len() as u64)?;
        counted.times.upload += start.elapsed();
        let buffers = locate::Buffers {
            job: &job.record,
            header: &self.header_buffer,
            regions,
            points: coordinates,
            found: found.out(),
            outcome: job.outcome.out(),
        };
        let step = buffers.over(points.len() as u32);
        let Traced { times, invalid, .. } = traced(Duration::ZERO, || {
            let wanted = found.back(To::End(&mut counted.counts, points.len()));
            job.run(&self.device, &[step], 0, vec![wanted])
        })?;
        counted.times += times;
        counted.invalid += invalid;
        Ok(())
    }

    /// How many points are taken at once, and in memory of which device: on a CPU so many that its cache holds what is
    /// kept of them.
    fn portions(&self) -> (usize, Device) {
        if self.device.is_cpu() {
            (AT_ONCE, self.device.recycling())
        } else {
            (self.batch_limit(), self.device.keeping_nothing())
        }
    }

    /// The same, by a ray from each point.
    pub(super) fn winding_by_rays(&self, number: usize, fill: Fill<'_>) -> Result<Counted<i32>, Error> {
        // A CPU takes rays in an order in which they go side by side.
        let on_cpu = self.device.is_cpu();
        let (at_once, device) = self.portions();
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
            self.count_local(&device, &rays, &mut counted)?;
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
        let (lo, hi) = self.bounds();
        Grid::new(lo, hi, rays)
    }

    /// For tests: the rays by which [`Self::winding`] tells of points.
    #[doc(hidden)]
    pub fn winding_rays(&self, points: &[[f32; 3]]) -> Vec<Ray> {
        let grid = self.grid(points.len());
        points.iter().map(|point| grid.ray(AnyPoint::local(point, self.translation))).collect()
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

/// Gives a range of some points, as the mesh's positions are.
pub(super) type Fill<'a> = &'a (dyn Fn(Range<usize>, &mut Vec<[f32; 3]>) + Sync);

/// Cells of a box for each direction: rays of a cell start near each other, and mostly those of the next one, too.
struct Grid {
    lo: Vec4,
    hi: Vec4,
    cells: Cells,
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
        let cells = Cells::new(lo, hi, bits);
        // A fourth axis on which the box has no end.
        let lo = Vec4::new(lo[0], lo[1], lo[2], f32::NEG_INFINITY);
        let hi = Vec4::new(hi[0], hi[1], hi[2], f32::INFINITY);
        Self { lo, hi, cells }
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

    /// The numbers of points in the order of their ways, and of the cells that rays start in.
    fn order(&self, points: &[[f32; 3]]) -> Vec<u32> {
        let count = self.cells.count();
        let key = |point: &[f32; 3]| self.way(*point) * count as u32 + self.cells.of(*point);
        let keys: Vec<u32> = points.par_iter().map(key).collect();
        let mut order = vec![0; points.len()];
        by_keys(&keys, WAYS.len() * count, &mut order);
        order
    }
}
