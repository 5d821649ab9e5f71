//! A wgpu device that this program opens itself, as a program with more to draw would, and small help with it.

use anyhow::{Context as _, Result};
use wgpu::{Features, util::DeviceExt as _};

/// The program's device, and raykd's view of it.
#[derive(Debug)]
pub(crate) struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub raykd: raykd::Device,
    /// Whether commands can be timed on the device.
    pub timed: bool,
}

/// Timestamps between the passes of a command encoder.
const CLOCK: Features = Features::TIMESTAMP_QUERY.union(Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);

/// A wgpu instance; `display` is needed for windows alone.
pub(crate) fn instance(display: Option<Box<dyn wgpu::wgt::WgpuHasDisplayHandle>>) -> wgpu::Instance {
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        // In particular no checks of indirect dispatches, which cost a dispatch each.
        flags: wgpu::InstanceFlags::empty(),
        display,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

/// The best adapter for a window, or for none, or the best whose description contains `wanted`.
pub(crate) fn adapter(
    instance: &wgpu::Instance,
    wanted: Option<&str>,
    surface: Option<&wgpu::Surface<'_>>,
) -> Result<wgpu::Adapter> {
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    adapters.retain(|adapter| surface.is_none_or(|surface| adapter.is_surface_supported(surface)));
    let name = |adapter: &wgpu::Adapter| {
        let info = adapter.get_info();
        format!("{}, {} {}", info.name, info.driver, info.driver_info)
    };
    let names = adapters.iter().map(name).collect::<Vec<_>>().join("\n  ");
    let wanted = wanted.unwrap_or_default().to_lowercase();
    adapters.retain(|adapter| name(adapter).to_lowercase().contains(&wanted));
    let rank = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu | wgpu::DeviceType::Other => 2,
        wgpu::DeviceType::Cpu => 3,
    };
    adapters.into_iter().min_by_key(rank).with_context(|| match names.as_str() {
        "" => "no Vulkan device that can be used here; on Debian and Ubuntu the package mesa-vulkan-drivers has one in \
               software"
            .to_owned(),
        names => format!("no device is called {wanted:?}; there are:\n  {names}"),
    })
}

impl Gpu {
    /// Opens an adapter with what raykd needs, and timestamps if there are any.
    pub(crate) fn open(adapter: &wgpu::Adapter) -> Result<Self> {
        let timed = adapter.features().contains(CLOCK);
        let clock = if timed { CLOCK } else { Features::empty() };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            required_features: raykd::required_features() | clock,
            required_limits: raykd::required_limits(adapter.limits()),
            // SAFETY: raykd's kernels keep to their buffers.
            experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
            ..Default::default()
        }))
        .with_context(|| format!("{} cannot be used", adapter.get_info().name))?;
        let raykd = raykd::Device::from_wgpu(&device, &queue)?;
        Ok(Self { device, queue, raykd, timed })
    }

    pub(crate) fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let size = bytes.next_multiple_of(16);
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        self.device.create_buffer(&descriptor)
    }

    pub(crate) fn uniform<T: bytemuck::Pod>(&self, label: &str, value: &T) -> wgpu::Buffer {
        let (label, contents) = (Some(label), bytemuck::bytes_of(value));
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label, contents, usage })
    }

    pub(crate) fn shader(&self, label: &str, wgsl: &str) -> wgpu::ShaderModule {
        let source = wgpu::ShaderSource::Wgsl(wgsl.into());
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
    }

    pub(crate) fn kernel(&self, module: &wgpu::ShaderModule, entry_point: &str) -> wgpu::ComputePipeline {
        self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: None,
            module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        })
    }

    pub(crate) fn bind(
        &self,
        layout: &wgpu::BindGroupLayout,
        buffers: &[(u32, &wgpu::Buffer)],
    ) -> wgpu::BindGroup {
        let resources = buffers.iter().map(|(binding, buffer)| (*binding, buffer.as_entire_binding()));
        let entries: Vec<_> =
            resources.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// What a buffer holds once the device has done all that was submitted.
    pub(crate) fn read<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Result<Vec<T>> {
        let to =
            self.buffer("read", buffer.size(), wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(buffer, 0, &to, 0, buffer.size());
        self.queue.submit([encoder.finish()]);
        let (sender, mapped) = std::sync::mpsc::channel();
        to.slice(..).map_async(wgpu::MapMode::Read, move |result| sender.send(result).unwrap_or_default());
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        mapped.recv()??;
        Ok(bytemuck::pod_collect_to_vec(&to.slice(..).get_mapped_range()?))
    }
}
