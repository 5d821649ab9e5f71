//! Which voxels are inside a mesh: by the crossings of lines through their centres.

use raykd::{Counted, Crossings, Error, Mesh, Ray, Scene, TraceTimes, mesh::MeshError};
use std::{borrow::Cow, ops::Range};

/// Cubes side by side, where the mesh is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// How many there are along each axis.
    pub counts: [usize; 3],
    /// Length of an edge of a voxel.
    pub size: f64,
    /// The lowest corner of the first.
    pub corner: [f64; 3],
    /// How many times larger than the given mesh the traced one is: for rays, coordinates below 2^-126 are 0.
    pub scale: f64,
}

/// What filling took.
#[derive(Debug, Default)]
pub(super) struct Spent {
    pub rays: u64,
    pub times: TraceTimes,
}

/// Voxels of a column that are still to be told: from the first to before the second.
struct Span {
    column: usize,
    voxels: Range<usize>,
    /// What lies ahead of the first, and of the one behind the last.
    ahead: [Crossings; 2],
}

impl Grid {
    /// So many voxels along the longest side of the mesh's box, and as many as are needed along the others, round its
    /// middle. Nothing if the box has no size.
    pub(super) fn around(mesh: &Mesh, most: usize) -> Option<Self> {
        let (lo, hi) = mesh.bounds();
        let [lo, hi] = [lo, hi].map(|end| end.map(f64::from));
        let sides = [0, 1, 2].map(|axis| hi[axis] - lo[axis]);
        let size = sides.into_iter().fold(0.0, f64::max) / most as f64;
        // A side may be a whole number of voxels but for rounding.
        let counts = sides.map(|side| ((side / size - 1e-9).ceil().max(1.0) as usize).min(most));
        let corner = [0, 1, 2].map(|axis| (lo[axis] + hi[axis] - size * counts[axis] as f64) / 2.0);
        (size > 0.0).then_some(Self { counts, size, corner, scale: f64::from(mesh.scale()).max(1.0) })
    }

    /// The mesh that the voxels of this one are asked of.
    pub(super) fn traced<'a>(&self, mesh: &'a Mesh) -> Result<Cow<'a, Mesh>, MeshError> {
        if self.scale == 1.0 {
            return Ok(Cow::Borrowed(mesh));
        }
        let positions = mesh.scaled_positions().as_chunks().0.to_vec();
        Ok(Cow::Owned(Mesh::new(positions, mesh.triangles().to_vec())?))
    }

    /// The middle of the voxel of this number in the traced mesh, rounded.
    pub(super) fn centre(&self, axis: usize, number: usize) -> f32 {
        ((self.corner[axis] + self.size * (number as f64 + 0.5)) * self.scale) as f32
    }

    /// Numbers along x of voxels that are filled at once, so that memory has a bound.
    pub(super) fn slabs(&self, voxels: usize) -> impl ExactSizeIterator<Item = Range<usize>> + use<> {
        let [x, y, z] = self.counts;
        let step = (voxels / (y * z)).max(1);
        (0..x).step_by(step).map(move |first| first..x.min(first + step))
    }

    /// 1 for each voxel whose centre has a winding number other than 0, else 0: z runs fastest, then y.
    ///
    /// A ray from each centre along z would count the crossings ahead. All rays of a column lie on one line, also as
    /// [`Scene::crossings`] moves their origins. So the count never rises from one centre to the next, and if it is the
    /// same for two, nothing is crossed between: all centres from one to the other have the same winding number.
    /// Columns are halved until that holds.
    pub(super) fn fill(&self, scene: &Scene, xs: Range<usize>, spent: &mut Spent) -> Result<Vec<u8>, Error> {
        let [_, height, depth] = self.counts;
        let columns = xs.len() * height;
        let mut voxels = vec![0; columns * depth];
        let mut ask = |spans: &mut dyn Iterator<Item = (usize, usize)>| -> Result<Vec<Crossings>, Error> {
            let ray = |(column, number)| {
                let [x, y] = [xs.start + column / height, column % height];
                Ray::new([self.centre(0, x), self.centre(1, y), self.centre(2, number)], [0.0, 0.0, 1.0])
            };
            let rays: Vec<Ray> = spans.map(ray).collect();
            let Counted { counts, times, .. } = scene.crossings(&rays)?;
            spent.rays += rays.len() as u64;
            spent.times += times;
            Ok(counts)
        };
        let first = ask(&mut (0..columns).map(|column| (column, 0)))?;
        // Behind the last voxel there is nothing.
        let whole = |(column, first)| Span { column, voxels: 0..depth, ahead: [first, Crossings::default()] };
        let mut spans: Vec<Span> = first.into_iter().enumerate().map(whole).collect();
        loop {
            spans.retain(|Span { column, voxels: Range { start, end }, ahead: [first, last] }| {
                let told = first == last || end - start == 1;
                if told && first.winding() != 0 {
                    voxels[column * depth..][*start..*end].fill(1);
                }
                !told
            });
            if spans.is_empty() {
                return Ok(voxels);
            }
            let middle = |span: &Span| span.voxels.start.midpoint(span.voxels.end);
            let found = ask(&mut spans.iter().map(|span| (span.column, middle(span))))?;
            let halves = |(span, found): (&Span, Crossings)| {
                let (middle, [first, last]) = (middle(span), span.ahead);
                [
                    Span { column: span.column, voxels: span.voxels.start..middle, ahead: [first, found] },
                    Span { column: span.column, voxels: middle..span.voxels.end, ahead: [found, last] },
                ]
            };
            spans = spans.iter().zip(found).flat_map(halves).collect();
        }
    }
}

