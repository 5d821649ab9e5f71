//! What `cargo xtask kernels` runs: raykd's kernels by `raykd-spirv`, and a manifest of what it made.

use anyhow::{Context as _, Result, ensure};
use clap::Parser as _;
use raykd_spirv::{Compiled, Compiler, RUST_GPU, TARGET};
use std::{env, fs, iter::zip, path::Path};
use xtask::{Contents, EntryPoint, MANIFEST, MODULES, Manifest, sha256, sources_digest};

/// Compile the kernels to SPIR-V: the modules in kernels/spv and their manifest.
#[derive(Debug, clap::Parser)]
struct Args {
    /// Compile and compare with the committed files instead of writing them.
    #[arg(long)]
    check: bool,
}

/// Compiles the kernels and writes or compares modules and manifest.
fn main() -> Result<()> {
    // SAFETY: this program has one thread.
    unsafe { raykd_spirv::set_environment() };
    let args = Args::parse();
    let root =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).context("this lies in the repository")?;
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |dir| root.join(dir));
    // Before compiling: an edit made meanwhile must make the modules count as old.
    let sources_sha256 = sources_digest(root)?;

    let compiler = Compiler::new(root.join("kernels")).target_dir(&target);
    let (mut made, mut modules, mut compiled_by) = (Vec::new(), Vec::new(), String::new());
    for module in MODULES {
        let compiler = compiler.clone().features([module.feature]);
        let compiler = if module.doubles { compiler.doubles() } else { compiler };
        let Compiled { module, rustc, .. } = compiler.compile()?;
        let entry_point = |entry: raykd_spirv::EntryPoint| {
            let workgroup =
                entry.workgroup.with_context(|| format!("{} has no workgroup size", entry.name))?;
            Ok(EntryPoint { name: entry.name, workgroup })
        };
        modules.push(Contents {
            sha256: sha256(&module.bytes),
            bytes: module.bytes.len(),
            exact_float_ops: module.exact_float_ops,
            entry_points: module.entry_points.into_iter().map(entry_point).collect::<Result<_>>()?,
        });
        made.push(module.bytes);
        compiled_by = rustc;
    }
    let manifest = Manifest {
        sources_sha256,
        rust_gpu: RUST_GPU.to_owned(),
        rustc: compiled_by,
        target: TARGET.to_owned(),
        modules,
    };
    if args.check {
        return compare(root, &manifest, &made, &target);
    }
    for ((module, bytes), contents) in zip(zip(MODULES, &made), &manifest.modules) {
        let path = root.join(module.path);
        fs::create_dir_all(path.parent().context("the module lies in a directory")?)?;
        fs::write(path, bytes)?;
        println!(
            "{}: {} kernels, {} bytes, {} float operations",
            module.path,
            contents.entry_points.len(),
            contents.bytes,
            contents.exact_float_ops
        );
    }
    fs::write(root.join(MANIFEST), serde_json::to_string_pretty(&manifest)? + "\n")?;
    Ok(())
}

/// Compares what was just compiled with what is committed.
fn compare(root: &Path, fresh: &Manifest, made: &[Vec<u8>], target: &Path) -> Result<()> {
    let committed = Manifest::read(root)?;
    ensure!(
        fresh.sources_sha256 == committed.sources_sha256,
        "kernels/spv is older than the kernel sources: run `cargo xtask kernels` and commit kernels/spv"
    );
    for (path, bytes) in zip(MODULES.map(|module| module.path), made) {
        let module = fs::read(root.join(path)).with_context(|| format!("reading {path}"))?;
        let at = target.join("spirv").join(Path::new(path).file_name().context("it is a file")?);
        fs::write(&at, bytes)?;
        ensure!(
            module == *bytes,
            "{path} is not what its sources compile to (that is now in {}). Committed: {}; now: {}. \
             Run `cargo xtask kernels` and commit kernels/spv",
            at.display(),
            committed.rustc,
            fresh.rustc
        );
        println!("{path} is what the sources compile to");
    }
    // Another build of the same compiler may call itself otherwise.
    let committed = Manifest { rustc: fresh.rustc.clone(), ..committed };
    ensure!(*fresh == committed, "{MANIFEST} does not describe the modules: run `cargo xtask kernels`");
    Ok(())
}
