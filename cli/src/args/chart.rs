//! What `raykd chart` can be told.

use super::WhichArgs;
use clap::Parser;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  raykd chart --quick                           the teapot, into charts/index.html
  raykd chart dragon sponza stadium -o out      three scenes
  raykd chart dragon --peers peers.json         other crates too, see peers/README.md
  raykd chart teapot --device cpu --rays 4096   small";

/// Measure scenes, and draw what raykd knows about itself: one page without links, and SVG, PNG and CSV files.
///
/// The first scene is also traced by every triangle test and traversal. Times are the best of some.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ChartArgs {
    /// Scene names, mesh files, or stress scenes (`raykd stress --list`); the teapot if there are none
    #[arg(value_name = "SCENE")]
    pub scenes: Vec<String>,
    /// Folder to write index.html and the figures to
    #[arg(short, long, value_name = "DIR", default_value = "charts")]
    pub output: PathBuf,
    /// Less of everything: the teapot within two minutes on two cores
    #[arg(long)]
    pub quick: bool,
    /// About so many rays for each measurement; left out: as many as the device likes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(256..=1 << 26))]
    pub rays: Option<u32>,
    /// What peers/ wrote with --json, for a figure of other crates
    #[arg(long, value_name = "FILE")]
    pub peers: Option<PathBuf>,
    #[command(flatten)]
    pub on: WhichArgs,
}
