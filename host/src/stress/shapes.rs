//! Meshes by construction, closed ones above all.

use crate::{Mesh, rays::Random};
use std::collections::HashMap;

/// A position.
pub type Point = [f32; 3];

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

    /// Vertices and triangles.
    pub fn done(self) -> (Vec<Point>, Vec<[u32; 3]>) {
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

/// Unit cubes at random places of a small grid, at most one a place, with shared vertices.
pub fn cubes(count: u32, random: &mut Random) -> Welded {
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
    mesh
}

/// Triangles that share no vertices.
///
/// # Panics
/// There are none, or a corner is not finite.
pub fn loose(triangles: &[[Point; 3]]) -> Mesh {
    let numbers = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh::new(triangles.concat(), numbers).expect("a mesh")
}

/// The same triangles with each vertex changed.
///
/// # Panics
/// The new ones are no mesh.
pub fn moved(mesh: &Mesh, change: impl Fn(Point) -> Point) -> Mesh {
    let positions = mesh.positions().iter().map(|&p| change(p)).collect();
    Mesh::new(positions, mesh.triangles().to_vec()).expect("a mesh")
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
