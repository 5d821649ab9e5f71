//! What rays cost, as colours over the picture: a walk of this program's own, in WGSL, through raykd's tree.

use crate::{gpu::Gpu, tracer::Tracer};
use anyhow::Result;
use raykd::Scene;

/// The picture with costs laid over it.
#[derive(Debug)]
pub(crate) struct Cost {
    pipeline: wgpu::ComputePipeline,
    groups: [wgpu::BindGroup; 2],
    size: [u32; 2],
    /// Red, green, blue and 255, a byte each.
    pub pixels: wgpu::Buffer,
}

impl Cost {
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, tracer: &Tracer, size: [u32; 2]) -> Result<Self> {
        let module = gpu.shader("cost.wgsl", &[raykd::WGSL, include_str!("cost.wgsl")].concat());
        let pipeline = gpu.kernel(&module, "cost");
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let pixels = gpu.buffer("costs", tracer.pixels.size(), usage);
        let tree = scene.buffers()?;
        let own = [(0, &tracer.uniform), (1, &tracer.pixels), (2, &pixels)];
        let raykd = [(0, tree.header), (1, tree.nodes), (2, tree.corners)];
        let bind = |group, buffers: &[_]| gpu.bind(&pipeline.get_bind_group_layout(group), buffers);
        Ok(Self { groups: [bind(0, &own), bind(1, &raykd)], pipeline, size, pixels })
    }

    /// Lays costs over the picture as it is.
    pub(crate) fn draw(&self, gpu: &Gpu) {
        let mut encoder = gpu.encoder();
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        for (number, group) in (0..).zip(&self.groups) {
            pass.set_bind_group(number, group, &[]);
        }
        let [x, y] = self.size.map(|pixels| pixels.div_ceil(8));
        pass.dispatch_workgroups(x, y, 1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }
}
