//! `cargo xtask kernels`, which is a program of its own: the compiler's parts take a minute to build.

use crate::test::execute;
use anyhow::Result;
use std::{env, path::Path, process::Command};

/// Arguments of `cargo xtask kernels`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Compile and compare with the committed files instead of writing them.
    #[arg(long)]
    check: bool,
}

/// Builds that program, `xtask/kernels`, and runs it.
pub(crate) fn run(args: &Args, root: &Path) -> Result<()> {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["run", "--quiet", "--package", "xtask-kernels", "--"]).args(args.check.then_some("--check"));
    execute(cargo.current_dir(root))
}
