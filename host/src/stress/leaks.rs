//! Rays by the billion, exactly at edges and vertices of surfaces that have no gap there: none may miss.
//!
//! From inside a closed mesh every ray must hit. From outside a ray must hit if the triangles around the edge or
//! vertex it is aimed at cover, seen along the ray, a disc so large that no rounding reaches beyond it.

use super::{SLACK, shapes};
use crate::{Error, Hit, Mesh, Ray, mesh::MeshSource, rays::Random};
use rayon::prelude::*;
use std::{collections::HashMap, sync::mpsc::sync_channel, thread};

type V = [f64; 3];

/// Rays made at once from one seed.
const CHUNK: usize = 1 << 14;
/// Rays traced at once.
const BATCH: usize = 1 << 22;

/// Where rays start.
#[derive(Clone, Debug)]
enum From {
    /// Within this distance along each axis of one of these points, all of that being inside the mesh.
    Inside(Vec<V>, f64),
    /// On a cube around the mesh, of this centre and half width.
    Outside(V, f64),
}

/// A surface and the rays at it.
#[derive(Debug)]
pub struct Surface {
    /// Its name.
    pub name: String,
    /// The mesh.
    pub mesh: Mesh,
    from: From,
    points: Vec<V>,
    /// Edges between two triangles: the ends, and the triangles' other corners.
    edges: Vec<[u32; 4]>,
    /// Vertices within the surface: themselves, and the edges around them, in `ring`.
    vertices: Vec<(u32, std::ops::Range<usize>)>,
    ring: Vec<[u32; 2]>,
    reach: f64,
}

/// Rays that missed.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct Leaks {
    /// Rays traced.
    pub rays: u64,
    /// How many missed.
    pub leaks: u64,
    /// One of them.
    pub example: Option<Ray>,
}

impl Surface {
    /// The surfaces to test, those among them that have to be fetched only if they are there.
    pub fn all() -> Vec<Self> {
        let sphere = shapes::icosphere(5);
        let cubes = shapes::cubes(500, &mut Random::new(5)).mesh();
        let centres = cubes.triangles().chunks(12).map(|cube| {
            let corners = cube.iter().flatten().map(|&v| cubes.positions()[v as usize].map(f64::from));
            corners
                .fold([f64::INFINITY; 3], |lo, p| [0, 1, 2].map(|i| f64::min(lo[i], p[i])))
                .map(|x| x + 0.5)
        });
        let centres = centres.collect();
        let mut all = vec![
            Self::new("sphere-inside", sphere.clone(), Some(From::Inside(vec![[0.0; 3]], 0.9))),
            Self::new("cubes-inside", cubes, Some(From::Inside(centres, 0.49))),
            Self::new("sphere", sphere, None),
            Self::new("teapot", Mesh::teapot(16), None),
        ];
        let dragon = "dragon_res4".parse::<MeshSource>().and_then(|dragon| dragon.load());
        all.extend(dragon.ok().map(|mesh| Self::new("dragon_res4", mesh, None)));
        all
    }

