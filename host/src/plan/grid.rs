//! How many triangles a ray meets in the leaves of a tree that ends early: about those in the cells of a grid.

use crate::{Mesh, Ray};

/// Triangles that are counted, of larger meshes.
const SAMPLE: usize = 1 << 16;

/// How many of a mesh's triangles have boxes that reach into each cell.
#[derive(Debug)]
pub(super) struct Grid {
    lo: [f32; 3],
    /// Cells of each axis, and the length of one.
    cells: [usize; 3],
    side: [f32; 3],
    counts: Vec<u32>,
    /// Triangles that a counted one stands for.
    each: f64,
}

impl Grid {
    /// Cells as a tree of this depth has leaves, if it always halves the longest axis.
    pub(super) fn new(mesh: &Mesh, depth: u32) -> Self {
        let (lo, hi) = mesh.bounds();
        let mut cells = [1; 3];
        let mut side: [f32; 3] = std::array::from_fn(|a| (hi[a] - lo[a]).max(f32::MIN_POSITIVE));
        for _ in 0..depth {
            let axis = (1..3).fold(0, |most, a| if side[a] > side[most] { a } else { most });
            cells[axis] *= 2;
            side[axis] /= 2.0;
        }
        let mut grid = Self { lo, cells, side, counts: vec![0; cells.iter().product()], each: 1.0 };
        let step = mesh.kept().len().div_ceil(SAMPLE).max(1);
        grid.each = step as f64;
        for &triangle in mesh.kept().iter().step_by(step) {
            let corners = mesh.triangles()[triangle as usize].map(|v| mesh.positions()[v as usize]);
            let [from, to] = [f32::min, f32::max].map(|pick| {
                let end = corners.into_iter().reduce(|p, q| std::array::from_fn(|a| pick(p[a], q[a])));
                grid.cell(end.unwrap_or(lo))
            });
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    let row = grid.number([from[0], y, z]);
                    grid.counts[row..=row + to[0] - from[0]].iter_mut().for_each(|count| *count += 1);
                }
            }
        }
        grid
    }

    fn cell(&self, point: [f32; 3]) -> [usize; 3] {
        std::array::from_fn(|a| (((point[a] - self.lo[a]) / self.side[a]) as usize).min(self.cells[a] - 1))
    }

    fn number(&self, cell: [usize; 3]) -> usize {
        cell[0] + self.cells[0] * (cell[1] + self.cells[1] * cell[2])
    }

    /// Triangles in the cells that a ray passes before it ends (Amanatides & Woo 1987).
    pub(super) fn passed(&self, ray: &Ray) -> f64 {
        // From where to where it is inside.
        let (mut enter, mut leave) = (ray.t_min.max(0.0), ray.t_max);
        let ends: [[f32; 2]; 3] = std::array::from_fn(|a| {
            let edges = [self.lo[a], self.lo[a] + self.side[a] * self.cells[a] as f32];
            let t = edges.map(|edge| (edge - ray.origin[a]) / ray.direction[a]);
            [t[0].min(t[1]), t[0].max(t[1])]
        });
        for [near, far] in ends {
            (enter, leave) = (enter.max(near), leave.min(far));
        }
        if enter > leave {
            return 0.0;
        }
        let mut cell = self.cell(std::array::from_fn(|a| ray.origin[a] + ray.direction[a] * enter));
        let mut seen = u64::from(self.counts[self.number(cell)]);
        loop {
            let next: [f32; 3] = std::array::from_fn(|a| {
                if ray.direction[a] == 0.0 {
                    return f32::INFINITY;
                }
                let edge = cell[a] + usize::from(ray.direction[a] > 0.0);
                (self.lo[a] + edge as f32 * self.side[a] - ray.origin[a]) / ray.direction[a]
            });
            let axis = (1..3).fold(0, |least, a| if next[a] < next[least] { a } else { least });
            let last = if ray.direction[axis] > 0.0 { self.cells[axis] - 1 } else { 0 };
            if next[axis] >= leave || cell[axis] == last {
                return seen as f64 * self.each;
            }
            cell[axis] = if ray.direction[axis] > 0.0 { cell[axis] + 1 } else { cell[axis] - 1 };
            seen += u64::from(self.counts[self.number(cell)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of `n` by `n` small triangles at z = 0, and one far above.
    fn wall(n: u32) -> Mesh {
        let mut positions = vec![[0.0, 0.0, 8.0], [1.0, 0.0, 8.0], [0.0, 1.0, 8.0]];
        for i in 0..n * n {
            let (x, y) = ((i % n) as f32, (i / n) as f32);
            positions.extend([[x, y, 0.0], [x + 0.5, y, 0.0], [x, y + 0.5, 0.0]]);
        }
        let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Mesh::new(positions, triangles).unwrap()
    }

    #[test]
    fn rays_pass_what_lies_in_their_cells() {
        // 15.5 x 15.5 x 8: eight halvings make 8 x 8 x 4 cells, and four triangles in each of the lowest.
        let grid = Grid::new(&wall(16), 8);
        assert_eq!(grid.cells, [8, 8, 4]);
        let passed = |origin, direction| grid.passed(&Ray::new(origin, direction));
        assert_eq!(passed([15.2, 15.2, 20.0], [0.0, 0.0, -1.0]), 4.0);
        assert_eq!(passed([0.3, 0.3, 20.0], [0.0, 0.0, -1.0]), 5.0);
        assert_eq!(passed([0.3, 0.3, 20.0], [0.0, 0.0, 1.0]), 0.0);
        assert_eq!(passed([-5.0, 0.3, 0.1], [1.0, 0.0, 0.0]), 32.0);
        assert_eq!(passed([30.0, 0.3, 0.1], [-1.0, 0.0, 0.0]), 32.0);
        assert_eq!(passed([30.0, 0.3, 3.0], [-1.0, 0.0, 0.0]), 0.0);
        // It ends before the lowest cells.
        let short = Ray { t_max: 17.0, ..Ray::new([0.3, 0.3, 20.0], [0.0, 0.0, -1.0]) };
        assert_eq!(grid.passed(&short), 1.0);
    }

    #[test]
    fn of_many_triangles_a_sample_is_counted() {
        let ray = Ray::new([-5.0, 150.2, 0.1], [1.0, 0.0, 0.0]);
        let [small, large] = [256, 512].map(|n| Grid::new(&wall(n), 4).passed(&ray) / f64::from(n * n));
        assert!((small / large - 1.0).abs() < 0.05, "{small} {large}");
    }
}
