//! What `cargo xtask kernels` runs: raykd's kernels by `raykd-spirv`, and a manifest of what it made.

use anyhow::{Context as _, Result, ensure};
use clap::Parser as _;
use raykd_spirv::{Compiled, Compiler, RUST_GPU, TARGET};
use std::{env, fs, path::Path};
use xtask::{EntryPoint, MANIFEST, MODULE, Manifest, sha256, sources_digest};

/// Compile the kernels to SPIR-V: kernels/spv/raykd.spv and its manifest.
#[derive(Debug, clap::Parser)]
struct Args {
    /// Compile and compare with the committed files instead of writing them.
    #[arg(long)]
    check: bool,
}

/// Compiles the kernels and writes or compares module and manifest.
fn main() -> Result<()> {
    // SAFETY: this program has one thread.
    unsafe { raykd_spirv::set_environment() };
    let args = Args::parse();
    let root =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).context("this lies in the repository")?;
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |dir| root.join(dir));
    // Before compiling: an edit made meanwhile must make the module count as old.
    let sources_sha256 = sources_digest(root)?;

    let compiler = Compiler::new(root.join("kernels")).target_dir(&target).features(["entry-points"]);
    let Compiled { module, rustc, .. } = compiler.compile()?;
    let fresh = target.join("spirv/raykd.spv");
    fs::write(&fresh, &module.bytes)?;
    let entry_point = |entry: raykd_spirv::EntryPoint| {
        let workgroup = entry.workgroup.with_context(|| format!("{} has no workgroup size", entry.name))?;
        Ok(EntryPoint { name: entry.name, workgroup })
    };
    let manifest = Manifest {
        sources_sha256,
        module_sha256: sha256(&module.bytes),
        module_bytes: module.bytes.len(),
        rust_gpu: RUST_GPU.to_owned(),
        rustc,
        target: TARGET.to_owned(),
        exact_float_ops: module.exact_float_ops,
        entry_points: module.entry_points.into_iter().map(entry_point).collect::<Result<_>>()?,
    };
    if args.check {
        compare(root, &manifest, &module.bytes, &fresh)?;
        println!("{MODULE} is what the sources compile to");
    } else {
        let path = root.join(MODULE);
        fs::create_dir_all(path.parent().context("the module lies in a directory")?)?;
        fs::write(path, &module.bytes)?;
        fs::write(root.join(MANIFEST), serde_json::to_string_pretty(&manifest)? + "\n")?;
        println!(
            "{MODULE}: {} kernels, {} bytes, {} float operations",
            manifest.entry_points.len(),
            manifest.module_bytes,
            manifest.exact_float_ops
        );
    }
    Ok(())
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
