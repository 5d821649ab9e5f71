//! Which triangles of a mesh a point sees: those whose middle no other triangle hides.
//!
//! `cargo run --release --example visibility` looks at the teapot from above; name a mesh file to look at that instead.

use raykd::{BuildOptions, Device, Intersector, Mesh, Query, Ray, Scene};

fn main() -> anyhow::Result<()> {
    let mesh = std::env::args_os().nth(1).map_or(Ok(Mesh::teapot(8)), Mesh::load)?;
    let mut scene = Scene::build(&Device::best(), &mesh, &BuildOptions::default())?;
    // A triangle that only touches the line of sight hides; no rounding decides it.
    scene.intersect_by(Intersector::Exact)?;
    let (lo, hi) = mesh.bounds();
    let eye = [(lo[0] + hi[0]) / 2.0, (lo[1] + hi[1]) / 2.0, 2.0 * hi[2] - lo[2]];
    let sight = |&triangle: &u32| {
        let [a, b, c] = mesh.triangles()[triangle as usize].map(|vertex| mesh.positions()[vertex as usize]);
        let middle = [0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0);
        // The eye is at t = 1.
        Ray { t_max: 1.0, ..Ray::new(middle, [0, 1, 2].map(|i| eye[i] - middle[i])) }
    };
    let rays: Vec<Ray> = mesh.kept().iter().map(sight).collect();
    // Without the triangle that the ray starts on: any other hides it.
    let hits = scene.trace_except(Query::Any, &rays, mesh.kept())?.hits;
    let seen = hits.iter().filter(|hit| !hit.is_hit()).count();
    println!("{seen} of {} triangles are seen from {eye:?}", rays.len());
    Ok(())
}
