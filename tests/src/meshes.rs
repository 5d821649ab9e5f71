//! Meshes, each made from a family, a size and a seed, so that `proptest` can shrink them.

use proptest::prelude::*;
pub use raykd::stress::shapes::{Welded, icosphere, loose, moved};
use raykd::{
    Mesh,
    rays::Random,
    stress::shapes::{Point, cubes},
};
use std::{fmt, ops::RangeInclusive};

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

/// A triangle of a soup in a box of size 2.
fn any_triangle(random: &mut Random) -> [Point; 3] {
    let size = if random.unit() < 0.1 { 1.0 } else { 0.15 };
    let a = random.point();
    [a, random.near(a, size), random.near(a, size)]
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
            return cubes(n.div_ceil(12), random).done();
        }
        let mut soup: Vec<[Point; 3]> = Vec::with_capacity(n as usize);
        // What all triangles of the mesh share.
        let first = any_triangle(random);
        let axis = (random.bits() % 3) as usize;
        let level = whole(5, random);
        let scale = 10f32.powf(30.0 * random.signed());
        let offset = if random.unit() < 0.5 { [0.0; 3] } else { random.point().map(|x| x * scale * 1e3) };
        for i in 0..n {
            soup.push(match self.family {
                Family::Cubes | Family::Soup => any_triangle(random),
                Family::Lattice => [(); 3].map(|()| [(); 3].map(|()| whole(6, random))),
                Family::Slivers => {
                    let (a, b) = (random.point(), random.point());
                    [a, b, random.near(b, 1e-6)]
                }
                Family::Wild => [(); 3].map(|()| {
                    [0, 1, 2].map(|a| random.signed() * (-whole(20, random)).exp2() * scale + offset[a])
                }),
                Family::Identical => first,
                Family::Flat => [(); 3].map(|()| {
                    let mut p = [(); 3].map(|()| whole(9, random));
                    p[axis] = level;
                    p
                }),
                Family::Fan => [[0.25, 0.5, -0.125], random.point(), random.point()],
                Family::Nothing => {
                    let (a, d) = ([(); 3].map(|()| whole(9, random)), [(); 3].map(|()| whole(3, random)));
                    [a, [0, 1, 2].map(|k| a[k] + d[k]), [0, 1, 2].map(|k| a[k] + 2.0 * d[k])]
                }
                Family::Holes if i % 3 == 0 => {
                    let a = random.point();
                    [a, a, random.point()]
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
                    let a = random.near([0.0; 3], 0.3);
                    let b = a.map(|x| x + 1.0);
                    [a, b, random.near(b, 1e-2)]
                }
                Family::Far => any_triangle(random).map(|p| [p[0] + 1e6, p[1] - 1e6, p[2] + 1e6]),
            });
        }
        let triangles = (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        (soup.into_iter().flatten().collect(), triangles)
    }
}
