//! Several scenes in one, each moved, turned and scaled.

use super::Scene;
use crate::{
    Error, Hit, Query, Ray,
    rays::{AnyRay, Ray64},
    vector::cross,
};
use raykd_kernels::trace::frame::Frame;
use raykd_shared::MISS;
use rayon::prelude::*;

/// Rays that are looked at together.
const BATCH: usize = 1 << 20;

/// Instances of scenes: the same scene may stand in several places, at the price of one.
///
/// Every ray is taken to the space of each instance whose box it meets, and traced there by [`Scene::trace`], with the
/// traversal and triangle test of that scene. Scenes may be on several devices. The hits are the same bytes on all.
///
/// What is exact: the inverse of a transform and the ray are computed in `f64`, then the ray is rounded once, to the
/// `f32` of a [`Ray`]. Its hits in the instance are those that the scene promises for that ray. So within one
/// instance no ray slips through an edge or a vertex. Between two instances that touch, one may: it is rounded for
/// each of them, by up to 2^-24 of the numbers of its origin and direction there. By a transform that flattens the mesh
/// 2^20 times or more, aslant of its axes, rays close to the flat mesh may lose more digits: its inverse makes them of
/// large numbers that cancel out. Where transform and ray are such that nothing is rounded (whole numbers, powers of
/// two, mirrors), hits are those of one mesh of all triangles, with the test `exact` for any such transform.
///
/// Each instance takes a batch of its own, and the host puts them together: this is for few large instances. Where they
/// move, make a new world: that copies nothing but the transforms.
///
/// ```
/// use raykd::{BuildOptions, Device, Mesh, Ray, Scene, World};
///
/// # fn main() -> Result<(), raykd::Error> {
/// let teapot = Scene::build(&Device::best(), &Mesh::teapot(4), &BuildOptions::default())?;
/// let mut world = World::new();
/// world.add(&teapot, [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])?;
/// // Another, half as large, 40 to the right.
/// world.add(&teapot, [[0.5, 0.0, 0.0, 40.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.0]])?;
/// let hits = world.closest(&[0.0, 40.0, 80.0].map(|x| Ray::new([x, 0.0, 50.0], [0.0, 0.0, -1.0])))?;
/// assert_eq!(hits.iter().map(|hit| hit.is_hit()).collect::<Vec<_>>(), [true, true, false]);
/// assert_eq!((hits[0].instance, hits[1].instance), (0, 1));
/// assert_eq!(hits[0].triangle, hits[1].triangle);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, Default)]
pub struct World {
    instances: Vec<Instance>,
}

/// The answer to one ray, see [`Hit`].
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct WorldHit {
    /// Number of the instance, in the order in which they were added, or [`MISS`].
    pub instance: u32,
    /// Triangle number in its mesh, or [`MISS`].
    pub triangle: u32,
    /// Ray parameter of the hit, in lengths of the ray's direction in the world.
    pub t: f32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
}

impl WorldHit {
    /// What a ray that hits nothing gets.
    pub const NONE: Self = Self { instance: MISS, triangle: MISS, t: 0.0, u: 0.0, v: 0.0 };

    /// Whether a triangle was hit.
    pub const fn is_hit(&self) -> bool {
        self.instance != MISS
    }
}

/// Hits in a world: see [`World::trace`].
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct WorldTraced {
    /// One hit a ray, in the order of the rays.
    pub hits: Vec<WorldHit>,
    /// Invalid rays, as in [`Traced::invalid`](super::Traced::invalid): in the world, or in an instance that was asked
    /// for them, where they hit nothing. Each counts once.
    pub invalid: u64,
}

impl World {
    /// A world without instances, in which nothing is hit.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an instance of a scene, and returns its number: 0, 1, 2, … The memory of the scene is shared.
    ///
    /// `transform` takes points of the mesh to the world. Its rows give x, y and z there: three factors of the mesh's
    /// x, y and z, and what is added. It may scale each axis otherwise, shear and mirror.
    ///
    /// # Errors
    /// A number of the transform is infinite or NaN, or it is singular: it makes the mesh flat.
    pub fn add(&mut self, scene: &Scene, transform: [[f32; 4]; 3]) -> Result<u32, Error> {
        let number = self.instances.len() as u32;
        let refused = |why| Error::Transform { instance: number, why };
        if !transform.iter().flatten().all(|x| x.is_finite()) {
            return Err(refused("has a number that is infinite or NaN; give finite ones"));
        }
        let rows = transform.map(|[x, y, z, _]| [x, y, z].map(f64::from));
        let inverse = inverse(rows)
            .ok_or_else(|| refused("is singular (its determinant is 0); leave the instance out"))?;
        let shift = transform.map(|row| f64::from(row[3]));
        self.instances.push(Instance { scene: scene.clone(), inverse, shift });
        Ok(number)
    }

