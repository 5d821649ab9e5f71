//! The smallest use of raykd: a mesh, its tree, some rays, their hits.
//!
//! `cargo run --release --example minimal` traces the teapot; name a mesh file to trace that instead.

use raykd::{BuildOptions, Device, Mesh, Ray, Scene};
use std::{error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    // From a file, built in, or from your own vertices and triangles: `Mesh::new(vertices, indices)`.
    let mesh = match std::env::args().nth(1) {
        Some(file) => Mesh::load(Path::new(&file))?,
        None => Mesh::teapot(8),
    };

    // A GPU if there is one, else the CPU: the hits are the same to the last bit.
    let device = Device::best();
    let scene = Scene::build(&device, &mesh, &BuildOptions::default())?;
    println!("{} triangles on {}: {} nodes", mesh.triangles().len(), device.name(), scene.header().nodes);

    // A row of rays along z through the middle of the mesh.
    let (lo, hi) = mesh.bounds();
    let rays: Vec<Ray> = (1..10u8)
        .map(|i| {
            let x = lo[0] + (hi[0] - lo[0]) * f32::from(i) / 10.0;
            Ray::new([x, (lo[1] + hi[1]) / 2.0, hi[2] + 1.0], [0.0, 0.0, -1.0])
        })
        .collect();
    for (ray, hit) in rays.iter().zip(scene.closest(&rays)?) {
        if hit.is_hit() {
            println!("x = {:6.2}: triangle {} at t = {}", ray.origin[0], hit.triangle, hit.t);
        } else {
            println!("x = {:6.2}: nothing", ray.origin[0]);
        }
    }
    Ok(())
}
