//! From a shader crate to a finished module.

use crate::{Error, Module, TARGET, finish, toolchain};
use spirv_builder::{Capability, ModuleResult, SpirvBuilder, SpirvMetadata};
use std::{
    env, fs,
    io::{ErrorKind, Write as _},
    path::{self, PathBuf},
    process::{Command, Stdio},
};

/// Environment of the compiler.
const ENVIRONMENT: [(&str, &str); 3] = [
    // rust-gpu inlines deeply.
    ("RUST_MIN_STACK", "33554432"),
    // Line tables would be stripped again, and would hold paths until then.
    ("CARGO_PROFILE_RELEASE_DEBUG", "0"),
    ("CARGO_PROFILE_RELEASE_LTO", "off"),
];

/// Sets what rust-gpu needs in the environment of the process: room on the stack for its deep inlining, and neither
/// debug info nor link-time optimisation, whatever the crate's release profile says. For the start of `main`, in a
/// program that calls [`Compiler::compile`].
///
/// # Safety
/// The process has no other thread.
pub unsafe fn set_environment() {
    for (name, value) in ENVIRONMENT {
        // SAFETY: as the caller promises.
        unsafe { env::set_var(name, value) };
    }
}

/// Compiles a shader crate by rust-gpu, and [finishes](finish) and [validates](validate) the module.
///
/// The toolchain is the one that the environment variables `RUST_GPU_TOOLCHAIN` (its name in rustup) and
/// `RUSTC_CODEGEN_SPIRV` (the path of its `librustc_codegen_spirv.so`) name. Without them rustup installs the nightly
/// that rust-gpu is made for, and rust-gpu is built with it, once for each target folder.
#[derive(Clone, Debug)]
pub struct Compiler {
    crate_dir: PathBuf,
    target_dir: PathBuf,
    features: Vec<String>,
    doubles: bool,
}

/// What a [`Compiler`] made.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Compiled {
    /// The module.
    pub module: Module,
    /// What the compiler calls itself.
    pub rustc: String,
}

impl Compiler {
    /// For the crate in this folder.
    pub fn new(crate_dir: impl Into<PathBuf>) -> Self {
        let crate_dir = crate_dir.into();
        let target_dir = crate_dir.join("target");
        Self { crate_dir, target_dir, features: Vec::new(), doubles: false }
    }

    /// Compiles in this folder, by default `target` in the crate's.
    pub fn target_dir(mut self, target_dir: impl Into<PathBuf>) -> Self {
        self.target_dir = target_dir.into();
        self
    }

    /// Switches on features of the crate.
    pub fn features<T: Into<String>>(mut self, features: impl IntoIterator<Item = T>) -> Self {
        self.features.extend(features.into_iter().map(Into::into));
        self
    }

    /// The crate may compute with doubles, and the module is for devices that have them. They are for numbers that
    /// carry bounds of their errors: of those that Vulkan lets a device round as it likes, `fma` is not refused.
    pub fn doubles(mut self) -> Self {
        self.doubles = true;
        self
    }

    /// Compiles the crate. What rust-gpu says goes to the standard error output. See [`set_environment`].
    ///
    /// # Errors
    /// No toolchain, a crate that rust-gpu refuses, [`Error::Refused`], or spirv-val is missing or not content.
    pub fn compile(&self) -> Result<Compiled, Error> {
        let absolute = |path: &PathBuf| path::absolute(path).map_err(|e| Error::File(path.clone(), e));
        let (crate_dir, target_dir) = (absolute(&self.crate_dir)?, absolute(&self.target_dir)?);
        // Before a toolchain is installed for nothing.
        let manifest = crate_dir.join("Cargo.toml");
        fs::metadata(&manifest).map_err(|e| Error::File(manifest, e))?;
        let toolchain = toolchain::find(&target_dir)?;
        // Declaring the float controls keeps rust-gpu's own optimiser from rearranging floats.
        let mut builder = SpirvBuilder::new(&crate_dir, TARGET)
            .rustc_codegen_spirv_location(&toolchain.backend)
            .target_dir_path(target_dir.join("spirv"))
            .release(true)
            .multimodule(false)
            .spirv_metadata(SpirvMetadata::None)
            .shader_crate_features(self.features.clone())
            .capability(Capability::SignedZeroInfNanPreserve)
            .capability(Capability::RoundingModeRTE);
        if self.doubles {
            builder = builder.capability(Capability::Float64);
        }
        builder.toolchain_overwrite = Some(toolchain.name);
        builder.build_script.defaults = false;
        let built = builder.build().map_err(|e| Error::Compile(crate_dir, e.into()))?;
        let ModuleResult::SingleModule(path) = built.module else {
            return Err(Error::Damaged("there are several".to_owned()));
        };
        let module = finish(&fs::read(&path).map_err(|e| Error::File(path, e))?)?;
        validate(&module.bytes)?;
        Ok(Compiled { module, rustc: toolchain.rustc })
    }
}

/// Has `spirv-val` look at a module. An invalid one would show up as a lost device.
///
/// # Errors
/// It is not valid for Vulkan 1.2, or `spirv-val` is not installed.
pub fn validate(spirv: &[u8]) -> Result<(), Error> {
    let failed = |e| Error::Program("spirv-val", e);
    let mut command = Command::new("spirv-val");
    command.args(["--target-env", "vulkan1.2", "-"]).stdin(Stdio::piped());
    let mut child = match command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn() {
        Err(e) if e.kind() == ErrorKind::NotFound => return Err(Error::NoValidator),
        child => child.map_err(failed)?,
    };
    // It reads all before it writes.
    if let Some(mut stdin) = child.stdin.take() {
        stdin.write_all(spirv).map_err(failed)?;
    }
    let output = child.wait_with_output().map_err(failed)?;
    if output.status.success() {
        return Ok(());
    }
    let said = [output.stdout, output.stderr].concat();
    Err(Error::Invalid(String::from_utf8_lossy(&said).trim().to_owned()))
}
