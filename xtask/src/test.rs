//! `cargo xtask test`: every test, on a machine that may have no GPU.

use anyhow::{Context as _, Result, ensure};
use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};
use xtask::LEFT_OUT;

/// What the loader and a software rasteriser are called on Debian and Ubuntu.
const PACKAGES: [&str; 2] = ["mesa-vulkan-drivers", "libvulkan1"];

/// Arguments of `cargo xtask test`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Passed on to `cargo test --workspace`, for example a test's name.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    cargo: Vec<String>,
}

/// Sees to a Vulkan driver and runs the tests; without an adapter they fail rather than skip.
pub(crate) fn run(args: &Args, root: &Path) -> Result<()> {
    if !has_vulkan_driver() {
        install_driver()?;
    }
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    execute(
        Command::new(cargo)
            .args(["test", "--workspace"])
            .args(LEFT_OUT.map(|package| format!("--exclude={package}")))
            .args(&args.cargo)
            .env("RAYKD_REQUIRE_GPU", "1")
            .current_dir(root),
    )
}

/// Whether the Vulkan loader would find a driver: one is named in the environment or has a manifest in one of
/// the loader's directories.
fn has_vulkan_driver() -> bool {
    let named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().filter_map(env::var_os);
    if named.flat_map(|files| env::split_paths(&files).collect::<Vec<_>>()).any(|file| file.exists()) {
        return true;
    }
    let home = env::var_os("HOME").map(|home| PathBuf::from(home).join(".local/share"));
    let shares = ["/etc", "/usr/share", "/usr/local/share", "/usr/local/etc"].map(PathBuf::from);
    shares.into_iter().chain(home).map(|share| share.join("vulkan/icd.d")).any(|dir| {
        fs::read_dir(dir).is_ok_and(|files| {
            files.flatten().any(|file| file.path().extension().is_some_and(|extension| extension == "json"))
        })
    })
}

/// Installs Mesa's drivers, among them a software rasteriser, where apt-get can.
fn install_driver() -> Result<()> {
    ensure!(
        runs("apt-get", "--version"),
        "no Vulkan driver found, and the tests compare CPU and GPU. Install your graphics card's driver or \
         Mesa's software rasteriser (Fedora: mesa-vulkan-drivers, Arch: vulkan-swrast)"
    );
    // Root needs no sudo, which minimal systems do not have.
    let root = Command::new("id").arg("-u").output().is_ok_and(|id| id.stdout == b"0\n");
    ensure!(
        root || runs("sudo", "--version"),
        "no Vulkan driver found; as root, run: apt-get install {}",
        PACKAGES.join(" ")
    );
    let apt = || {
        let mut command = Command::new(if root { "env" } else { "sudo" });
        command.args(if root { &[][..] } else { &["env"][..] });
        command.args(["DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq", "-o", "Dpkg::Use-Pty=0"]);
        command
    };
    println!(
        "no Vulkan driver found: installing {} (a software rasteriser) by apt-get",
        PACKAGES.join(" and ")
    );
    execute(apt().arg("update"))?;
    execute(apt().args(["install", "--yes", "--no-install-recommends"]).args(PACKAGES))
}

fn runs(program: &str, argument: &str) -> bool {
    Command::new(program).arg(argument).output().is_ok_and(|out| out.status.success())
}

pub(crate) fn execute(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("running {:?}", command.get_program()))?;
    ensure!(status.success(), "{command:?} failed");
    Ok(())
}
