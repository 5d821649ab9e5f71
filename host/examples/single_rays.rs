//! One ray at a time, from four threads: how thick is a teapot?
//!
//! `cargo run --release --example single_rays`

use raykd::{BuildOptions, Device, Error, Mesh, Ray, Scene, Tracer};
use std::ops::ControlFlow;

/// The way between the first and the second crossing of a line.
fn thickness(tracer: &Tracer, ray: &Ray) -> Option<f32> {
    let mut first = None;
    let found = tracer.for_each_hit(ray, |hit| match first.replace(hit.t) {
        // Two triangles that share an edge may both be hit there, at the same distance.
        Some(before) if hit.t > before => ControlFlow::Break(hit.t - before),
        _ => ControlFlow::Continue(()),
    });
    found.expect("the default triangle test finds all hits").break_value()
}

fn thickest(mesh: &Mesh, threads: u32) -> Result<f32, Error> {
    let tracer = Scene::build(&Device::cpu(), mesh, &BuildOptions::default())?.tracer()?;
    let (lo, hi) = mesh.bounds();
    let row = |y: u32| {
        let at = |axis: usize, step: u32| lo[axis] + (hi[axis] - lo[axis]) * step as f32 / 64.0;
        let rays = (0..64).map(move |x| Ray::new([at(0, x), at(1, y), lo[2] - 1.0], [0.0, 0.0, 1.0]));
        rays.filter_map(|ray| thickness(&tracer, &ray)).fold(0.0, f32::max)
    };
    Ok(std::thread::scope(|scope| {
        let of =
            |thread| scope.spawn(move || (thread..64).step_by(threads as usize).map(row).fold(0.0, f32::max));
        let all: Vec<_> = (0..threads).map(of).collect();
        all.into_iter().map(|thread| thread.join().expect("no panic")).fold(0.0, f32::max)
    }))
}

fn main() -> Result<(), Error> {
    println!("the teapot is {} thick at most", thickest(&Mesh::teapot(8), 4)?);
    Ok(())
}

#[test]
fn threads_agree() -> Result<(), Error> {
    let mesh = Mesh::teapot(4);
    assert_eq!(thickest(&mesh, 1)?.to_bits(), thickest(&mesh, 4)?.to_bits());
    assert!(thickest(&mesh, 4)? > 0.0);
    // The same bytes as by the batch.
    let scene = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default())?;
    let (rays, tracer) = (raykd::rays::random(mesh.bounds(), 1000, 1), scene.tracer()?);
    let alone: Vec<_> = rays.iter().map(|ray| tracer.closest(ray).unwrap_or(raykd::Hit::NONE)).collect();
    let batch = scene.closest(&rays)?;
    assert_eq!(bytemuck::cast_slice::<_, u8>(&alone), bytemuck::cast_slice::<_, u8>(&batch));
    Ok(())
}
