//! Rays and hits in buffers of a wgpu program's own, traced in its own command encoder.
//!
//! `cargo run --release --example own_wgpu`

use raykd::{BuildOptions, Device, Hit, Mesh, Query, Ray, Scene, wgpu};
use std::error::Error;
use wgpu::{BufferUsages as Use, util::DeviceExt as _};

fn open() -> Result<(wgpu::Device, wgpu::Queue), Box<dyn Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    Ok(pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: raykd::required_features(),
        required_limits: raykd::required_limits(adapter.limits()),
        // SAFETY: raykd's kernels keep to their buffers.
        experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
        ..Default::default()
    }))?)
}

/// The hits of rays, by buffers that stay on the device until the last line.
fn trace(mesh: &Mesh, rays: &[Ray]) -> Result<Vec<Hit>, Box<dyn Error>> {
    let (device, queue) = open()?;
    let scene = Scene::build(&Device::from_wgpu(&device, &queue)?, mesh, &BuildOptions::default())?;
    let contents = bytemuck::cast_slice(rays);
    let init = wgpu::util::BufferInitDescriptor { label: Some("rays"), contents, usage: Use::STORAGE };
    let rays_buffer = device.create_buffer_init(&init);
    let buffer = |usage| wgpu::BufferDescriptor {
        label: Some("hits"),
        size: size_of::<Hit>() as u64 * rays.len() as u64,
        usage,
        mapped_at_creation: false,
    };
    let hits = device.create_buffer(&buffer(Use::STORAGE | Use::COPY_SRC));
    let read = device.create_buffer(&buffer(Use::COPY_DST | Use::MAP_READ));
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    scene.encode(&mut encoder, Query::Closest, rays_buffer.slice(..), hits.slice(..), rays.len() as u32)?;
    encoder.copy_buffer_to_buffer(&hits, 0, &read, 0, read.size());
    queue.submit([encoder.finish()]);
    read.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("mapped"));
    device.poll(wgpu::PollType::wait_indefinitely())?;
    Ok(bytemuck::pod_collect_to_vec(&read.slice(..).get_mapped_range()?))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mesh = Mesh::teapot(8);
    let rays = raykd::rays::random(mesh.bounds(), 100_000, 1);
    let hits = trace(&mesh, &rays)?;
    println!("{} of {} rays hit", hits.iter().filter(|hit| hit.is_hit()).count(), hits.len());
    // The same bytes as on the CPU.
    let cpu = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default())?.closest(&rays)?;
    assert!(bytemuck::cast_slice::<_, u8>(&cpu) == bytemuck::cast_slice::<_, u8>(&hits));
    Ok(())
}

#[test]
fn it_runs() -> Result<(), Box<dyn Error>> {
    main()
}
