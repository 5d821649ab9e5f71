//! A rust-gpu kernel of one's own that traces rays through a scene of raykd: on a GPU, and as a function on the CPU.
//!
//! `own_kernel MODULE PICTURE`: what `raykd-spirv compile shader MODULE` wrote, and a PGM picture to be written.

mod gpu;

use ambient::{CUT_SHORT, RAYS, Seen, look};
use raykd::single::{LeafTriangle, Tree, lay_out};
use raykd::wgpu::{BufferUsages, util::BufferInitDescriptor, util::DeviceExt as _};
use raykd::{BuildOptions, Device, Mesh, Ray, Scene, rays::Camera};
use std::{env, error::Error, fs, time::Instant};

/// Pixels a side of the picture.
const SIDE: u32 = 256;

/// What the kernel writes for the rays.
fn on_gpu(spirv: &[u8], mesh: &Mesh, rays: &[Ray]) -> Result<Vec<Seen>, Box<dyn Error>> {
    let opened = gpu::open()?;
    let (device, queue) = &opened;
    let scene = Scene::build(&Device::from_wgpu(device, queue)?, mesh, &BuildOptions::default())?;
    let contents = bytemuck::cast_slice(rays);
    let init = BufferInitDescriptor { label: None, contents, usage: BufferUsages::STORAGE };
    let rays_buffer = device.create_buffer_init(&init);
    let of = scene.buffers()?;
    let buffers = [of.header, of.nodes, of.corners, of.positions, of.indices, &rays_buffer];
    let kernel = gpu::Kernel::new(device, spirv, "ambient", 7);
    let start = Instant::now();
    let seen: Vec<Seen> = kernel.run(&opened, &buffers, rays.len() as u32)?;
    println!("{} points, {RAYS} rays each, in {:?}", rays.len(), start.elapsed());
    // The hits of raykd's own kernel.
    assert!(seen.iter().map(|seen| seen.hit).eq(scene.closest(rays)?), "other hits than raykd's");
    Ok(seen)
}

/// The same function on the CPU, ray by ray.
fn on_cpu(mesh: &Mesh, rays: &[Ray]) -> Result<Vec<Seen>, Box<dyn Error>> {
    let tree = Scene::build(&Device::cpu(), mesh, &BuildOptions::default())?.tree()?;
    let mut leaves = vec![LeafTriangle::default(); tree.view().refs.len()];
    lay_out(tree.view(), mesh.positions(), mesh.triangles(), &mut leaves).ok_or("not this mesh")?;
    let tree = Tree::new(tree.view(), &leaves).ok_or("not a tree")?;
    let (positions, indices) = (mesh.scaled_positions(), mesh.triangles().as_flattened());
    Ok(rays.iter().zip(0..).map(|(ray, i)| look(&tree, &positions, indices, ray, i)).collect())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = env::args().skip(1);
    let (Some(module), Some(picture)) = (paths.next(), paths.next()) else {
        return Err("usage: own_kernel MODULE PICTURE".into());
    };
    let spirv = fs::read(&module).map_err(|e| format!("{module}: {e}"))?;
    if !spirv.starts_with(&0x0723_0203u32.to_le_bytes()) || spirv.len() % 4 != 0 {
        return Err(format!("{module}: not a SPIR-V module").into());
    }
    let mesh = Mesh::teapot(16);
    let rays = Camera::framing(mesh.bounds()).rays(SIDE, SIDE);
    let seen = on_gpu(&spirv, &mesh, &rays)?;
    if seen.iter().any(|seen| seen.open == CUT_SHORT) {
        return Err("the driver left a loop early: give it fewer rays a point".into());
    }
    let on_cpu = on_cpu(&mesh, &rays)?;
    assert!(
        bytemuck::cast_slice::<_, u8>(&seen) == bytemuck::cast_slice::<_, u8>(&on_cpu),
        "GPU and CPU differ"
    );
    println!("the same bytes on the CPU");
    let mut pgm = format!("P5 {SIDE} {SIDE} 255\n").into_bytes();
    pgm.extend(seen.iter().map(|seen| (seen.open * 255 / RAYS) as u8));
    Ok(fs::write(picture, pgm)?)
}
