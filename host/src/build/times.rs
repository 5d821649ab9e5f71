//! Times and memory of a build.

use crate::exec::{Step, Timing};
use std::time::Duration;

/// How long a build took and what it needed.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct BuildTimes {
    /// From the mesh to the device, by the host's clock.
    pub upload: Duration,
    /// All kernels, by the device's clock.
    pub build: Duration,
    /// Laying the leaves' triangles out for tracing, by the device's clock. Zero where `build` includes it: see
    /// [`Device::recycling`](crate::Device::recycling).
    pub layout: Duration,
    /// Making what traversals need beside the tree, by the device's clock: see
    /// [`Scene::traverse_by`](crate::Scene::traverse_by).
    pub prepare: Duration,
    /// Most bytes of buffers held at once, the mesh included.
    pub peak_bytes: u64,
    /// How often the build was repeated, with more room, a higher price or by the host; the other times are
    /// those of the last try.
    pub retries: u32,
    /// What the tries before the last took in all, by the host's clock.
    pub failed: Duration,
    /// Whether the host built the tree because the device had not the room to.
    pub by_host: bool,
    /// With profiling: what each kernel took, in order of first use.
    pub kernels: Vec<KernelTimes>,
}

/// What all dispatches of a kernel took.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct KernelTimes {
    /// Its name.
    pub name: &'static str,
    /// How often it was dispatched.
    pub dispatches: u32,
    /// What they took in all, by the device's clock.
    pub time: Duration,
    /// Bytes read and written in buffers: on the CPU, with the feature `traffic`.
    pub bytes: Option<u64>,
}

impl BuildTimes {
    /// Adds the times of steps, summed by kernel in order of first use.
    pub(super) fn add(&mut self, steps: &[Step<'_>], timing: &Timing) {
        self.build += timing.total;
        for (i, (step, &time)) in steps.iter().zip(&timing.steps).enumerate() {
            let name = step.kernel.name();
            let bytes = timing.moved.get(i).copied();
            match self.kernels.iter_mut().find(|kernel| kernel.name == name) {
                Some(kernel) => {
                    kernel.dispatches += 1;
                    kernel.time += time;
                    kernel.bytes = kernel.bytes.zip(bytes).map(|(sum, more)| sum + more);
                }
                None => self.kernels.push(KernelTimes { name, dispatches: 1, time, bytes }),
            }
        }
    }
}
