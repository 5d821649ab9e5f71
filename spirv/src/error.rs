//! What can go wrong, and what to do then.

use crate::{Finding, RUST_GPU};
use std::{error, io, path::PathBuf};

/// Why there is no module.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The environment names a code generator that is not there.
    #[error("RUSTC_CODEGEN_SPIRV names {}, which is no file", .0.display())]
    NoBackend(PathBuf),
    /// One of two variables is set.
    #[error("set both of RUST_GPU_TOOLCHAIN and RUSTC_CODEGEN_SPIRV, or neither")]
    HalfSet,
    /// rustup does not know the toolchain.
    #[error(
        "rustup has no toolchain {0}: RUST_GPU_TOOLCHAIN must be the name of one in `rustup toolchain list`"
    )]
    NoToolchain(String),
    /// rust-gpu could not be installed.
    #[error(
        "shaders are compiled by rust-gpu {RUST_GPU}, which could not be installed: {0}. It needs rustup, a network \
         and a C++ compiler. If you have it built already, set RUST_GPU_TOOLCHAIN to the name of its toolchain in \
         rustup and RUSTC_CODEGEN_SPIRV to the path of its librustc_codegen_spirv.so"
    )]
    Install(String),
    /// A program could not be started.
    #[error("{0} cannot be run; it must be in PATH")]
    Program(&'static str, #[source] io::Error),
    /// A file could not be read or written.
    #[error("{} cannot be read or written", .0.display())]
    File(PathBuf, #[source] io::Error),
    /// rust-gpu refused the crate.
    #[error("rust-gpu did not compile {}: its messages are above", .0.display())]
    Compile(PathBuf, #[source] Box<dyn error::Error + Send + Sync>),
    /// These are no bytes of SPIR-V as rust-gpu writes it.
    #[error("not a module as rust-gpu writes it: {0}")]
    Damaged(String),
    /// The lint found something.
    #[error("devices would differ in results, or fail:{}", list(.0))]
    Refused(Vec<Finding>),
    /// spirv-val is not there.
    #[error("spirv-val is not installed: apt install spirv-tools (or your system's package of that name)")]
    NoValidator,
    /// spirv-val refused the module.
    #[error("not valid for Vulkan 1.2; spirv-val says: {0}")]
    Invalid(String),
}

fn list(findings: &[Finding]) -> String {
    findings.iter().map(|finding| format!("\n  {finding}")).collect()
}
