//! What the tests share: devices to compare, meshes and rays that have broken ray tracers, and checks that
//! name the first thing that differs.

pub mod covers;
pub mod dispatches;
pub mod exact;
pub mod meshes;
pub mod one_by_one;
pub mod rays;
pub mod trees;

use proptest::prelude::*;
use raykd::{
    BuildOptions, Builder, Device, Error, Scene,
    internals::{Cpu, kernels::Order},
};
use std::{fmt, sync::LazyLock};

/// A device and what it is called in messages.
#[derive(Debug)]
pub struct Named {
    /// What it is called.
    pub name: &'static str,
    /// The device.
    pub device: Device,
}

/// All devices that must agree. The first, the CPU with its lanes in order, is what the others are compared
/// with; the last is the GPU.
///
/// # Panics
/// There is no Vulkan adapter: that is a failure, not a reason to skip.
pub fn devices() -> &'static [Named] {
    static DEVICES: LazyLock<Vec<Named>> = LazyLock::new(|| {
        let cpu = |name, cpu| Named { name, device: Device::from(cpu) };
        let gpu = Device::gpu(None).unwrap_or_else(|e| panic!("the tests compare CPU and GPU, but: {e}"));
        vec![
            cpu("CPU", Cpu::default()),
            cpu("CPU, lanes and groups in reverse", Cpu::default().in_order(Order::Reverse)),
            cpu("CPU, lanes shuffled", Cpu::default().in_order(Order::Shuffled(0x5EED))),
            cpu("CPU, one thread", Cpu::with_threads(1).expect("a thread can be started")),
            Named { name: "GPU", device: gpu },
        ]
    });
    &DEVICES
}

/// The [`devices`], the GPU once by floats alone and once by doubles: the exact test has a kernel for each.
///
/// # Panics
/// As for [`devices`], or the GPU has no doubles.
pub fn with_doubles() -> &'static [Named] {
    static DEVICES: LazyLock<Vec<Named>> = LazyLock::new(|| {
        let [cpus @ .., _] = devices() else { unreachable!("the last is the GPU") };
        let cpus = cpus.iter().map(|Named { name, device }| Named { name, device: device.clone() });
        let gpus = [("GPU by floats", false), ("GPU by doubles", true)].map(|(name, doubles)| Named {
            name,
            device: gpu().with_doubles(doubles).expect("the tests compare both, but the GPU has no doubles"),
        });
        cpus.chain(gpus).collect()
    });
    &DEVICES
}

/// The CPU of [`devices`].
pub fn cpu() -> &'static Device {
    &devices()[0].device
}

/// The GPU of [`devices`].
pub fn gpu() -> &'static Device {
    &devices()[devices().len() - 1].device
}

/// A scene of vertices and triangles that lie in buffers of a device.
///
/// # Errors
/// They are no mesh, or the device failed.
pub fn built_from(
    device: &Device,
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    options: &BuildOptions,
) -> Result<Scene, Error> {
    let words: Vec<u32> = positions.as_flattened().iter().map(|x| x.to_bits()).collect();
    let vertices = device.upload("given vertices", &words)?;
    let indices = device.upload("given triangles", triangles.as_flattened())?;
    Scene::build_from(device, &vertices, &indices, [positions.len() as u32, triangles.len() as u32], options)
}

/// Options of all kinds for a builder.
pub fn any_options(builder: impl Strategy<Value = Builder>) -> impl Strategy<Value = BuildOptions> {
    let costs = prop::sample::select(vec![0.0, 0.1, 1.0, 3.0, 50.0]);
    let price = prop::sample::select(vec![0.0, 5.0, 1e9]);
    let empty = prop::sample::select(vec![1.0, 0.9, 0.0]);
    let long = prop::sample::select(vec![0, 16, u32::MAX]);
    let depth = prop_oneof![Just(48), 0u32..=48];
    (costs.clone(), costs, (price, long), empty, depth, builder, any::<bool>()).prop_map(
        |(cost_step, cost_test, (price, long), empty, max_depth, builder, clip)| {
            BuildOptions::default()
                .with_cost_step(cost_step)
                .with_cost_test(cost_test)
                .with_price(price)
                .with_long(long)
                .with_empty(empty)
                .with_max_depth(max_depth)
                .with_builder(builder)
                .with_clip(clip)
        },
    )
}

/// Why a check failed; a failed assertion for `proptest`, a panic for `unwrap`.
#[derive(Debug)]
pub struct Failure(pub String);

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Failure {}

impl From<raykd::Error> for Failure {
    fn from(error: raykd::Error) -> Self {
        Self(error.to_string())
    }
}

/// What a device found; nothing if it is a software rasteriser that gave up (Mesa's ends all loops of an invocation
/// after 65,535 rounds in total).
pub fn unless_cut<T>(found: Result<T, raykd::Error>) -> Result<Option<T>, Failure> {
    match found {
        Err(e) if e.to_string().contains("cut a long loop short") => Ok(None),
        found => Ok(Some(found?)),
    }
}

/// Compares as bytes and names the first element that differs.
///
/// # Errors
/// They differ.
pub fn same<T: bytemuck::Pod + fmt::Debug>(what: &str, expected: &[T], found: &[T]) -> Result<(), Failure> {
    if expected.len() != found.len() {
        return Err(Failure(format!("{what}: {} elements, expected {}", found.len(), expected.len())));
    }
    let differs = |(a, b): (&T, &T)| bytemuck::bytes_of(a) != bytemuck::bytes_of(b);
    match expected.iter().zip(found).position(differs) {
        None => Ok(()),
        Some(i) => {
            let count = expected.iter().zip(found).filter(|&pair| differs(pair)).count();
            Err(Failure(format!(
                "{what}: element {i} (the first of {count} that differ) is {:?}, expected {:?}",
                found[i], expected[i]
            )))
        }
    }
}

/// This many cases for a test; `PROPTEST_CASES`, whose default is 256, scales all tests alike.
pub fn cases(count: u32) -> ProptestConfig {
    let mut config = ProptestConfig::default();
    config.cases = (config.cases * count / 256).max(1);
    config.max_shrink_iters = 300;
    config
}
