//! The walk in WGSL, for shaders of somebody else's, finds what raykd finds.

use raykd::{
    BuildOptions, Device, Hit, Mesh, Query, Ray, Scene, WGSL,
    rays::{Camera, random},
    wgpu,
};
use raykd_tests::{Failure, cpu, meshes::icosphere};
use std::sync::LazyLock;
use wgpu::{BufferUsages as Use, util::DeviceExt as _};

/// Traces a buffer of rays.
const SHADER: &str = "
@group(0) @binding(0) var<storage> rays: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> hits: array<vec4u>;
override any: bool;

@compute @workgroup_size(64)
fn trace(@builtin(global_invocation_id) id: vec3u) {
    if 2u * id.x < arrayLength(&rays) {
        let first = rays[2u * id.x];
        let second = rays[2u * id.x + 1u];
        let ray = RaykdRay(first.xyz, second.z, vec3f(first.w, second.xy), second.w);
        var hit: RaykdHit;
        if any { hit = raykd_any(ray); } else { hit = raykd_closest(ray); }
        hits[id.x] = vec4u(hit.triangle, bitcast<u32>(hit.t), bitcast<u32>(hit.u), bitcast<u32>(hit.v));
    }
}";

/// The hits that a shader finds.
fn by_shader(scene: &Scene, query: Query, rays: &[Ray]) -> Result<Vec<Hit>, Failure> {
    let (device, queue) = scene.device().wgpu().expect("a GPU");
    let source = wgpu::ShaderSource::Wgsl(format!("{WGSL}{SHADER}").into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("trace"),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: &[("any", f64::from(u8::from(query == Query::Any)))],
            ..Default::default()
        },
        cache: None,
    });
    let contents = bytemuck::cast_slice(rays);
    let descriptor = wgpu::util::BufferInitDescriptor { label: None, contents, usage: Use::STORAGE };
    let input = device.create_buffer_init(&descriptor);
    let buffer = |usage| {
        let size = size_of_val(rays) as u64 / 2;
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    };
    let (hits, read) = (buffer(Use::STORAGE | Use::COPY_SRC), buffer(Use::COPY_DST | Use::MAP_READ));
    let bind = |group: u32, buffers: &[&wgpu::Buffer]| {
        let resources = buffers.iter().map(|buffer| buffer.as_entire_binding());
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let layout = &pipeline.get_bind_group_layout(group);
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    };
    let tree = scene.buffers()?;
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &bind(0, &[&input, &hits]), &[]);
    pass.set_bind_group(1, &bind(1, &[tree.header, tree.nodes, tree.corners]), &[]);
    pass.dispatch_workgroups((rays.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    encoder.copy_buffer_to_buffer(&hits, 0, &read, 0, read.size());
    queue.submit([encoder.finish()]);
    read.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("mapped"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("it goes on");
    Ok(bytemuck::pod_collect_to_vec(&read.slice(..).get_mapped_range().expect("mapped")))
}

/// Scenes on the device of the tests.
static GPU: LazyLock<Device> = LazyLock::new(|| Device::gpu(None).expect("a Vulkan device"));

/// Compares both queries. Of a million rays `most` may hit a neighbour, where they pass an edge within rounding. Of two
/// triangles with the same corners in another order either may be hit.
fn compare(name: &str, mesh: &Mesh, rays: &[Ray], most: usize) -> Result<(), Failure> {
    let build = |device: &Device| Scene::build(device, mesh, &BuildOptions::default());
    let (cpu, gpu) = (build(cpu())?, build(&GPU)?);
    let expected = cpu.closest(rays)?;
    let found = by_shader(&gpu, Query::Closest, rays)?;
    let corners = |hit: &Hit| {
        let triangle = mesh.triangles().get(hit.triangle as usize)?;
        let mut corners = triangle.map(|vertex| mesh.positions()[vertex as usize].map(f32::to_bits));
        corners.sort_unstable();
        Some(corners)
    };
    let (mut twins, mut others) = (0, 0);
    for ((ray, a), b) in rays.iter().zip(&expected).zip(&found) {
        if a.triangle != b.triangle {
            let twin = corners(a) == corners(b);
            twins += usize::from(twin);
            others += usize::from(!twin);
        }
        let near = (a.t - b.t).abs() <= 1e-5 * a.t.abs().max(b.t.abs());
        let same = (a.u - b.u).abs().max((a.v - b.v).abs()) < 2e-3;
        if a.triangle == b.triangle && !(near && same) {
            return Err(Failure(format!("{name}: {ray:?} hits {b:?} instead of {a:?}")));
        }
    }
    let bits = expected.iter().zip(&found).filter(|(a, b)| a.t.to_bits() != b.t.to_bits()).count();
    let of = rays.len();
    println!("{name}: of {of} rays {others} hit another triangle, {twins} its twin, {bits} have another t");
    if others * 1_000_000 > most * rays.len() {
        return Err(Failure(format!("{name}: {others} of {} rays hit another triangle", rays.len())));
    }
    let any = by_shader(&gpu, Query::Any, rays)?;
    let wrong = any.iter().zip(&expected).filter(|(a, b)| a.is_hit() != b.is_hit()).count();
    if wrong * 1_000_000 > most * rays.len() {
        return Err(Failure(format!("{name}: {wrong} of {} rays differ in whether they hit", rays.len())));
    }
    Ok(())
}

/// Of a million rays.
const FEW: usize = 5;

#[test]
fn a_million_rays_through_the_teapot() -> Result<(), Failure> {
    let mesh = Mesh::teapot(8);
    compare("teapot", &mesh, &random(mesh.bounds(), 1_000_000, 1), FEW)
}

#[test]
fn a_million_rays_through_a_sphere() -> Result<(), Failure> {
    let mesh = icosphere(5);
    compare("sphere", &mesh, &random(mesh.bounds(), 1_000_000, 2), FEW)
}

/// Directions along axes and in planes, ranges of `t`, other units, and invalid rays.
#[test]
fn rays_with_zeros_ranges_and_other_lengths() -> Result<(), Failure> {
    let mesh = Mesh::teapot(6);
    let camera = Camera::framing(mesh.bounds());
    let mut rays = camera.rays(100, 100);
    let (lo, hi) = mesh.bounds();
    for i in 0..3000u32 {
        let part = |k: u32| (i * k % 997) as f32 / 997.0;
        let mut origin = [0, 1, 2].map(|a| lo[a] + (hi[a] - lo[a]) * part([7, 31, 101][a]));
        let mut direction = [0.0; 3];
        let axis = i as usize % 3;
        (origin[axis], direction[axis]) = (-50.0, 1.0);
        direction[(axis + 1) % 3] = if i % 2 == 0 { 0.0 } else { -0.0 };
        rays.push(Ray::new(origin, direction));
    }
    for (i, ray) in rays.iter_mut().enumerate() {
        let length = [1.0, 1024.0, 0.125, 3.0][i % 4];
        ray.direction = ray.direction.map(|x| x * length);
        ray.t_max = 1e30;
        if i % 5 == 0 {
            (ray.t_min, ray.t_max) = (40.0 / length, 60.0 / length);
        }
    }
    rays[3].direction = [0.0; 3];
    compare("teapot, other rays", &mesh, &rays, 100)
}
