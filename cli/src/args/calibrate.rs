//! What `raykd calibrate` can be told.

use super::WhichArgs;
use clap::Parser;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  raykd calibrate                               all devices, into the cache
  raykd calibrate --device cpu -o cpu.json      one device, into a file
  raykd render dragon -o d.png --quality auto   uses what was measured
  raykd calibrate --check teapot dragon sponza  was auto right?";

/// Measure what trees cost on this machine's devices, for --quality auto, and keep that in the user's cache.
///
/// Leaning teapots of some sizes are built and traced by every choice that auto has. The cache is the folder named by
/// RAYKD_CACHE, or raykd in the system's. --check measures scenes instead, and tells how well auto would do there; more
/// than a million rays are not traced: the rate goes on.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CalibrateArgs {
    /// Write the costs of one device to this file, not to the cache
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Compare auto's choices with the best in hindsight, for 1e3 to 1e9 rays at these scenes
    #[arg(long, value_name = "SCENE", num_args = 1.., conflicts_with = "output")]
    pub check: Vec<String>,
    #[command(flatten)]
    pub on: WhichArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
