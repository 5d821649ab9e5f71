//! A rust-gpu kernel of one's own that finds the closest hit of each ray, compared with raykd's: `nearest MODULE`,
//! with what `raykd-spirv compile shader MODULE` wrote.

#[path = "../gpu.rs"]
mod gpu;

use raykd::wgpu::{BufferUsages, util::BufferInitDescriptor, util::DeviceExt as _};
use raykd::{BuildOptions, Device, Hit, Mesh, Scene, rays::random};
use std::{env, error::Error, fs};

fn main() -> Result<(), Box<dyn Error>> {
    let module = env::args().nth(1).ok_or("usage: nearest MODULE")?;
    let spirv = fs::read(&module).map_err(|e| format!("{module}: {e}"))?;
    let mesh = Mesh::teapot(16);
    let rays = random(mesh.bounds(), 100_000, 1);

    let opened = gpu::open()?;
    let (device, queue) = &opened;
    let scene = Scene::build(&Device::from_wgpu(device, queue)?, &mesh, &BuildOptions::default())?;
    let (contents, usage) = (bytemuck::cast_slice(&rays), BufferUsages::STORAGE);
    let on_device = device.create_buffer_init(&BufferInitDescriptor { label: None, contents, usage });
    let of = scene.buffers()?;
    let kernel = gpu::Kernel::new(device, &spirv, "nearest::nearest", 5);
    let buffers = [of.header, of.nodes, of.corners, &on_device];
    let hits: Vec<Hit> = kernel.run(&opened, &buffers, rays.len() as u32)?;

    println!("{} of {} rays hit", hits.iter().filter(|hit| hit.is_hit()).count(), hits.len());
    let batch = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default())?.closest(&rays)?;
    assert!(
        bytemuck::cast_slice::<_, u8>(&hits) == bytemuck::cast_slice::<_, u8>(&batch),
        "other hits than raykd's"
    );
    println!("the same bytes as raykd's");
    Ok(())
}
