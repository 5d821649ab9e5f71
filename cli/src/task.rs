//! What a command says of itself.

use crate::{
    args::{MachineArgs, OneArgs, Which, WhichArgs},
    files::Files,
};
use std::{io::StdoutLock, process::ExitCode};

/// A command with its options.
pub(super) trait Task {
    /// What it reads and writes.
    fn files(&self) -> Files {
        Files::default()
    }

    /// Finds options that contradict each other, or would do nothing, which clap does not see by itself.
    ///
    /// # Errors
    /// What is wrong with them.
    fn check(&self) -> Result<(), String> {
        Ok(())
    }

    /// Does it. The exit code is a failure if devices differ.
    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode>;
}

/// On how many devices a command runs.
#[derive(Clone, Copy)]
pub(super) enum On<'a> {
    One(&'a OneArgs),
    Several(&'a WhichArgs),
}

impl On<'_> {
    /// Finds options for a device that is not used.
    pub(super) fn check(self) -> Result<(), String> {
        let (device, MachineArgs { adapter, threads }) = match self {
            Self::One(on) => (on.device.map(Which::from), &on.more),
            Self::Several(on) => (on.device, &on.more),
        };
        let wrong = match (adapter, threads) {
            (Some(_), _) if device == Some(Which::Cpu) => "--adapter names a GPU, --device cpu uses none",
            (_, Some(_)) if device == Some(Which::Gpu) => {
                "--threads is for the CPU, --device gpu does not use it"
            }
            (Some(_), Some(_)) if matches!(self, Self::One(_)) => {
                "--adapter is for the GPU, --threads for the CPU: use one of them"
            }
            _ => return Ok(()),
        };
        Err(wrong.to_owned())
    }
}
