//! A path tracer in waves: all rays of a bounce are traced by raykd, then shaded by `shade.wgsl`, which makes the rays
//! of the next. They stay on the GPU, and so does how many there are.

use crate::gpu::Gpu;
use anyhow::{Result, bail};
use raykd::{Encoded, Query, Ray, Scene, rays::Camera};
use wgpu::BufferUsages as Use;

/// Paths under way at a time, unless the picture has more pixels.
const PATHS: u32 = 1 << 21;
/// Lanes of a workgroup of `shade.wgsl`.
const GROUP: u32 = 128;
/// Bytes between the numbers of rays of two bounces, and from these to the numbers of shadow rays.
const STRIDE: u64 = 512;
const SHADOWS: u64 = 256;

/// `Frame` in `shade.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Frame {
    eye: [f32; 3],
    width: u32,
    right: [f32; 3],
    height: u32,
    up: [f32; 3],
    samples: u32,
    forward: [f32; 3],
    done: u32,
    floor: f32,
    lift: f32,
    radius: f32,
    scale: f32,
}

/// A kernel of `shade.wgsl` with its buffers.
#[derive(Debug)]
struct Pass {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
}

/// What one bounce consists of.
#[derive(Debug)]
struct Bounce {
    shade: Pass,
    sun: Pass,
}

/// Timestamps around every tracing of a wave, and nanoseconds between two ticks.
#[derive(Debug)]
struct Clock {
    set: wgpu::QuerySet,
    period: f64,
}

/// Work that was submitted.
#[derive(Debug)]
pub(crate) struct Wave {
    /// To wait for.
    pub submission: wgpu::SubmissionIndex,
    /// To be asked what became of the rays, once it is done.
    pub encoded: Vec<Encoded>,
    /// Of each tracing when it started and ended, if the device has timestamps.
    ticks: Option<wgpu::Buffer>,
}

/// A picture that gets better with every wave.
#[derive(Debug)]
pub(crate) struct Tracer {
    scene: Scene,
    frame: Frame,
    pub uniform: wgpu::Buffer,
    /// Of even and odd bounces.
    pub rays: [wgpu::Buffer; 2],
    pub hits: wgpu::Buffer,
    shadow_rays: wgpu::Buffer,
    shadow_hits: wgpu::Buffer,
    pub counts: wgpu::Buffer,
    /// Red, green, blue and 255, a byte each.
    pub pixels: wgpu::Buffer,
    traced: wgpu::Buffer,
    camera: Pass,
    bounces: Vec<Bounce>,
    picture: Pass,
    clock: Option<Clock>,
}

