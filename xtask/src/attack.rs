//! `cargo xtask attack`: hostile meshes, names, limits and moments, and what raykd makes of them.

use anyhow::{Context as _, Result, ensure};
use std::{env, path::Path, process::Command};
use xtask::LEFT_OUT;

/// Arguments of `cargo xtask attack`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Attack what is built with optimisation and without debug checks
    #[arg(long)]
    release: bool,
    /// Only cases whose names contain one of these, for example limits/ or library/
    names: Vec<String>,
}

/// Builds the program and its attacker (`tests/src/bin/attack`), and lets it loose.
pub(crate) fn run(args: &Args, root: &Path) -> Result<()> {
    let mut build = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.args(["build", "--workspace", "--bin", "attack", "--bin", "raykd"]).current_dir(root);
    build.args(LEFT_OUT.map(|package| format!("--exclude={package}")));
    build.args(args.release.then_some("--release"));
    let status = build.status().context("cannot run cargo")?;
    ensure!(status.success(), "the program or its attacker does not compile");
    // Beside this program's folder: target/debug or target/release.
    let this = env::current_exe().context("where is this program?")?;
    let target = this.ancestors().nth(2).context("this program lies in no target folder")?;
    let attack = target.join(if args.release { "release" } else { "debug" }).join("attack");
    let status = Command::new(&attack).args(&args.names).current_dir(root).status();
    let status = status.with_context(|| format!("cannot run {}", attack.display()))?;
    ensure!(status.success(), "raykd did not stand the attack");
    Ok(())
}
