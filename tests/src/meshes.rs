//! Meshes, each made from a family, a size and a seed, so that `proptest` can shrink them.

use proptest::prelude::*;
use raykd::{Mesh, rays::Random};
use std::{collections::HashMap, fmt, ops::RangeInclusive};

/// A kind of mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// Random triangles, small and large.
    Soup,
    /// Corners with small integer coordinates: ties, triangles in planes, duplicates, triangles without area.
    Lattice,
    /// Needles a million times longer than wide.
    Slivers,
    /// Coordinates over 20 binades around a scale from 1e-30 to 1e30, far from the origin or not.
    Wild,
    /// The same triangle again and again.
    Identical,
    /// Lattice triangles in one plane across an axis.
    Flat,
    /// Triangles that share one corner.
    Fan,
    /// Closed unit cubes on an integer grid: faces lie in splitting planes, twice.
    Cubes,
    /// No triangle has area.
    Nothing,
    /// Triangles without area between others.
    Holes,
    /// Walls a millionth apart.
    Walls,
    /// A small soup inside a large one.
    Stadium,
    /// Diagonal sticks: their boxes overlap everywhere.
    Sticks,
    /// A soup a million of its sizes away from the origin.
    Far,
}

/// The families that are made of random numbers all over.
pub const RANDOM: [Family; 4] = [Family::Soup, Family::Lattice, Family::Slivers, Family::Wild];

/// The rest: each has broken somebody's ray tracer.
pub const ZOO: [Family; 10] = [
    Family::Identical,
    Family::Flat,
    Family::Fan,
    Family::Cubes,
    Family::Nothing,
    Family::Holes,
    Family::Walls,
    Family::Stadium,
    Family::Sticks,
    Family::Far,
];

/// A mesh to be made.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Recipe {
    /// Its kind.
    pub family: Family,
    /// About how many triangles it has, at least 1. A smaller mesh is the start of a larger one.
    pub size: u32,
    /// What its random numbers come from.
    pub seed: u64,
}

impl fmt::Debug for Recipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { family, size, seed } = self;
        write!(f, "Recipe {{ family: Family::{family:?}, size: {size}, seed: {seed} }}")
    }
}

/// Meshes of any family, mostly small; some need several levels, chunks and workgroups.
pub fn any_mesh() -> impl Strategy<Value = Recipe> {
    prop_oneof![9 => small_mesh(), 1 => sized(all(), 2000..=5000)]
}

/// Meshes of any family, the large ones of families that a tree takes apart well: in the others a ray tests
/// most triangles, and there a software rasteriser may give up (Mesa's ends all loops after 65,535 rounds).
pub fn traceable_mesh() -> impl Strategy<Value = Recipe> {
    let separable = vec![Family::Soup, Family::Slivers, Family::Cubes, Family::Holes, Family::Far];
    prop_oneof![9 => small_mesh(), 1 => sized(separable, 2000..=5000)]
}

/// Meshes of any family of one to some hundred triangles.
pub fn small_mesh() -> impl Strategy<Value = Recipe> {
    prop_oneof![1 => sized(all(), 1..=40), 2 => sized(all(), 33..=400)]
}

/// All families, the random ones twice as often.
fn all() -> Vec<Family> {
    RANDOM.into_iter().chain(RANDOM).chain(ZOO).collect()
}

fn sized(families: Vec<Family>, sizes: RangeInclusive<u32>) -> impl Strategy<Value = Recipe> {
    (prop::sample::select(families), sizes, any::<u64>()).prop_map(|(family, size, seed)| Recipe {
        family,
        size,
        seed,
    })
}

type Point = [f32; 3];

/// A number from `-1` to `1`.
fn signed(random: &mut Random) -> f32 {
    (random.unit() * 2.0 - 1.0) as f32
}

fn point(random: &mut Random) -> Point {
    [(); 3].map(|()| signed(random))
}

fn near(p: Point, size: f32, random: &mut Random) -> Point {
    p.map(|x| x + size * signed(random))
}

/// A triangle of a soup in a box of size 2.
fn any_triangle(random: &mut Random) -> [Point; 3] {
    let size = if random.unit() < 0.1 { 1.0 } else { 0.15 };
    let a = point(random);
    [a, near(a, size, random), near(a, size, random)]
}

/// An integer from 0 below `n`, as a number.
fn whole(n: u32, random: &mut Random) -> f32 {
    (random.bits() % u64::from(n)) as f32
}

impl Recipe {
    /// Makes the mesh.
    ///
    /// # Panics
    /// A family makes what is no mesh.
    pub fn mesh(&self) -> Mesh {
        let (positions, triangles) = self.indexed();
        Mesh::new(positions, triangles).expect("families make meshes")
    }