impl Tracer {
    /// Room for the paths of a picture of a scene with these corners, at most `samples` of a pixel at a time.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        (lo, hi): ([f32; 3], [f32; 3]),
        [width, height]: [u32; 2],
        samples: u32,
        bounces: u32,
    ) -> Result<Self> {
        let samples = (PATHS / (width * height)).clamp(1, samples);
        let paths = u64::from(width * height * samples);
        let limits = gpu.device.limits();
        if paths * size_of::<Ray>() as u64
            > limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
        {
            bail!("a picture of {width}x{height} is too large for this device; give --size a smaller one");
        }
        let radius = (0..3).map(|a| (hi[a] - lo[a]).powi(2)).sum::<f32>().sqrt() / 2.0;
        let frame = Frame {
            width,
            height,
            samples,
            floor: lo[1],
            lift: radius * 2.0e-5,
            radius,
            scale: scene.header().scale,
            ..bytemuck::Zeroable::zeroed()
        };
        let uniform = gpu.uniform("frame", &frame);
        let of_paths = |name, bytes| gpu.buffer(name, paths * bytes, Use::STORAGE | Use::COPY_SRC);
        let rays = ["even rays", "odd rays"].map(|name| of_paths(name, 32));
        let carried = ["even paths", "odd paths"].map(|name| of_paths(name, 16));
        let (hits, light) = (of_paths("hits", 16), of_paths("light", 16));
        let [shadow_rays, shadow_light, shadow_hits] =
            [("shadow rays", 32), ("shadow light", 16), ("shadow hits", 16)]
                .map(|(name, bytes)| of_paths(name, bytes));
        let counts = gpu.buffer(
            "counts",
            STRIDE * u64::from(bounces + 1),
            Use::STORAGE | Use::COPY_DST | Use::COPY_SRC,
        );
        let of_pixels =
            |name, bytes| gpu.buffer(name, u64::from(width * height) * bytes, Use::STORAGE | Use::COPY_SRC);
        let (sums, pixels) = (of_pixels("sums", 16), of_pixels("pixels", 4));
        let traced = gpu.buffer("traced", 8, Use::STORAGE | Use::COPY_SRC | Use::COPY_DST);

        let module = gpu.shader("shade.wgsl", include_str!("shade.wgsl"));
        let pipeline = |name: &str| gpu.kernel(&module, name);
        let pass = |pipeline: &wgpu::ComputePipeline, buffers: &[(u32, &wgpu::Buffer)]| Pass {
            group: gpu.bind(&pipeline.get_bind_group_layout(0), buffers),
            pipeline: pipeline.clone(),
        };
        let buffers = scene.buffers()?;
        let [shade, sun] = ["shade", "sun"].map(&pipeline);
        let bounce = |number: u32| {
            let (now, next) = (number as usize % 2, (number as usize + 1) % 2);
            let bounce = gpu.uniform("bounce", &[number, u32::from(number + 1 == bounces), 0, 0]);
            let common = [(0, &uniform), (1, &bounce), (2, &counts), (9, &shadow_light), (10, &light)];
            let wave = [
                (3, &rays[now]),
                (4, &carried[now]),
                (5, &hits),
                (6, &rays[next]),
                (7, &carried[next]),
                (8, &shadow_rays),
                (11, buffers.positions),
                (12, buffers.indices),
            ];
            Bounce {
                shade: pass(&shade, &[&common[..], &wave].concat()),
                sun: pass(&sun, &[&common[1..], &[(5, &shadow_hits)]].concat()),
            }
        };
        let bounces: Vec<_> = (0..bounces).map(bounce).collect();
        let camera = [(0, &uniform), (2, &counts), (6, &rays[0]), (7, &carried[0]), (10, &light)];
        let picture = [(0, &uniform), (2, &counts), (10, &light), (13, &sums), (14, &pixels), (15, &traced)];
        Ok(Self {
            camera: pass(&pipeline("camera"), &camera),
            picture: pass(&pipeline("picture"), &picture),
            clock: gpu.timed.then(|| Clock::new(gpu, 4 * bounces.len() as u32)),
            bounces,
            scene: scene.clone(),
            frame,
            uniform,
            rays,
            hits,
            shadow_rays,
            shadow_hits,
            counts,
            pixels,
            traced,
        })
    }

    /// Starts over with another camera.
    pub(crate) fn look(&mut self, gpu: &Gpu, camera: &Camera) {
        let [right, up, forward] = camera.frame();
        let tall = (camera.fov.to_radians() * 0.5).tan();
        let broad = tall * f64::from(self.frame.width) / f64::from(self.frame.height);
        let narrow = |v: [f64; 3], by: f64| v.map(|x| (x * by) as f32);
        self.frame.eye = narrow(camera.eye, 1.0);
        (self.frame.right, self.frame.up) = (narrow(right, broad), narrow(up, tall));
        self.frame.forward = narrow(forward, 1.0);
        self.frame.done = 0;
        gpu.queue.write_buffer(&self.traced, 0, &[0; 8]);
    }

    /// How many samples each pixel has.
    pub(crate) const fn done(&self) -> u32 {
        self.frame.done
    }

    /// How many rays were traced since the last look, once all that was submitted is done.
    pub(crate) fn traced(&self, gpu: &Gpu) -> Result<u64> {
        let words: Vec<u32> = gpu.read(&self.traced)?;
        Ok(u64::from(words[0]) | u64::from(words[1]) << 32)
    }

    /// How many seconds the tracing of a wave took that is done.
    pub(crate) fn seconds(&self, gpu: &Gpu, wave: &Wave) -> Result<Option<f64>> {
        let (Some(clock), Some(ticks)) = (&self.clock, &wave.ticks) else { return Ok(None) };
        let ticks: Vec<u64> = gpu.read(ticks)?;
        let spans = ticks.chunks_exact(2).map(|ends| ends[1].saturating_sub(ends[0]));
        Ok(Some(spans.sum::<u64>() as f64 * clock.period * 1e-9))
    }

    /// Submits the next wave, of at most so many samples a pixel.
    pub(crate) fn wave(&mut self, gpu: &Gpu, samples: u32) -> Result<Wave> {
        let wave = Frame { samples: self.frame.samples.min(samples), ..self.frame };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&wave));
        let pixels = wave.width * wave.height;
        let paths = pixels * wave.samples;
        let mut encoder = gpu.encoder();
        encoder.clear_buffer(&self.counts, 0, None);
        self.camera.encode(&mut encoder, paths);
        let mut encoded = Vec::new();
        for (k, bounce) in self.bounces.iter().enumerate() {
            let at = STRIDE * k as u64;
            let count = |at: u64| self.counts.slice(at..at + 4);
            // Of each bounce two times start and end.
            let tick = 4 * k as u32;
            self.stamp(&mut encoder, tick);
            let (rays, hits) = (self.rays[k % 2].slice(..), self.hits.slice(..));
            encoded.push(self.scene.encode(&mut encoder, Query::Closest, rays, hits, count(at))?);
            self.stamp(&mut encoder, tick + 1);
            bounce.shade.encode(&mut encoder, paths);
            self.stamp(&mut encoder, tick + 2);
            let (rays, hits) = (self.shadow_rays.slice(..), self.shadow_hits.slice(..));
            encoded.push(self.scene.encode(&mut encoder, Query::Any, rays, hits, count(at + SHADOWS))?);
            self.stamp(&mut encoder, tick + 3);
            bounce.sun.encode(&mut encoder, paths);
        }
        self.picture.encode(&mut encoder, pixels);
        let ticks = self.clock.as_ref().map(|clock| {
            let count = 4 * self.bounces.len() as u32;
            let ticks = gpu.buffer("ticks", u64::from(count) * 8, Use::QUERY_RESOLVE | Use::COPY_SRC);
            encoder.resolve_query_set(&clock.set, 0..count, &ticks, 0);
            ticks
        });
        self.frame.done += wave.samples;
        Ok(Wave { submission: gpu.queue.submit([encoder.finish()]), encoded, ticks })
    }

    fn stamp(&self, encoder: &mut wgpu::CommandEncoder, number: u32) {
        if let Some(clock) = &self.clock {
            encoder.write_timestamp(&clock.set, number);
        }
    }
}

impl Clock {
    fn new(gpu: &Gpu, count: u32) -> Self {
        let (label, ty) = (Some("clock"), wgpu::QueryType::Timestamp);
        let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor { label, ty, count });
        Self { set, period: f64::from(gpu.queue.get_timestamp_period()) }
    }
}

impl Pass {
    /// Encodes as many workgroups as cover so many lanes.
    fn encode(&self, encoder: &mut wgpu::CommandEncoder, lanes: u32) {
        let groups = lanes.div_ceil(GROUP);
        let wide = groups.min(0xFFFF);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(wide, groups.div_ceil(wide), 1);
    }
}
