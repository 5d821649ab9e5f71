//! `cargo xtask`: what a checkout needs beyond cargo itself.

use anyhow::Context as _;
use clap::{Parser, Subcommand};
use std::path::Path;

mod attack;
mod kernels;
mod results;
mod scenes;
mod test;
mod web;

/// Chores of the raykd checkout.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Compile the kernels to SPIR-V: the modules in kernels/spv and their manifest.
    Kernels(kernels::Args),
    /// Write docs/results.md from the measurements in docs/results.
    Results(results::Args),
    /// Get the Stanford dragons and Sponza.
    Scenes(scenes::Args),
    /// Try to bring raykd down: hostile meshes, names, limits and moments, each answer judged.
    Attack(attack::Args),
    /// Compile raykd to WebAssembly for JavaScript: web/pkg.
    Web,
    /// Run every test; where no Vulkan driver is found, install a software one first.
    Test(test::Args),
}

fn main() -> anyhow::Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("xtask lies in the repository")?;
    match Cli::parse().task {
        Task::Kernels(args) => kernels::run(&args, root),
        Task::Results(args) => results::run(&args, root),
        Task::Scenes(args) => scenes::run(&args, root),
        Task::Web => web::run(root),
        Task::Attack(args) => attack::run(&args, root),
        Task::Test(args) => test::run(&args, root),
    }
}
