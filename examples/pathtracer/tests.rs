//! Rays that were made and counted on the GPU hit what they hit on a CPU.

use crate::{gpu, gpu::Gpu, tracer::Tracer};
use anyhow::Result;
use raykd::{BuildOptions, Device, Hit, Mesh, Ray, Scene, internals::hits_digest, rays::Camera};

const SIZE: [u32; 2] = [60, 40];
const SAMPLES: u32 = 2;
const PATHS: usize = 4800;

/// A wave of so many bounces: rays and hits of the last of them, and the picture.
fn wave(gpu: &Gpu, mesh: &Mesh, bounces: u32) -> Result<(Vec<Ray>, Vec<Hit>, Vec<u8>)> {
    let scene = Scene::build(&gpu.raykd, mesh, &BuildOptions::default())?;
    let mut tracer = Tracer::new(gpu, &scene, mesh.bounds(), SIZE, SAMPLES, bounces)?;
    tracer.look(gpu, &Camera::framing(mesh.bounds()));
    for encoded in tracer.wave(gpu, SAMPLES)?.encoded {
        assert_eq!(encoded.invalid()?, 0);
    }
    let counts: Vec<u32> = gpu.read(&tracer.counts)?;
    assert_eq!(tracer.traced(gpu)?, counts.iter().map(|&rays| u64::from(rays)).sum::<u64>());
    let last = bounces as usize - 1;
    let rays = counts[128 * last] as usize;
    let mut wave = (gpu.read(&tracer.rays[last % 2])?, gpu.read(&tracer.hits)?, gpu.read(&tracer.pixels)?);
    wave.0.truncate(rays);
    wave.1.truncate(rays);
    Ok(wave)
}

#[test]
fn hits_are_those_of_the_cpu() -> Result<()> {
    let gpu = Gpu::open(&gpu::adapter(&gpu::instance(None), None, None)?)?;
    let mesh = Mesh::teapot(6);
    let cpu = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default())?;
    for (bounces, some) in [(1, PATHS..=PATHS), (2, PATHS / 2..=PATHS), (3, PATHS / 50..=PATHS / 2)] {
        let (rays, hits, picture) = wave(&gpu, &mesh, bounces)?;
        assert!(some.contains(&rays.len()), "{} rays of bounce {bounces}", rays.len());
        assert_eq!(hits_digest(&cpu.closest(&rays)?), hits_digest(&hits), "bounce {bounces}");
        let hit = hits.iter().filter(|hit| hit.is_hit()).count();
        assert!(hit * 20 > hits.len() && hit < hits.len(), "{hit} of {} rays hit", hits.len());
        let mean = picture.iter().map(|&byte| u32::from(byte)).sum::<u32>() / picture.len() as u32;
        assert!((60..240).contains(&mean), "a picture of mean {mean}");
        // Rows are put together in no certain order, and the picture is the same.
        assert!(picture == wave(&gpu, &mesh, bounces)?.2, "two pictures of {bounces} bounces differ");
    }
    Ok(())
}
