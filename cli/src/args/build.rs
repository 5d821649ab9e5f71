//! What `raykd build` can be told.

use super::{HowArgs, OneArgs, ReadArgs};
use clap::Parser;
use std::{ffi::OsString, path::PathBuf};

const EXAMPLES: &str = "\
Examples:
  raykd build dragon                            statistics of the tree
  raykd build mesh.ply.gz -o mesh.kd            save it, for raykd trace --tree or the crate raykd-shared
  raykd build mesh.obj --cost-test 2 --json     dearer triangle tests: more nodes, shorter leaves
  raykd build sponza --builder exact            the best tree, more slowly
  raykd build --compare dragon                  every builder on CPU and GPU, in a table
  raykd build --scaling                         how build time grows with the mesh";

/// Build the tree of a mesh, and print its statistics and digest; or compare builders.
///
/// --compare builds by every builder on CPU and GPU and traces a picture's rays and a bounce from each hit; exit code
/// 1 if a builder's trees differ. --scaling builds teapots of a thousand to ten million triangles.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct BuildArgs {
    /// Scene name or mesh file
    #[arg(required_unless_present = "scaling")]
    pub mesh: Option<OsString>,
    /// Save the tree to this file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Compare all builders on CPU and GPU
    #[arg(long, conflicts_with_all = ["output", "builder", "profile", "scaling", "quality"])]
    pub compare: bool,
    /// Build teapots of many sizes on CPU and GPU
    #[arg(long, conflicts_with_all = ["output", "profile", "mesh", "quality"])]
    pub scaling: bool,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: OneArgs,
    #[command(flatten)]
    pub how: HowArgs,
    /// With --quality auto: how many rays the tree is for; left out: a million
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: Option<u64>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Time every kernel too; with the cargo feature traffic, tell what it moves
    #[arg(long)]
    pub profile: bool,
}