    /// Vertices and triangles.
    fn indexed(&self) -> (Vec<Point>, Vec<[u32; 3]>) {
        let mut random = Random::new(self.seed);
        let random = &mut random;
        let n = self.size.max(1);
        if self.family == Family::Cubes {
            return cubes(n.div_ceil(12), random);
        }
        let mut soup: Vec<[Point; 3]> = Vec::with_capacity(n as usize);
        // What all triangles of the mesh share.
        let first = any_triangle(random);
        let axis = (random.bits() % 3) as usize;
        let level = whole(5, random);
        let scale = 10f32.powf(30.0 * signed(random));
        let offset = if random.unit() < 0.5 { [0.0; 3] } else { point(random).map(|x| x * scale * 1e3) };
        for i in 0..n {
            soup.push(match self.family {
                Family::Cubes | Family::Soup => any_triangle(random),
                Family::Lattice => [(); 3].map(|()| [(); 3].map(|()| whole(6, random))),
                Family::Slivers => {
                    let (a, b) = (point(random), point(random));
                    [a, b, near(b, 1e-6, random)]
                }
                Family::Wild => [(); 3].map(|()| {
                    [0, 1, 2].map(|a| signed(random) * (-whole(20, random)).exp2() * scale + offset[a])
                }),
                Family::Identical => first,
                Family::Flat => [(); 3].map(|()| {
                    let mut p = [(); 3].map(|()| whole(9, random));
                    p[axis] = level;
                    p
                }),
                Family::Fan => [[0.25, 0.5, -0.125], point(random), point(random)],
                Family::Nothing => {
                    let (a, d) = ([(); 3].map(|()| whole(9, random)), [(); 3].map(|()| whole(3, random)));
                    [a, [0, 1, 2].map(|k| a[k] + d[k]), [0, 1, 2].map(|k| a[k] + 2.0 * d[k])]
                }
                Family::Holes if i % 3 == 0 => {
                    let a = point(random);
                    [a, a, point(random)]
                }
                Family::Holes => any_triangle(random),
                Family::Walls => {
                    let x = 1.0 + (i % 7) as f32 * 1e-6;
                    let (y, z) = (whole(4, random), whole(4, random));
                    [[x, y, z], [x, y + 1.0, z], [x, y, z + 1.0]]
                }
                Family::Stadium if i < 4 => any_triangle(random).map(|p| p.map(|x| x * 1e6)),
                Family::Stadium => any_triangle(random).map(|p| p.map(|x| x * 1e-3)),
                Family::Sticks => {
                    let a = near([0.0; 3], 0.3, random);
                    let b = a.map(|x| x + 1.0);
                    [a, b, near(b, 1e-2, random)]
                }
                Family::Far => any_triangle(random).map(|p| [p[0] + 1e6, p[1] - 1e6, p[2] + 1e6]),
            });
        }
        let triangles = (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        (soup.into_iter().flatten().collect(), triangles)
    }
}

/// Unit cubes at random places of a small grid, at most one a place, with shared vertices.
fn cubes(count: u32, random: &mut Random) -> (Vec<Point>, Vec<[u32; 3]>) {
    let side = (1..).find(|s| s * s * s >= 2 * count).unwrap_or(1);
    let mut cells: Vec<u32> = (0..side * side * side).collect();
    for i in 0..count as usize {
        let j = i + (random.bits() % (cells.len() - i) as u64) as usize;
        cells.swap(i, j);
    }
    let mut mesh = Welded::default();
    for &cell in &cells[..count as usize] {
        let base = [cell % side, cell / side % side, cell / (side * side)].map(|x| x as f32);
        mesh.cube(base);
    }
    mesh.done()
}

/// A mesh whose equal positions are one vertex.
#[derive(Debug, Default)]
pub struct Welded {
    positions: Vec<Point>,
    triangles: Vec<[u32; 3]>,
    numbers: HashMap<[u32; 3], u32>,
}

impl Welded {
    fn vertex(&mut self, p: Point) -> u32 {
        *self.numbers.entry(p.map(f32::to_bits)).or_insert_with(|| {
            self.positions.push(p);
            self.positions.len() as u32 - 1
        })
    }

    /// Adds a triangle.
    pub fn triangle(&mut self, corners: [Point; 3]) {
        let triangle = corners.map(|p| self.vertex(p));
        self.triangles.push(triangle);
    }

    /// Adds the unit cube with this lowest corner.
    pub fn cube(&mut self, [x, y, z]: Point) {
        let corner = |i: u32| [x + (i & 1) as f32, y + (i >> 1 & 1) as f32, z + (i >> 2) as f32];
        for [a, b, c, d] in
            [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        {
            self.triangle([a, b, c].map(corner));
            self.triangle([a, c, d].map(corner));
        }
    }

    fn done(self) -> (Vec<Point>, Vec<[u32; 3]>) {
        (self.positions, self.triangles)
    }

    /// The mesh.
    ///
    /// # Panics
    /// It is none.
    pub fn mesh(self) -> Mesh {
        Mesh::new(self.positions, self.triangles).expect("a mesh")
    }
}

/// A sphere around the origin of `20 * 4^level` triangles: closed, no two edges parallel to speak of.
pub fn icosphere(level: u32) -> Mesh {
    let g = (1.0 + 5f32.sqrt()) / 2.0;
    let mut corners: Vec<Point> = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        corners.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
    }
    let distance = |p: Point, q: Point| (0..3).map(|i| (p[i] - q[i]) * (p[i] - q[i])).sum::<f32>();
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let t = [corners[i], corners[j], corners[k]];
                // Neighbours are 2 apart.
                if (0..3).all(|e| distance(t[e], t[(e + 1) % 3]) < 4.5) {
                    faces.push(t);
                }
            }
        }
    }
    for _ in 0..level {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let middle = |p: Point, q: Point| {
                    let m = [0, 1, 2].map(|i| p[i] + q[i]);
                    let stretch = (1.0 + g * g).sqrt() / distance(m, [0.0; 3]).sqrt();
                    m.map(|x| x * stretch)
                };
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let mut mesh = Welded::default();
    faces.into_iter().for_each(|t| mesh.triangle(t));
    mesh.mesh()
}
