//! A quick look at a mesh: how many steps a ray of the usual kind takes there, in a coarse copy of it.

use super::usual_rays;
use crate::{BuildOptions, Builder, Device, Error, Mesh, Scene};
use std::collections::{HashMap, HashSet};

/// Meshes of so many triangles are looked at as they are.
const SMALL: usize = 1024;
/// Cells of the coarse grid along the longest axis.
const CELLS: f32 = 20.0;
/// Rays.
const RAYS: usize = 1024;
/// Cost of a triangle test in steps.
const TEST: f64 = 2.0;

/// Mean steps and tests of a usual ray through an exact tree of a coarse copy of the mesh, on the CPU.
pub(super) fn steps(mesh: &Mesh) -> Result<f64, Error> {
    let device = Device::cpu();
    let coarse = coarse(mesh);
    let options = BuildOptions { builder: Builder::Exact, ..BuildOptions::default() };
    let scene = Scene::build(&device, &coarse, &options)?;
    let rays = usual_rays(&coarse, RAYS, |rays| scene.closest(rays))?;
    let (_, steps) = scene.steps(&rays)?;
    let all: f64 = steps.iter().map(|s| f64::from(s.inner + s.leaves) + TEST * f64::from(s.tests)).sum();
    Ok(all / rays.len().max(1) as f64)
}

/// The mesh with its vertices moved to the middles of coarse cells (Rossignac & Borrel 1993), which leaves few triangles
/// but no holes: what hid others still does. A small mesh as it is.
fn coarse(mesh: &Mesh) -> Mesh {
    if mesh.kept().len() <= SMALL {
        return mesh.clone();
    }
    let (lo, hi) = mesh.bounds();
    let longest = (0..3).map(|a| hi[a] - lo[a]).fold(f32::MIN_POSITIVE, f32::max);
    let cell = |v: u32| -> [u32; 3] {
        let point = mesh.positions()[v as usize];
        std::array::from_fn(|a| ((point[a] - lo[a]) / longest * CELLS) as u32)
    };
    let (mut numbers, mut positions) = (HashMap::new(), Vec::new());
    let (mut seen, mut triangles) = (HashSet::new(), Vec::new());
    for &triangle in mesh.kept() {
        let cells = mesh.triangles()[triangle as usize].map(cell);
        if cells[0] == cells[1] || cells[1] == cells[2] || cells[2] == cells[0] {
            continue;
        }
        let corners = cells.map(|cell| {
            *numbers.entry(cell).or_insert_with(|| {
                positions.push(std::array::from_fn(|a| lo[a] + (cell[a] as f32 + 0.5) / CELLS * longest));
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
        let coarse = coarse(&mesh);
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
    fn a_crowd_takes_more_steps_than_a_wall() {
        let wall = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.1]], vec![[0, 1, 2]]).unwrap();
        assert!(steps(&Mesh::teapot(20)).unwrap() > 3.0 * steps(&wall).unwrap());
    }
}
