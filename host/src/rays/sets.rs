//! The rays by which raykd is compared with other ray tracers.

use super::{Camera, ball_around, bounces, light, random, shadows};
use crate::{Hit, Mesh, Ray, mesh::MeshSource};

/// Random rays in set a.
const RANDOM: usize = 50_000;
/// Width and height of set b's picture.
const PICTURE: u32 = 1024;
/// Where `t` ends in sets a to c, in half diagonals of the mesh's box.
const REACH: f64 = 100.0;

/// Four sets of rays through one mesh, the same on every machine.
#[derive(Clone, Debug)]
pub struct Sets {
    /// 50,000 from the sphere around the box to uniform points of the box.
    pub a: Vec<Ray>,
    /// Pixel centres of a picture of 1024 x 1024.
    pub b: Vec<Ray>,
    /// A cosine-distributed bounce from every hit of b, lifted off the surface by 1e-5 of the diagonal.
    pub c: Vec<Ray>,
    /// From the same points to uniform points of a ball light, ending just short of it.
    pub d: Vec<Ray>,
}

impl Sets {
    /// The sets of a scene of this name; `closest` finds the hits of b.
    ///
    /// # Errors
    /// Those of `closest`.
    pub fn new<E>(
        name: &str,
        mesh: &Mesh,
        closest: impl FnOnce(&[Ray]) -> Result<Vec<Hit>, E>,
    ) -> Result<Self, E> {
        let (camera, (light, radius)) = view(name, mesh);
        let (_, half) = ball_around(mesh.bounds());
        let t_max = (REACH * half) as f32;
        let ending = |rays: Vec<Ray>| rays.into_iter().map(|ray| Ray { t_max, ..ray }).collect::<Vec<_>>();
        let b = ending(camera.rays(PICTURE, PICTURE));
        let hits = closest(&b)?;
        Ok(Self {
            a: ending(random(mesh.bounds(), RANDOM, 1)),
            c: ending(bounces(mesh, &b, &hits, 2)),
            d: shadows(mesh, &b, &hits, light, radius, 3),
            b,
        })
    }
}

/// Camera, and centre and radius of the light: fixed ones for the scenes with names.
fn view(name: &str, mesh: &Mesh) -> (Camera, ([f64; 3], f64)) {
    let camera = |eye, target, fov| Camera { eye, target, up: [0.0, 1.0, 0.0], fov };
    match name.parse() {
        Ok(MeshSource::Teapot(_)) => {
            (camera([14.501, 10.358, 41.431], [0.0; 3], 40.0), ([-22.608, 37.681, 26.376], 3.075))
        }
        Ok(MeshSource::Fetched { name: "sponza", .. }) => {
            (camera([-11.5, 2.2, -0.6], [5.0, 2.6, 0.3], 70.0), ([0.0, 11.0, 0.0], 0.6))
        }
        Ok(MeshSource::Fetched { .. }) => (
            camera([0.08852, 0.19238, 0.26510], [-0.00588, 0.12495, -0.00460], 40.0),
            ([-0.15305, 0.37024, 0.16710], 0.02),
        ),
        _ => (Camera::framing(mesh.bounds()), light(mesh.bounds())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Device, Error, Scene};

    #[test]
    fn sets_of_the_teapot() -> Result<(), Error> {
        let (device, mesh) = (Device::cpu(), Mesh::teapot(4));
        let scene = Scene::build(&device, &mesh, &Default::default())?;
        let sets = Sets::new("teapot", &mesh, |rays| scene.closest(rays))?;
        let seen = scene.closest(&sets.b)?.iter().filter(|hit| hit.is_hit()).count();
        assert_eq!([sets.a.len(), sets.b.len()], [RANDOM, 1 << 20]);
        assert_eq!([sets.c.len(), sets.d.len()], [seen; 2]);
        // The camera has the teapot before it.
        assert!((100_000..700_000).contains(&seen), "{seen}");
        Ok(())
    }
}
