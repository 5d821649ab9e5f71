//! A quick look at a mesh: how many steps a ray of the usual kind takes there, in a coarse copy of it.

use super::{choice::HALFWAY, cost::usual_rays, grid::Grid};
use crate::{BuildOptions, Builder, Device, Error, Hit, Mesh, Ray, Scene, Stepped, Traversal, rays::Camera};
use raykd_kernels::{
    glam::Vec3,
    trace::{
        frame::Frame,
        intersect::{Intersector as _, strict::Strict},
    },
};
use raykd_shared::TreeHeader;
use std::{
    cell::OnceCell,
    collections::{HashMap, HashSet},
};

/// Meshes of so many triangles are looked at as they are.
const UNSIMPLIFIED: usize = 1024;
/// How closely to look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    /// Cells of the coarse grid along the longest axis.
    cells: f32,
    /// Milliseconds of a job that is worth a look, without those of [`Self::from_each_ms`]. Together they are ten times
    /// what the look takes.
    pub from_ms: f64,
    /// The same for each triangle.
    pub from_each_ms: f64,
}

/// From a glance to a closer look.
pub(super) const LOOKS: [Look; 2] = [
    Look { cells: 20.0, from_ms: 30.0, from_each_ms: 4e-4 },
    Look { cells: 40.0, from_ms: 100.0, from_each_ms: 4e-4 },
];

/// Rays whose steps are counted.
const RAYS: usize = 1024;

/// What a look shows of a usual ray.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Seen {
    /// Nodes, leaves and tests in an exact tree of the coarse copy, and one more for the start.
    pub whole: f64,
    /// [`Self::whole`], and the triangles in the leaves that it would meet in a tree that ends halfway down.
    pub halfway: f64,
    /// Nodes of eight boxes and tests there, and one more for the start.
    pub wide: f64,
}

/// A mesh that is looked at, perhaps more than once.
#[derive(Debug)]
pub(super) struct Looking<'m> {
    mesh: &'m Mesh,
    grid: OnceCell<Grid>,
}

impl<'m> Looking<'m> {
    pub(super) const fn at(mesh: &'m Mesh) -> Self {
        Self { mesh, grid: OnceCell::new() }
    }

    /// Sends rays through an exact tree of a coarse copy of the mesh, and as far through a grid of its triangles,
    /// on the CPU.
    pub(super) fn seen(&self, look: &Look) -> Result<Seen, Error> {
        let device = Device::cpu();
        let coarse = coarse(self.mesh, look.cells);
        let options = BuildOptions { builder: Builder::Exact, ..BuildOptions::default() };
        let mut scene = Scene::build(&device, &coarse, &options)?;
        let rays = usual_rays(&coarse, RAYS, |rays| scene.closest(rays))?;
        let Stepped { hits, steps, .. } = scene.steps(&rays)?;
        let mean = |sum: f64| sum / rays.len().max(1) as f64;
        let whole = 1.0 + mean(steps.iter().map(|s| f64::from(s.inner + s.leaves + s.tests)).sum());
        let grid = self.grid.get_or_init(|| Grid::new(self.mesh, HALFWAY));
        let end = |ray: &Ray, hit: &Hit| if hit.is_hit() { hit.t } else { ray.t_max };
        let ended = rays.iter().zip(&hits).map(|(ray, hit)| Ray { t_max: end(ray, hit), ..*ray });
        let halfway = whole + mean(ended.map(|ray| grid.passed(&ray)).sum());
        scene.traverse_by(Traversal::Wide)?;
        let Stepped { steps, .. } = scene.steps(&rays)?;
        let wide = 1.0 + mean(steps.iter().map(|s| f64::from(s.inner + s.tests)).sum());
        Ok(Seen { whole, halfway, wide })
    }
}

/// Triangles and rays that [`through`] takes: some microseconds.
const SAMPLE: usize = 256;
const GLANCES: u32 = 3;
/// Larger meshes need no such look: without a tree they are slow either way.
const FEW: usize = 1 << 13;

/// The share of triangles that the cheap part of the test lets through, though rays pass most of them by: those
/// that are tiny as seen from where rays start.
pub(super) fn through(mesh: &Mesh) -> f64 {
    let kept = mesh.kept();
    if kept.is_empty() || kept.len() > FEW {
        return 1.0;
    }
    let (lo, hi) = mesh.scaled_bounds();
    let header = TreeHeader { scale: mesh.scale(), lo, hi, ..bytemuck::Zeroable::zeroed() };
    let positions = mesh.scaled_positions();
    let corner = |v: u32| Vec3::from_slice(&positions[3 * v as usize..]);
    let step = kept.len().div_ceil(SAMPLE);
    let (mut all, mut passed) = (0u32, 0u32);
    for ray in Camera::framing(mesh.bounds()).rays(GLANCES, GLANCES) {
        let frame = Frame::of(&ray, &header);
        for &t in kept.iter().step_by(step) {
            let [a, b, c] = mesh.triangles()[t as usize].map(corner);
            all += 1;
            passed += u32::from(Strict.look(&frame, Strict::lay_out(a, b, c)).1);
        }
    }
    f64::from(passed) / f64::from(all.max(1))
}

