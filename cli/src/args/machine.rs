//! Which devices a command runs on.

use super::values::whole;
use clap::ValueEnum;
use std::thread::available_parallelism;

/// How many threads run at once here.
pub(crate) fn at_once() -> usize {
    available_parallelism().map_or(1, usize::from)
}

/// The most threads of a CPU: 64 for each that runs at once. Threads without work look for some at all others, so that
/// thousands on a few cores do nothing else.
fn most() -> u16 {
    (64 * at_once()).min(4096) as u16
}

/// More about the devices to run on.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct MachineArgs {
    /// The GPU whose name or driver contains this (any case), or the one of a number, as gpu:1; implies the GPU
    #[arg(long, value_name = "SUBSTRING")]
    pub adapter: Option<String>,
    /// Threads of the CPU; implies the CPU where one device is used; left out: all
    #[arg(long, value_name = "N", value_parser = whole(1, most()))]
    pub threads: Option<u16>,
}

/// Which one device a command runs on.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct OneArgs {
    /// Left out: a real GPU if there is one, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<One>,
    #[command(flatten)]
    pub more: MachineArgs,
}

/// Which devices a command runs on.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct WhichArgs {
    /// Left out: both if there is any Vulkan adapter, a software one too, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<Which>,
    #[command(flatten)]
    pub more: MachineArgs,
}

/// One device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum One {
    /// The processor
    Cpu,
    /// The best Vulkan adapter, a software one too
    Gpu,
}

/// One device or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Which {
    /// The processor
    Cpu,
    /// The best Vulkan adapter, a software one too
    Gpu,
    /// One after the other
    Both,
}

impl From<One> for Which {
    fn from(one: One) -> Self {
        match one {
            One::Cpu => Self::Cpu,
            One::Gpu => Self::Gpu,
        }
    }
}
