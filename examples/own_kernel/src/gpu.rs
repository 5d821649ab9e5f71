//! What any compute kernel needs of wgpu.

use raykd::wgpu;
use std::error::Error;
use wgpu::BufferUsages as Use;

/// A device that raykd can share.
pub fn open() -> Result<(wgpu::Device, wgpu::Queue), Box<dyn Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    println!("{}", adapter.get_info().name);
    Ok(pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: raykd::required_features(),
        required_limits: raykd::required_limits(adapter.limits()),
        // SAFETY: the kernels of raykd and of this program keep to their buffers.
        experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
        ..Default::default()
    }))?)
}

/// A kernel of a module, 64 lanes a workgroup, that binds buffers 0, 1, 2, ... and writes the last one.
pub struct Kernel {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

impl Kernel {
    pub fn new(device: &wgpu::Device, spirv: &[u8], name: &str, buffers: u32) -> Self {
        // wgpu passes the module on and does not look into it, so all is said here.
        let entry = |binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: binding + 1 < buffers },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let entries: Vec<_> = (0..buffers).map(entry).collect();
        let layout = device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries });
        let entry_point = wgpu::PassthroughShaderEntryPoint { name: name.into(), workgroup_size: (64, 1, 1) };
        let module = wgpu::ShaderModuleDescriptorPassthrough {
            entry_points: vec![entry_point].into(),
            spirv: Some(wgpu::util::make_spirv_raw(spirv)),
            ..Default::default()
        };
        // SAFETY: raykd-spirv had spirv-val look at the module.
        let module = unsafe { device.create_shader_module_passthrough(module) };
        let layouts = [Some(&layout)];
        let of = wgpu::PipelineLayoutDescriptor { bind_group_layouts: &layouts, ..Default::default() };
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: Some(&device.create_pipeline_layout(&of)),
            module: &module,
            entry_point: Some(name),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { layout, pipeline }
    }

    /// Runs so many lanes, each of which writes a record to the last buffer; returns the records.
    pub fn run<T: bytemuck::Pod>(
        &self,
        (device, queue): &(wgpu::Device, wgpu::Queue),
        buffers: &[&wgpu::Buffer],
        lanes: u32,
    ) -> Result<Vec<T>, Box<dyn Error>> {
        let size = size_of::<T>() as u64 * u64::from(lanes);
        let buffer = |usage| wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
        let written = device.create_buffer(&buffer(Use::STORAGE | Use::COPY_SRC));
        let read = device.create_buffer(&buffer(Use::COPY_DST | Use::MAP_READ));
        let all = buffers.iter().copied().chain([&written]).map(wgpu::Buffer::as_entire_binding);
        let entries: Vec<_> =
            all.zip(0..).map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource }).collect();
        let layout = &self.layout;
        let group = wgpu::BindGroupDescriptor { label: None, layout, entries: &entries };
        let group = device.create_bind_group(&group);
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(lanes.div_ceil(64), 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&written, 0, &read, 0, size);
        queue.submit([encoder.finish()]);
        read.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("mapped"));
        device.poll(wgpu::PollType::wait_indefinitely())?;
        Ok(bytemuck::pod_collect_to_vec(&read.slice(..).get_mapped_range()?))
    }
}
