//! A scene of vertices and triangles in buffers of a wgpu program, rebuilt as they change. None of them passes the bus.
//!
//! `cargo run --release --example build_on`

use raykd::{BuildOptions, Device, Hit, Mesh, Query, Scene, wgpu};
use std::error::Error;
use wgpu::{BufferUsages as Use, util::DeviceExt as _, util::DownloadBuffer};

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

fn main() -> Result<(), Box<dyn Error>> {
    let (device, queue) = open()?;
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let mut mesh = Mesh::teapot(8);
    let vertices = bytemuck::cast_slice(mesh.positions());
    let positions = buffer(vertices, Use::STORAGE | Use::VERTEX | Use::COPY_DST);
    let indices = buffer(bytemuck::cast_slice(mesh.triangles()), Use::STORAGE | Use::INDEX);
    let rays = raykd::rays::random(mesh.bounds(), 10_000, 1);
    let on_device = buffer(bytemuck::cast_slice(&rays), Use::STORAGE);
    let hits = buffer(&vec![0; size_of::<Hit>() * rays.len()], Use::STORAGE | Use::COPY_SRC);

    let (raykd, options) = (Device::from_wgpu(&device, &queue)?.recycling(), BuildOptions::default());
    for _ in 0..3 {
        let scene = Scene::build_on(&raykd, positions.slice(..), indices.slice(..), &options)?;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        scene.encode(&mut encoder, Query::Closest, on_device.slice(..), hits.slice(..), rays.len() as u32)?;
        queue.submit([encoder.finish()]);
        // The same bytes as of the mesh on the CPU.
        let usual = Scene::build(&Device::cpu(), &mesh, &options)?.closest(&rays)?;
        DownloadBuffer::read_buffer(&device, &queue, &hits.slice(..), move |found| {
            let found: Vec<Hit> = bytemuck::pod_collect_to_vec(&found.expect("hits"));
            println!("{} of {} rays hit", found.iter().filter(|hit| hit.is_hit()).count(), found.len());
            assert!(bytemuck::cast_slice::<_, u8>(&usual) == bytemuck::cast_slice::<_, u8>(&found));
        });
        device.poll(wgpu::PollType::wait_indefinitely())?;
        // The next frame. A program of its own would move vertices by a shader.
        let moved: Vec<_> = mesh.positions().iter().map(|p| [p[0], 0.9 * p[1], p[2]]).collect();
        queue.write_buffer(&positions, 0, bytemuck::cast_slice(&moved));
        mesh = Mesh::new(moved, mesh.triangles().to_vec())?;
    }
    Ok(())
}

#[test]
fn it_runs() -> Result<(), Box<dyn Error>> {
    main()
}