/// The volume of a closed mesh by the divergence theorem: negative if its triangles are clockwise seen from outside.
pub(super) fn volume(mesh: &Mesh) -> f64 {
    let (lo, hi) = mesh.bounds();
    let middle = [0, 1, 2].map(|axis| (f64::from(lo[axis]) + f64::from(hi[axis])) / 2.0);
    let corner = |vertex: u32| {
        let p = mesh.positions()[vertex as usize];
        [0, 1, 2].map(|axis| f64::from(p[axis]) - middle[axis])
    };
    let six = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(corner);
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    mesh.triangles().iter().map(six).sum::<f64>() / 6.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use raykd::{
        BuildOptions, Device,
        rays::Random,
        stress::shapes::{Welded, cubes, icosphere, loose},
    };

    fn scene(mesh: &Mesh) -> Scene {
        Scene::build(&Device::cpu(), mesh, &BuildOptions::default()).unwrap()
    }

    /// All voxels, by slabs of so many.
    fn filled(grid: &Grid, scene: &Scene, voxels: usize) -> Vec<u8> {
        let mut spent = Spent::default();
        grid.slabs(voxels).flat_map(|xs| grid.fill(scene, xs, &mut spent).unwrap()).collect()
    }

    /// By the crossings of each centre alone: those along z, and for a closed mesh those along another axis too.
    fn one_by_one(grid: &Grid, scene: &Scene, closed: bool) -> Vec<u8> {
        let [x, y, z] = grid.counts;
        let centres = (0..x * y * z).map(|i| [i / (y * z), i / z % y, i % z]);
        let centres: Vec<_> = centres.map(|at| [0, 1, 2].map(|axis| grid.centre(axis, at[axis]))).collect();
        let along: Vec<Ray> = centres.iter().map(|&p| Ray::new(p, [0.0, 0.0, 1.0])).collect();
        let along: Vec<i32> = scene.crossings(&along).unwrap().counts.iter().map(|c| c.winding()).collect();
        if closed {
            assert_eq!(along, scene.winding(&centres).unwrap().counts);
        }
        along.into_iter().map(|winding| u8::from(winding != 0)).collect()
    }

    fn check(grid: &Grid, mesh: &Mesh, slab: usize) {
        let scene = scene(mesh);
        let found = filled(grid, &scene, slab);
        assert!(found == one_by_one(grid, &scene, mesh.edges().are_closed()), "{grid:?}");
    }

    /// A sphere whose triangles are counterclockwise seen from outside.
    fn sphere(level: u32) -> Mesh {
        let mesh = icosphere(level);
        let outward = |&[a, b, c]: &[u32; 3]| {
            let corners = [a, b, c].map(|v| mesh.positions()[v as usize]);
            let sum = |v: [f32; 3], w: [f32; 3]| (0..3).map(|i| v[i] * w[i]).sum::<f32>();
            let [p, q, r] = corners;
            let [v, w] = [q, r].map(|end| [0, 1, 2].map(|i| end[i] - p[i]));
            let normal = [v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]];
            if sum(p, normal) < 0.0 { [a, c, b] } else { [a, b, c] }
        };
        Mesh::new(mesh.positions().to_vec(), mesh.triangles().iter().map(outward).collect()).unwrap()
    }

    /// Centres at corners, on edges and in faces of cubes, of which many touch, and of cubes through each other.
    #[test]
    fn centres_on_the_surface_are_told_as_by_their_winding_number() {
        let grid = Grid { counts: [13, 14, 15], size: 0.5, corner: [-0.75; 3], scale: 1.0 };
        let mut random = Random::new(1);
        for count in [1, 7, 20, 40] {
            check(&grid, &cubes(count, &mut random).mesh(), 1);
        }
        let mut through = Welded::default();
        for corner in [[0.0, 0.0, 0.0], [0.5, 0.5, 0.5], [1.5, 0.0, 2.5], [1.5, 0.0, 3.0]] {
            through.cube(corner);
        }
        check(&grid, &through.mesh(), 1000);
    }

    /// Two cones: lines along the axis meet a vertex of forty triangles, others their edges.
    #[test]
    fn lines_through_vertices_of_many_triangles() {
        let on = |i: u32| {
            let turn = f64::from(i % 40) / 40.0 * std::f64::consts::TAU;
            [(4.0 * turn.cos()) as f32, (4.0 * turn.sin()) as f32, 0.0]
        };
        let cones = |i| [[on(i), on(i + 1), [0.0, 0.0, 3.0]], [on(i + 1), on(i), [0.0, 0.0, -2.0]]];
        let mesh = loose(&(0..40).flat_map(cones).collect::<Vec<_>>());
        check(
            &Grid { counts: [17, 17, 11], size: 0.5, corner: [-4.25, -4.25, -2.25], scale: 1.0 },
            &mesh,
            500,
        );
    }

    #[test]
    fn open_and_round_meshes() {
        for mesh in [sphere(3), Mesh::teapot(4)] {
            for most in [1, 2, 9, 40] {
                check(&Grid::around(&mesh, most).unwrap(), &mesh, 7000);
            }
        }
    }

    #[test]
    fn grids_hold_the_box_with_their_longest_side() {
        let mesh = |size: [f32; 3]| loose(&[[[0.0; 3], [size[0], 0.0, size[2]], [0.0, size[1], 0.0]]]);
        let grid = |size, most| Grid::around(&mesh(size), most).unwrap();
        assert_eq!(grid([3.0, 6.0, 1.0], 12).counts, [6, 12, 2]);
        assert_eq!(grid([3.0, 7.0, 0.1], 7).counts, [3, 7, 1]);
        let flat = grid([3.0, 0.5, 0.0], 4);
        assert_eq!((flat.counts, flat.size, flat.corner), ([4, 1, 1], 0.75, [0.0, -0.125, -0.375]));
        assert_eq!([flat.centre(0, 0), flat.centre(0, 3), flat.centre(2, 0)], [0.375, 2.625, 0.0]);
        let slabs: Vec<_> = grid([3.0, 6.0, 1.0], 12).slabs(60).collect();
        assert_eq!(slabs, [0..2, 2..4, 4..6]);
    }

    /// The voxels' volume is the mesh's, but for half a voxel along the surface at most.
    #[test]
    fn voxels_have_the_volume_of_the_mesh() {
        let mesh = sphere(4);
        assert!(mesh.edges().are_closed());
        let grid = Grid::around(&mesh, 64).unwrap();
        let inside = filled(&grid, &scene(&mesh), 1 << 20).iter().filter(|&&v| v == 1).count();
        let (voxels, exact) = (inside as f64 * grid.size.powi(3), volume(&mesh));
        assert!((voxels / exact - 1.0).abs() < 2e-3, "{voxels} {exact}");
        let mut cube = Welded::default();
        cube.cube([5.0, 6.0, 7.0]);
        assert_eq!(volume(&cube.mesh()).abs(), 1.0);
    }
}
