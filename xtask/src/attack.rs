//! `cargo xtask attack`: hostile meshes, trees, places, limits and moments, and what raykd makes of them.

use anyhow::{Context as _, Result, ensure};
use std::{env, path::Path, process::Command};

/// Arguments of `cargo xtask attack`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Attack what is built with optimisation and without debug checks
    #[arg(long)]
    release: bool,
    /// Only cases whose names contain one of these, for example limits/ or tree/
    names: Vec<String>,
}

/// Builds the program and its attacker (`tests/src/bin/attack`), and lets it loose.
pub(crate) fn run(args: &Args, root: &Path) -> Result<()> {
    let cargo = |task: &str| {
        let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        command.args([task, "--workspace", "--bin", "attack"]).current_dir(root);
        command.args(args.release.then_some("--release"));
        command
    };
    let mut build = cargo("build");
    let status = build.args(["--bin", "raykd"]).status().context("cannot run cargo")?;
    ensure!(status.success(), "the program or its attacker does not compile");
    let mut attack = cargo("run");
    let status = attack.arg("--quiet").arg("--").args(&args.names).status().context("cannot run cargo")?;
    ensure!(status.success(), "raykd did not stand the attack");
    Ok(())
}
