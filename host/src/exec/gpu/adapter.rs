//! Finding and describing Vulkan adapters.

use super::{
    CHUNK, Gpu,
    clock::Clock,
    probe::{AdapterVerdict, VALUES},
};
use crate::{Device, Error};
use raykd_kernels::Kernel;
use raykd_shared::limits::GROUPS_X;
use std::sync::LazyLock;

/// What one Vulkan adapter is and can do: see [`adapters`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct AdapterReport {
    /// Name of the device.
    pub name: String,
    /// Name of its driver.
    pub driver: String,
    /// Version of its driver.
    pub driver_info: String,
    /// The interface it is reached by: `vulkan`.
    pub backend: &'static str,
    /// `discrete`, `integrated`, `virtual`, `other` or `cpu`: the last is a software driver.
    pub device_type: &'static str,
    /// Version of Vulkan that it speaks, if known.
    pub api: Option<String>,
    /// Largest part of a buffer that a kernel may see, in bytes.
    pub max_binding_bytes: u64,
    /// Largest buffer, in bytes.
    pub max_buffer_bytes: u64,
    /// Workgroup memory, in bytes.
    pub workgroup_bytes: u32,
    /// Most lanes of a workgroup.
    pub workgroup_lanes: u32,
    /// Most buffers that a kernel binds.
    pub buffers_per_kernel: u32,
    /// Smallest and largest subgroup.
    pub subgroup: [u32; 2],
    /// SPIR-V is taken as it is.
    pub passthrough: bool,
    /// Kernels are timed on the device.
    pub timestamps: bool,
    /// Doubles are quick, and [`Intersector::Exact`](crate::Intersector::Exact) computes with them.
    pub doubles: bool,
    /// Result of the start-up probe.
    pub verdict: AdapterVerdict,
}

/// All Vulkan adapters, best first. Each is opened and probed, which takes a while.
pub fn adapters() -> Vec<AdapterReport> {
    enumerate().iter().map(report).collect()
}

/// The features wanted of a device; of these only [`required_features`] must be there.
pub(super) const WANTED: wgpu::Features =
    required_features().union(Clock::FEATURES).union(wgpu::Features::SHADER_F64);

/// The features without which nothing runs: kernels are given to the driver as they were compiled.
///
/// wgpu calls this feature experimental, so that a device with it takes `ExperimentalFeatures::enabled()`, too.
/// A device that has `SHADER_F64`, `TIMESTAMP_QUERY` and `TIMESTAMP_QUERY_INSIDE_PASSES` besides, and whose doubles are
/// quick, finds hits by [`Intersector::Exact`](crate::Intersector::Exact) sooner.
pub const fn required_features() -> wgpu::Features {
    wgpu::Features::PASSTHROUGH_SHADERS
}

/// Of `limits`, raised where kernels or transfers need more.
///
/// `max_storage_buffer_binding_size` and `max_buffer_size` bound the scenes that fit; ask for what the adapter has.
pub fn required_limits(limits: wgpu::Limits) -> wgpu::Limits {
    let most =
        |of: fn(&Kernel) -> u32| raykd_kernels::KERNELS.iter().map(|&kernel| of(kernel)).max().unwrap_or(0);
    let (threads, buffers) = (most(|kernel| kernel.threads), most(|kernel| kernel.slots.len() as u32));
    wgpu::Limits {
        max_compute_invocations_per_workgroup: limits.max_compute_invocations_per_workgroup.max(threads),
        max_compute_workgroup_size_x: limits.max_compute_workgroup_size_x.max(threads),
        max_storage_buffers_per_shader_stage: limits.max_storage_buffers_per_shader_stage.max(buffers),
        max_compute_workgroups_per_dimension: limits.max_compute_workgroups_per_dimension.max(GROUPS_X),
        max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size.max(4 * VALUES),
        max_buffer_size: limits.max_buffer_size.max(CHUNK as u64),
        ..limits
    }
}

/// The best adapter, or the best whose description contains `wanted`, or by `gpu:` and a number that of [`adapters`];
/// with `hardware`, none that is a CPU.
pub(super) fn choose(wanted: Option<&str>, hardware: bool) -> Result<&'static wgpu::Adapter, Error> {
    let needle = wanted.map(str::to_lowercase);
    let fits = |adapter: &&wgpu::Adapter| {
        let info = adapter.get_info();
        let named = needle.as_ref().is_none_or(|n| describe(&info).to_lowercase().contains(n.as_str()));
        named && !(hardware && info.device_type == wgpu::DeviceType::Cpu)
    };
    let number = wanted.and_then(|wanted| wanted.strip_prefix("gpu:")?.parse::<usize>().ok());
    let found = match number {
        Some(number) => enumerate().get(number),
        None => enumerate().iter().find(fits),
    };
    found.ok_or_else(|| Error::NoAdapter { wanted: wanted.map(str::to_owned) })
}