    fn new(name: &str, mesh: Mesh, from: Option<From>) -> Self {
        let mut numbers = HashMap::new();
        let mut points: Vec<V> = Vec::new();
        // Equal positions are one vertex.
        let triangles: Vec<[u32; 3]> = mesh.kept().iter().map(|&t| mesh.triangles()[t as usize]).collect();
        let mut weld = |v: u32| {
            let p = mesh.positions()[v as usize].map(|x| x + 0.0);
            *numbers.entry(p.map(f32::to_bits)).or_insert_with(|| {
                points.push(p.map(f64::from));
                points.len() as u32 - 1
            })
        };
        let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(&mut weld)).collect();
        let mut beside: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
        let mut around: Vec<Vec<[u32; 2]>> = vec![Vec::new(); points.len()];
        for t in &triangles {
            for k in 0..3 {
                let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
                beside.entry((a.min(b), a.max(b))).or_default().push(c);
                around[a as usize].push([b, c]);
            }
        }
        let mut edges: Vec<[u32; 4]> =
            beside.iter().filter(|(_, c)| c.len() == 2).map(|(&(a, b), c)| [a, b, c[0], c[1]]).collect();
        edges.sort_unstable();
        let (mut vertices, mut ring) = (Vec::new(), Vec::new());
        for (v, pairs) in around.into_iter().enumerate() {
            let v = v as u32;
            // One ring: from triangle to triangle around the vertex and back, without a turn left out.
            let mut turns = 1;
            let mut at = pairs.first().copied();
            while let Some([from, to]) = at {
                at = pairs.iter().copied().find(|p| p[0] == to && p[1] != from).filter(|p| *p != pairs[0]);
                turns += usize::from(at.is_some());
                if turns > pairs.len() {
                    break;
                }
            }
            let closed = pairs.iter().all(|&[b, _]| beside[&(v.min(b), v.max(b))].len() == 2);
            if closed && turns == pairs.len() {
                vertices.push((v, ring.len()..ring.len() + pairs.len()));
                ring.extend(pairs);
            }
        }
        let (lo, hi) = mesh.bounds();
        let centre = [0, 1, 2].map(|i| (f64::from(lo[i]) + f64::from(hi[i])) * 0.5);
        let half = (0..3).map(|i| f64::from(hi[i]) - f64::from(lo[i])).fold(0.0, f64::max) * 0.5;
        let from = from.unwrap_or(From::Outside(centre, 3.0 * half));
        Self { name: name.to_owned(), mesh, from, points, edges, vertices, ring, reach: 4.0 * half }
    }

    /// One ray: from somewhere through a vertex (one in four) or a point of an edge; `None` if it may pass beside.
    fn ray(&self, random: &mut Random) -> Option<Ray> {
        let signed = |random: &mut Random| random.unit() * 2.0 - 1.0;
        let narrow = |p: V| p.map(|x| x as f32);
        let origin = match &self.from {
            From::Inside(centres, half) => {
                let centre = centres[random.below(centres.len())];
                centre.map(|x| x + half * signed(random))
            }
            From::Outside(centre, half) => {
                let mut p = [(); 3].map(|()| signed(random));
                p[random.below(3)] = if random.bits() & 1 == 0 { 1.0 } else { -1.0 };
                [0, 1, 2].map(|i| centre[i] + half * p[i])
            }
        };
        let origin = narrow(origin);
        let point = |v: u32| self.points[v as usize];
        let (target, rim): (V, &[[u32; 2]]);
        let sides;
        if random.bits() & 3 == 0 && !self.vertices.is_empty() {
            let (v, range) = &self.vertices[random.below(self.vertices.len())];
            (target, rim) = (point(*v), &self.ring[range.clone()]);
        } else {
            let [a, b, c, d] = self.edges[random.below(self.edges.len())];
            let (p, q, s) = (point(a), point(b), random.unit());
            target = [0, 1, 2].map(|i| p[i] + s * (q[i] - p[i]));
            // Around a point of the edge, in one direction if the triangles lie on its two sides.
            sides = [[a, d], [d, b], [b, c], [c, a]];
            rim = &sides;
        }
        let target = narrow(target);
        let ray = Ray::new(origin, [0, 1, 2].map(|i| target[i] - origin[i]));
        if let From::Inside(..) = self.from {
            return Some(ray);
        }
        // Not the far side of the mesh.
        Some(Ray { t_max: self.covered(&ray, rim)?, ..ray })
    }

    /// The `t` before which a ray meets the triangles around its target, if their rim, seen along the ray, goes around
    /// a disc about it that rounding does not leave.
    fn covered(&self, ray: &Ray, rim: &[[u32; 2]]) -> Option<f32> {
        let d = ray.direction.map(f64::from);
        let main = (1..3).fold(0, |best, i| if d[i].abs() > d[best].abs() { i } else { best });
        let (i, j) = ((main + 1) % 3, (main + 2) % 3);
        let slope = [d[i] / d[main], d[j] / d[main]];
        let origin = ray.origin.map(f64::from);
        let seen = |v: u32| {
            let p = self.points[v as usize];
            let z = p[main] - origin[main];
            [p[i] - origin[i] - slope[0] * z, p[j] - origin[j] - slope[1] * z, z / d[main]]
        };
        let disc = 2.0 * SLACK * self.reach;
        let (mut way, mut last) = (0.0, 1.0);
        let around = rim.iter().all(|&[a, b]| {
            let (a, b) = (seen(a), seen(b));
            let turn = a[0] * b[1] - a[1] * b[0];
            let ab = [b[0] - a[0], b[1] - a[1]];
            let length = ab[0] * ab[0] + ab[1] * ab[1];
            let same = turn * way >= 0.0 && turn != 0.0;
            (way, last) = (turn, f64::max(last, a[2]));
            // The line through the edge is no nearer than the edge.
            same && turn * turn > disc * disc * length
        });
        around.then_some((last + disc / d[main].abs()) as f32)
    }

    /// Rays from one seed.
    fn chunk(&self, seed: u64, count: usize) -> Vec<Ray> {
        let mut random = Random::new(seed.wrapping_mul(0xD134_2543_DE82_EF95) ^ 0x1EAC);
        std::iter::repeat_with(|| self.ray(&mut random)).flatten().take(count).collect()
    }

    /// Traces so many rays, always the same ones, and counts those that miss. Rays are made and answers looked at by
    /// all threads while the scene's device traces; `done` hears how many rays are through.
    ///
    /// # Errors
    /// The device failed.
    pub fn run(
        &self,
        rays: u64,
        trace: impl Fn(&[Ray]) -> Result<Vec<Hit>, Error>,
        done: impl Fn(u64),
    ) -> Result<Leaks, Error> {
        let (sender, batches) = sync_channel::<Vec<Ray>>(2);
        thread::scope(|scope| {
            scope.spawn(move || {
                let mut from = 0;
                while from < rays {
                    let count = (rays - from).min(BATCH as u64);
                    let chunks = (count as usize).div_ceil(CHUNK);
                    let make = |i: usize| {
                        let size = CHUNK.min(count as usize - i * CHUNK);
                        self.chunk(from / CHUNK as u64 + i as u64, size)
                    };
                    let batch: Vec<Vec<Ray>> = (0..chunks).into_par_iter().map(make).collect();
                    // Nobody listens any more if the device failed.
                    if sender.send(batch.concat()).is_err() {
                        return;
                    }
                    from += count;
                }
            });
            let mut found = Leaks::default();
            for batch in batches {
                let hits = trace(&batch)?;
                found.rays += batch.len() as u64;
                found.leaks += hits.par_iter().filter(|hit| !hit.is_hit()).count() as u64;
                if found.leaks > 0 && found.example.is_none() {
                    let first = hits.iter().position(|hit| !hit.is_hit());
                    found.example = first.map(|i| batch[i]);
                }
                done(found.rays);
            }
            Ok(found)
        })
    }
}
