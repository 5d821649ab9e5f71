//! `cargo xtask web`, which is a program of its own: what makes bindings takes a minute to build.

use crate::test::execute;
use anyhow::Result;
use std::{env, path::Path, process::Command};

/// Builds that program, `xtask/web`, and runs it.
pub(crate) fn run(root: &Path) -> Result<()> {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    execute(cargo.args(["run", "--quiet", "--package", "xtask-web"]).current_dir(root))
}
