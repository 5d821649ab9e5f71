//! Compiles the crate `raykd-web` and makes the npm package's `web/pkg` of it: the module, its JavaScript and types.

use anyhow::{Context as _, Result, ensure};
use std::{env, fs, path::Path, process::Command};
use wasm_bindgen_cli_support::Bindgen;

/// The target, as rustup calls it.
const TARGET: &str = "wasm32-unknown-unknown";

fn main() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?;
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let folder = root.join("target/web");
    let status = Command::new(cargo)
        .args(["build", "--locked", "--package", "raykd-web", "--profile", "dist", "--target", TARGET])
        // Vectors of four floats, which all browsers have; nothing is fused.
        .args(["--config", "target.wasm32-unknown-unknown.rustflags=['-Ctarget-feature=+simd128']"])
        .args(["--config", "profile.dist.panic='abort'"])
        // Rays never run what the registry's crates do: parsing, printing, sorting.
        .args(["--config", "profile.dist.package.\"*\".opt-level='s'"])
        // Nor do they run what tells the way of one ray, judges hits in stress scenes, or hands arrays to JavaScript.
        .args(["--config", "profile.dist.package.raykd-ways.opt-level='s'"])
        .args(["--config", "profile.dist.package.raykd-oracle.opt-level='s'"])
        .args(["--config", "profile.dist.package.raykd-web.opt-level='s'", "--target-dir"])
        .arg(&folder)
        .current_dir(&root)
        .status()
        .context("running cargo")?;
    ensure!(status.success(), "the build failed; if the target is missing: rustup target add {TARGET}");
    let out = root.join("web/pkg");
    Bindgen::new()
        .input_path(folder.join(TARGET).join("dist/raykd_web.wasm"))
        .web(true)?
        .typescript(true)
        .remove_name_section(true)
        .remove_producers_section(true)
        .out_name("raykd")
        .generate(&out)?;
    let bytes = fs::metadata(out.join("raykd_bg.wasm"))?.len();
    println!("web/pkg: raykd.js, raykd.d.ts, raykd_bg.wasm of {} kB", bytes.div_ceil(1000));
    Ok(())
}