/// An adapter's name and driver, as shown to users.
pub(super) fn describe(info: &wgpu::AdapterInfo) -> String {
    let driver = format!("{} {}", info.driver, info.driver_info);
    match driver.trim() {
        "" => info.name.clone(),
        driver => format!("{}, {driver}", info.name),
    }
}

/// What an adapter lacks to run our kernels.
pub(super) fn lacks(adapter: &wgpu::Adapter) -> Option<String> {
    missing("the driver", adapter.features(), adapter.limits())
}

/// What features and limits lack to run our kernels; `who` has them.
pub(super) fn missing(who: &str, features: wgpu::Features, limits: wgpu::Limits) -> Option<String> {
    let missing = required_features() - features;
    if !missing.is_empty() {
        return Some(format!("{who} lacks {missing}"));
    }
    let mut lacks = None;
    required_limits(limits.clone()).check_limits_with_fail_fn(&limits, true, |name, needed, allowed| {
        lacks = Some(format!("{who} allows {name} of {allowed}, and raykd needs {needed}"));
    });
    lacks
}

/// All adapters, usable ones first and among these the faster kinds. Looked for once: drivers take long to load.
fn enumerate() -> &'static [wgpu::Adapter] {
    static ADAPTERS: LazyLock<Vec<wgpu::Adapter>> = LazyLock::new(|| {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN,
            // In particular no checks of indirect dispatches, which cost a dispatch each.
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        adapters.sort_by_key(|adapter| (lacks(adapter).is_some(), kind(adapter.get_info().device_type).0));
        adapters
    });
    &ADAPTERS
}

/// Rank and name of a device type.
const fn kind(kind: wgpu::DeviceType) -> (u32, &'static str) {
    match kind {
        wgpu::DeviceType::DiscreteGpu => (0, "discrete"),
        wgpu::DeviceType::IntegratedGpu => (1, "integrated"),
        wgpu::DeviceType::VirtualGpu => (2, "virtual"),
        wgpu::DeviceType::Other => (3, "other"),
        wgpu::DeviceType::Cpu => (4, "cpu"),
    }
}

fn report(adapter: &wgpu::Adapter) -> AdapterReport {
    let (info, limits, features) = (adapter.get_info(), adapter.limits(), adapter.features());
    let probed = Gpu::on(adapter).and_then(Gpu::probed);
    let (doubles, verdict) = probed.map_or_else(
        |error| (false, AdapterVerdict::Unusable(error.to_string())),
        |(gpu, verdict)| (Device::from(gpu).by_doubles(), verdict),
    );
    AdapterReport {
        device_type: kind(info.device_type).1,
        backend: info.backend.to_str(),
        name: info.name,
        driver: info.driver,
        driver_info: info.driver_info,
        api: api(adapter),
        max_binding_bytes: limits.max_storage_buffer_binding_size,
        max_buffer_bytes: limits.max_buffer_size,
        workgroup_bytes: limits.max_compute_workgroup_storage_size,
        workgroup_lanes: limits.max_compute_invocations_per_workgroup,
        buffers_per_kernel: limits.max_storage_buffers_per_shader_stage,
        subgroup: [info.subgroup_min_size, info.subgroup_max_size],
        passthrough: features.contains(wgpu::Features::PASSTHROUGH_SHADERS),
        timestamps: features.contains(Clock::FEATURES),
        doubles,
        verdict,
    }
}

/// The Vulkan version, which wgpu keeps to itself.
fn api(adapter: &wgpu::Adapter) -> Option<String> {
    // SAFETY: the adapter is only asked for its properties.
    let raw = unsafe { adapter.as_hal::<wgpu::hal::api::Vulkan>() }?;
    let instance = raw.shared_instance().raw_instance();
    // SAFETY: the physical device is this instance's.
    let properties = unsafe { instance.get_physical_device_properties(raw.raw_physical_device()) };
    let v = properties.api_version;
    Some(format!("{}.{}.{}", v >> 22 & 0x7F, v >> 12 & 0x3FF, v & 0xFFF))
}