/// The mesh with its vertices moved to the middles of coarse cells (Rossignac & Borrel 1993), which leaves few
/// triangles but no holes: what hid others still does. A small mesh as it is.
fn coarse(mesh: &Mesh, cells: f32) -> Mesh {
    if mesh.kept().len() <= UNSIMPLIFIED {
        return mesh.clone();
    }
    let (lo, hi) = mesh.bounds();
    let longest = (0..3).map(|a| hi[a] - lo[a]).fold(f32::MIN_POSITIVE, f32::max);
    let cell = |v: u32| -> [u32; 3] {
        let point = mesh.positions()[v as usize];
        std::array::from_fn(|a| ((point[a] - lo[a]) / longest * cells) as u32)
    };
    let (mut numbers, mut positions) = (HashMap::new(), Vec::new());
    let (mut seen, mut triangles) = (HashSet::new(), Vec::new());
    for &triangle in mesh.kept() {
        let at = mesh.triangles()[triangle as usize].map(cell);
        if at[0] == at[1] || at[1] == at[2] || at[2] == at[0] {
            continue;
        }
        let corners = at.map(|cell| {
            *numbers.entry(cell).or_insert_with(|| {
                positions.push(std::array::from_fn(|a| lo[a] + (cell[a] as f32 + 0.5) / cells * longest));
                positions.len() as u32 - 1
            })
        });
        let mut sorted = corners;
        sorted.sort_unstable();
        if seen.insert(sorted) {
            triangles.push(corners);
        }
    }
    // A crowd of triangles each smaller than a cell leaves nothing.
    Mesh::new(positions, triangles).unwrap_or_else(|_| mesh.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_copies_are_small_and_hide_as_much() {
        let mesh = Mesh::teapot(60);
        let coarse = coarse(&mesh, 20.0);
        assert!((300..6000).contains(&coarse.kept().len()), "{}", coarse.kept().len());
        let seen = |scene: &Mesh| {
            let device = Device::cpu();
            let scene = Scene::build(&device, scene, &BuildOptions::default()).unwrap();
            let rays = crate::rays::Camera::framing(mesh.bounds()).rays(64, 64);
            scene.closest(&rays).unwrap().iter().filter(|hit| hit.is_hit()).count() as f64
        };
        assert!((seen(&coarse) / seen(&mesh) - 1.0).abs() < 0.1, "{} {}", seen(&coarse), seen(&mesh));
    }

    #[test]
    fn tiny_triangles_are_let_through() {
        let teapot = Mesh::teapot(2);
        assert!(through(&teapot) < 0.1, "{}", through(&teapot));
        let mut positions: Vec<_> = teapot.positions().iter().map(|p| p.map(|x| x * 1e-7)).collect();
        positions.extend([[-50.0, 0.0, -50.0], [50.0, 0.0, -50.0], [0.0, 0.0, 50.0]]);
        let last = positions.len() as u32 - 3;
        let mut triangles = teapot.triangles().to_vec();
        triangles.push([last, last + 1, last + 2]);
        let stadium = Mesh::new(positions, triangles).unwrap();
        assert!(through(&stadium) > 0.5, "{}", through(&stadium));
        assert_eq!(through(&Mesh::teapot(60)), 1.0, "not looked at");
    }

    #[test]
    fn rays_that_miss_pass_triangles_too() {
        let mut random = crate::rays::Random::new(1);
        let mut positions = Vec::new();
        for _ in 0..1000 {
            let [x, y, z] = [(); 3].map(|()| random.unit() as f32);
            positions.extend([[x, y, z], [x + 1e-3, y, z], [x, y + 1e-3, z]]);
        }
        let triangles = (0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let dust = Mesh::new(positions, triangles).unwrap();
        // A cube of 16 cells a side: a ray through it passes the triangles of as many cells, of 4096.
        let seen = Looking::at(&dust).seen(&LOOKS[0]).unwrap();
        assert!((1.0..8.0).contains(&(seen.halfway - seen.whole)), "{seen:?}");
    }

    /// Boxes around large triangles hold much that is empty, and overlap.
    #[test]
    fn large_triangles_suit_trees() {
        let mut random = crate::rays::Random::new(1);
        let positions = (0..3 * 500).map(|_| [(); 3].map(|()| random.unit() as f32)).collect();
        let large = Mesh::new(positions, (0..500).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()).unwrap();
        for look in &LOOKS {
            let [large, small] = [&large, &Mesh::teapot(20)].map(|mesh| {
                let seen = Looking::at(mesh).seen(look).unwrap();
                seen.wide / seen.whole
            });
            assert!(large > 1.5 * small, "{large} {small}");
        }
    }

    #[test]
    fn a_crowd_takes_more_steps_than_a_wall() {
        let wall = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.1]], vec![[0, 1, 2]]).unwrap();
        for look in &LOOKS {
            let [crowd, wall] = [&Mesh::teapot(20), &wall].map(|mesh| Looking::at(mesh).seen(look).unwrap());
            assert!(
                crowd.whole > 2.0 * wall.whole && crowd.halfway > 5.0 * wall.halfway,
                "{crowd:?} {wall:?}"
            );
        }
    }
}
