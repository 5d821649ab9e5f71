//! What `cargo xtask kernels` runs: from Rust to a module that computes the same bytes on every device.

mod lint;
mod postpass;
mod toolchain;

use anyhow::{Context as _, Result, bail, ensure};
use clap::Parser as _;
use rspirv::{
    binary::Assemble as _,
    dr::{Module, Operand},
    spirv::ExecutionMode,
};
use spirv_builder::{Capability, ModuleResult, SpirvBuilder, SpirvMetadata};
use std::{
    env, fs, io,
    path::{Path, PathBuf},
    process::Command,
};
use toolchain::{RUST_GPU, Toolchain};
use xtask::{EntryPoint, MANIFEST, MODULE, Manifest, sha256, sources_digest};

/// Vulkan 1.2, that is SPIR-V 1.5.
const TARGET: &str = "spirv-unknown-vulkan1.2";

/// Environment of the compiler.
const ENVIRONMENT: [(&str, &str); 3] = [
    // rust-gpu inlines deeply.
    ("RUST_MIN_STACK", "33554432"),
    // Line tables would be stripped again, and would hold paths until then.
    ("CARGO_PROFILE_RELEASE_DEBUG", "0"),
    ("CARGO_PROFILE_RELEASE_LTO", "off"),
];

/// Compile the kernels to SPIR-V: kernels/spv/raykd.spv and its manifest.
#[derive(Debug, clap::Parser)]
struct Args {
    /// Compile and compare with the committed files instead of writing them.
    #[arg(long)]
    check: bool,
}

/// Compiles the kernels and writes or compares module and manifest.
fn main() -> Result<()> {
    let args = Args::parse();
    let root =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).context("this lies in the repository")?;
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |dir| root.join(dir));
    let toolchain = toolchain::find(&target)?;
    // Before compiling: an edit made meanwhile must make the module count as old.
    let sources_sha256 = sources_digest(root)?;

    let compiled = compile(root, &target, &toolchain)?;
    let bytes = fs::read(&compiled).with_context(|| format!("reading {}", compiled.display()))?;
    let mut module = rspirv::dr::load_bytes(bytes).map_err(|e| anyhow::anyhow!("rust-gpu's module: {e}"))?;
    let exact_float_ops = postpass::run(&mut module)?;
    let findings = lint::check(&module);
    if !findings.is_empty() {
        let list: Vec<String> = findings.iter().map(|f| format!("  {f}")).collect();
        bail!("devices would differ in results, or fail:\n{}", list.join("\n"));
    }
    let module_bytes: Vec<u8> = module.assemble().into_iter().flat_map(u32::to_le_bytes).collect();
    let fresh = target.join("spirv/raykd.spv");
    fs::write(&fresh, &module_bytes)?;
    validate(&fresh)?;

    let manifest = Manifest {
        sources_sha256,
        module_sha256: sha256(&module_bytes),
        module_bytes: module_bytes.len(),
        rust_gpu: RUST_GPU.to_owned(),
        rustc: toolchain.rustc,
        target: TARGET.to_owned(),
        exact_float_ops,
        entry_points: entry_points(&module)?,
    };
    if args.check {
        compare(root, &manifest, &module_bytes, &fresh)?;
        println!("{MODULE} is what the sources compile to");
    } else {
        let path = root.join(MODULE);
        fs::create_dir_all(path.parent().context("the module lies in a directory")?)?;
        fs::write(path, &module_bytes)?;
        fs::write(root.join(MANIFEST), serde_json::to_string_pretty(&manifest)? + "\n")?;
        println!(
            "{MODULE}: {} kernels, {} bytes, {exact_float_ops} float operations",
            manifest.entry_points.len(),
            manifest.module_bytes
        );
    }
    Ok(())
}

/// Runs rust-gpu; returns the path of the raw module.
fn compile(root: &Path, target: &Path, toolchain: &Toolchain) -> Result<PathBuf> {
    for (name, value) in ENVIRONMENT {
        // SAFETY: this program has one thread.
        unsafe { env::set_var(name, value) };
    }
    // Declaring the float controls keeps rust-gpu's own optimiser from rearranging floats.
    let mut builder = SpirvBuilder::new(root.join("kernels"), TARGET)
        .rustc_codegen_spirv_location(&toolchain.backend)
        .target_dir_path(target.join("spirv"))
        .release(true)
        .multimodule(false)
        .spirv_metadata(SpirvMetadata::None)
        .capability(Capability::SignedZeroInfNanPreserve)
        .capability(Capability::RoundingModeRTE);
    builder.toolchain_overwrite = Some(toolchain.name.clone());
    builder.build_script.defaults = false;
    match builder.build().context("compiling the kernels with rust-gpu (its messages are above)")?.module {
        ModuleResult::SingleModule(path) => Ok(path),
        ModuleResult::MultiModule(_) => bail!("rust-gpu wrote several modules"),
    }
}

/// Runs `spirv-val`. An invalid module would show up as a lost device.
fn validate(module: &Path) -> Result<()> {
    match Command::new("spirv-val").args(["--target-env", "vulkan1.2"]).arg(module).status() {
        Ok(status) => ensure!(status.success(), "{} is not valid for Vulkan 1.2", module.display()),
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            bail!(
                "spirv-val is not installed: apt install spirv-tools (or your system's package of that name)"
            )
        }
        Err(e) => return Err(e).context("running spirv-val"),
    }
    Ok(())
}

/// Names and workgroup sizes, in the order of the module.
fn entry_points(module: &Module) -> Result<Vec<EntryPoint>> {
    module
        .entry_points
        .iter()
        .map(|entry| {
            let Operand::LiteralString(name) = &entry.operands[2] else {
                bail!("an entry point has no name")
            };
            let size = module
                .execution_modes
                .iter()
                .find(|mode| {
                    mode.operands[0] == entry.operands[1]
                        && mode.operands[1] == Operand::ExecutionMode(ExecutionMode::LocalSize)
                })
                .with_context(|| format!("{name} has no workgroup size"))?;
            let mut workgroup = [1; 3];
            for (side, operand) in workgroup.iter_mut().zip(&size.operands[2..]) {
                let Operand::LiteralBit32(n) = operand else { bail!("{name}: odd workgroup size") };
                *side = *n;
            }
            Ok(EntryPoint { name: name.clone(), workgroup })
        })
        .collect()
}

/// Compares what was just compiled with what is committed.
fn compare(root: &Path, fresh: &Manifest, bytes: &[u8], at: &Path) -> Result<()> {
    let committed = Manifest::read(root)?;
    ensure!(
        fresh.sources_sha256 == committed.sources_sha256,
        "{MODULE} is older than the kernel sources: run `cargo xtask kernels` and commit kernels/spv"
    );
    let module = fs::read(root.join(MODULE)).with_context(|| format!("reading {MODULE}"))?;
    ensure!(
        module == bytes,
        "{MODULE} is not what its sources compile to (that is now in {}). Committed: {}; now: {}. \
         Run `cargo xtask kernels` and commit kernels/spv",
        at.display(),
        committed.rustc,
        fresh.rustc
    );
    // Another build of the same compiler may call itself otherwise.
    let committed = Manifest { rustc: fresh.rustc.clone(), ..committed };
    ensure!(*fresh == committed, "{MANIFEST} does not describe {MODULE}: run `cargo xtask kernels`");
    Ok(())
}
