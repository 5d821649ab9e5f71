//! What a device is asked to run, and how long that took.

use super::{AnyBuffer, Buffer, OnDevice};
use raykd_kernels::{Bindings, Kernel};
use std::time::Duration;

/// How many workgroups a step runs.
#[derive(Clone, Debug)]
pub enum Groups<'a> {
    /// This many.
    Fixed(u32),
    /// As many as an earlier kernel wrote: three words `[x, y, z]` at word `3 * entry` of the buffer, for a
    /// dispatch of `x * y * z` workgroups. The step itself must not write that buffer.
    Indirect(&'a Buffer<u32>, u32),
}

/// One dispatch: a kernel, its buffers in binding order, and how many workgroups. [`Launch`] makes them.
#[derive(Clone, Debug)]
pub struct Step<'a> {
    /// What runs.
    pub kernel: &'static Kernel,
    /// On which buffers; as many as the kernel has slots.
    pub buffers: Vec<&'a AnyBuffer>,
    /// How often.
    pub groups: Groups<'a>,
}

/// Makes a dispatch of a kernel's buffers.
///
/// ```
/// # use raykd::{Device, internals::{Launch, kernels::probe::Buffers}};
/// # let device = Device::cpu();
/// # let (inputs, results) = (device.alloc("inputs", 1)?, device.alloc("results", 8)?);
/// let count = device.alloc("count", 1)?;
/// let step = Buffers { inputs: &inputs, results: results.out(), count: &count }.over(1);
/// # Ok::<_, raykd::Error>(())
/// ```
///
/// A buffer of another type does not compile, nor does one that is missing, or written without saying so:
///
/// ```compile_fail,E0271
/// # use raykd::{Device, internals::{Launch, kernels::probe::Buffers}};
/// # let device = Device::cpu();
/// # let (inputs, results) = (device.alloc("inputs", 1)?, device.alloc("results", 8)?);
/// let count = device.alloc::<f32>("count", 1)?;
/// let step = Buffers { inputs: &inputs, results: results.out(), count: &count }.over(1);
/// # Ok::<_, raykd::Error>(())
/// ```
pub trait Launch<'a>: Bindings<'a, OnDevice> + Sized {
    /// Of so many workgroups.
    fn run(self, groups: Groups<'a>) -> Step<'a> {
        Step { kernel: Self::KERNEL, buffers: self.list(), groups }
    }

    /// Of as many workgroups as cover `items` lanes.
    fn over(self, items: u32) -> Step<'a> {
        self.run(Groups::Fixed(items.div_ceil(Self::KERNEL.threads)))
    }

    /// Of exactly `groups` workgroups.
    fn groups(self, groups: u32) -> Step<'a> {
        self.run(Groups::Fixed(groups))
    }

    /// Of as many workgroups as an earlier kernel wrote.
    fn indirect(self, args: &'a Buffer<u32>, entry: u32) -> Step<'a> {
        self.run(Groups::Indirect(args, entry))
    }
}

impl<'a, B: Bindings<'a, OnDevice>> Launch<'a> for B {}

/// What of a run is timed, which takes time itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Timed {
    /// Nothing: what [`Timing`] says is 0, or a host's guess.
    Nothing,
    /// All steps together.
    Whole,
    /// Each step too.
    Steps,
}

impl Timed {
    /// All, and each step if the run is profiled.
    pub(crate) const fn profiled(profile: bool) -> Self {
        if profile { Self::Steps } else { Self::Whole }
    }
}

/// How long a run took, measured on the device where it has timestamps.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// From the first kernel's start to the last one's end, transfers excluded.
    pub total: Duration,
    /// Time of each step, in order; empty unless profiling was asked for.
    pub steps: Vec<Duration>,
    /// Bytes that each step read and wrote in buffers: on the CPU, with the feature `traffic`, if profiling
    /// was asked for.
    pub moved: Vec<u64>,
}