    /// How many instances there are.
    pub fn len(&self) -> usize {
        self.instances.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.instances.is_empty()
    }

    /// The closest hit of every ray: of equal `t`, that of the instance with the lowest number, and there of the
    /// triangle with the lowest.
    ///
    /// # Errors
    /// A device failed.
    pub fn closest(&self, rays: &[impl AnyRay]) -> Result<Vec<WorldHit>, Error> {
        Ok(self.trace(Query::Closest, rays)?.hits)
    }

    /// Some hit of every ray that has one.
    ///
    /// # Errors
    /// A device failed.
    pub fn any(&self, rays: &[impl AnyRay]) -> Result<Vec<WorldHit>, Error> {
        Ok(self.trace(Query::Any, rays)?.hits)
    }

    /// The closest or any hit of every ray, and how many rays were invalid. An instance is not asked for any hit of a
    /// ray that has one.
    ///
    /// # Errors
    /// A device failed.
    pub fn trace(&self, query: Query, rays: &[impl AnyRay]) -> Result<WorldTraced, Error> {
        let mut all = WorldTraced { hits: Vec::with_capacity(rays.len()), invalid: 0 };
        for rays in rays.chunks(BATCH) {
            let mut best = vec![WorldHit::NONE; rays.len()];
            let mut none: Vec<bool> = rays.par_iter().map(|ray| is_none(&ray.wide())).collect();
            for (number, instance) in (0..).zip(&self.instances) {
                let open = |best: &WorldHit| query == Query::Closest || !best.is_hit();
                let pairs = rays.par_iter().zip(&best).zip(&mut none).enumerate();
                let met =
                    pairs.filter(|(_, ((_, best), _))| open(best)).filter_map(|(i, ((ray, best), none))| {
                        match instance.take(ray, best) {
                            Part::None => *none = true,
                            Part::Beside => {}
                            Part::Asked(ray) => return Some((i, ray)),
                        }
                        None
                    });
                let (which, local): (Vec<usize>, Vec<Ray64>) = met.collect::<Vec<_>>().into_iter().unzip();
                for (i, hit) in which.into_iter().zip(instance.scene.trace(query, &local)?.hits) {
                    if hit.is_hit() && (!best[i].is_hit() || hit.t < best[i].t) {
                        let Hit { triangle, t, u, v } = hit;
                        best[i] = WorldHit { instance: number, triangle, t, u, v };
                    }
                }
            }
            all.hits.extend(best);
            all.invalid += none.into_iter().filter(|&none| none).count() as u64;
        }
        Ok(all)
    }
}

#[derive(Clone, Debug)]
struct Instance {
    scene: Scene,
    /// Takes directions from the world to the mesh.
    inverse: [[f64; 3]; 3],
    /// What points lose before that.
    shift: [f64; 3],
}

/// What an instance makes of a ray.
enum Part {
    /// It is invalid in the space of the mesh.
    None,
    /// It does not meet the box of the mesh.
    Beside,
    /// Its part that could be better than a hit, in the space of the mesh.
    Asked(Ray64),
}

impl Instance {
    fn take(&self, ray: &impl AnyRay, best: &WorldHit) -> Part {
        let ray = ray.wide();
        let to_mesh = |v: [f64; 3]| self.inverse.map(|[x, y, z]| x * v[0] + y * v[1] + z * v[2]);
        let local = Ray64 {
            origin: to_mesh([0, 1, 2].map(|i| ray.origin[i] - self.shift[i])),
            direction: to_mesh(ray.direction),
            t_max: if best.is_hit() { best.t.into() } else { ray.t_max },
            ..ray
        };
        let header = self.scene.header();
        let scaled = |corner: [f32; 3]| corner.map(|x| f64::from(x) / f64::from(header.scale));
        let bounds = (scaled(header.lo), scaled(header.hi));
        let rounded = local.alone(self.scene.translation);
        if !Frame::of(&rounded, header).valid {
            Part::None
        } else if may_meet(&rounded, bounds) {
            Part::Asked(local)
        } else {
            Part::Beside
        }
    }
}

/// Whether a ray is invalid wherever instances are.
fn is_none(ray: &Ray64) -> bool {
    let numbers = ray.origin.iter().chain(&ray.direction).all(|x| x.is_finite());
    !numbers || ray.direction == [0.0; 3] || ray.t_min.is_nan() || ray.t_max.is_nan()
}

/// Whether a ray could hit something in a box, by any test: at the `t` of a hit it is within 2^-24 * 21 of the box,
/// times the largest distance along an axis from its origin to a corner. Here that is 2^-18, which covers the
/// rounding of `t` too.
fn may_meet(ray: &Ray, (lo, hi): ([f64; 3], [f64; 3])) -> bool {
    const SLACK: f64 = 1.0 / (1 << 18) as f64;
    let origin = ray.origin.map(f64::from);
    let far = (0..3).map(|i| (lo[i] - origin[i]).abs().max((hi[i] - origin[i]).abs())).fold(0.0, f64::max);
    let around = SLACK * far + f64::from(f32::MIN_POSITIVE);
    let widened = |t: f32, by: f64| f64::from(t) + by * SLACK * f64::from(t.abs());
    let (mut enter, mut leave) = (widened(ray.t_min, -1.0), widened(ray.t_max, 1.0));
    for axis in 0..3 {
        let (lo, hi) = (lo[axis] - around - origin[axis], hi[axis] + around - origin[axis]);
        if ray.direction[axis].is_normal() {
            let (a, b) = (lo / f64::from(ray.direction[axis]), hi / f64::from(ray.direction[axis]));
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        } else if lo > 0.0 || hi < 0.0 {
            return false;
        }
    }
    enter <= leave
}

/// The inverse of a matrix of `f32`, if there is one. Products of two are exact.
fn inverse([a, b, c]: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let determinant = determinant([a, b, c]);
    let columns = [cross(b, c), cross(c, a), cross(a, b)];
    let inverse = [0, 1, 2].map(|i| columns.map(|column| column[i] / determinant));
    (determinant != 0.0).then_some(inverse)
}

/// The determinant of a matrix of `f32`, right but for the last digit, however much its terms cancel out.
fn determinant([a, b, c]: [[f64; 3]; 3]) -> f64 {
    let mut terms = Vec::with_capacity(12);
    for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
        for (p, q) in [(b[j], c[k]), (-b[k], c[j])] {
            let product = a[i] * (p * q);
            terms.extend([product, a[i].mul_add(p * q, -product)]);
        }
    }
    exact_sum(terms)
}

/// The sum of some numbers, right but for the last digit: as numbers that do not overlap (Shewchuk 1997, section 2.4).
fn exact_sum(terms: Vec<f64>) -> f64 {
    let mut parts: Vec<f64> = Vec::with_capacity(terms.len());
    for mut sum in terms {
        for part in &mut parts {
            let all = sum + *part;
            let shared = all - sum;
            *part = (sum - (all - shared)) + (*part - shared);
            sum = all;
        }
        parts.retain(|&part| part != 0.0);
        parts.push(sum);
    }
    parts.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rays::Random;

    #[test]
    fn determinants_of_all_but_singular_matrices_have_all_digits() {
        let mut random = Random::new(3);
        for _ in 0..1000 {
            let mut row = |size: usize| [0; 3].map(|_| random.below(2 * size) as i128 - size as i128);
            let (a, b, nudge) = (row(1 << 21), row(1 << 21), row(4));
            let c = [0, 1, 2].map(|i| 3 * a[i] - 2 * b[i] + nudge[i]);
            let exact: i128 = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
                .iter()
                .map(|&(i, j, k)| a[i] * (b[j] * c[k] - b[k] * c[j]))
                .sum();
            let power = 2f64.powi(random.below(60) as i32 - 30);
            let found = determinant([a, b, c].map(|row| row.map(|x| x as f64 * power)));
            assert_eq!(found, exact as f64 * power.powi(3), "{a:?} {b:?} {c:?}");
        }
    }
}
