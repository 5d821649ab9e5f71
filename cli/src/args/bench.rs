//! What `raykd bench` can be told.

use super::{HowArgs, ReadArgs, WalkArgs, WhichArgs};
use clap::Parser;
use std::{ffi::OsString, path::PathBuf};

const EXAMPLES: &str = "\
Sets of rays, the same on every machine, by which raykd is compared with others:
  a      50,000 from the sphere around the box to uniform points of the box
  b      a picture of 1024 x 1024, pixel centres; teapot, dragons and sponza have cameras of their own
  c      a cosine-distributed bounce from every hit of b
  d      from the same points to a ball light: its closest hit, and whether there is any

Examples:
  raykd bench                                   the teapot on both devices
  raykd bench teapot:30 dragon --rays 1000000   two scenes, a million rays
  raykd bench dragon --device cpu --threads 1   one thread
  raykd bench dragon --intersector moeller      another triangle test, the same rays
  raykd bench dragon --adapter nvidia --profile kernel by kernel on that GPU
  raykd bench dragon --quality auto             what auto builds for the random rays, and what that takes
  raykd bench dragon --json > old.json          then, with a newer raykd:
  raykd bench dragon --compare-with old.json    what has changed, and how sure that is
  raykd bench sponza --json | jq '.[].build_ms'";

/// Build and trace scenes, time both, and compare the devices byte by byte.
///
/// Random rays start on the sphere around the scene and aim into its box, always the same ones. Times are
/// medians of 5 (of 3 where a build takes over 2 s), on the device's clock, transfers apart.
/// Exit code 1 if trees or hits differ between the devices. With --quality auto each device builds what is best there.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct BenchArgs {
    /// Scene names or mesh files; the teapot if there are none
    #[arg(value_name = "SCENE")]
    pub scenes: Vec<OsString>,
    /// Random rays to trace
    #[arg(long, value_name = "N", default_value_t = 50_000, value_parser = clap::value_parser!(u32).range(1..=1 << 28))]
    pub rays: u32,
    #[command(flatten)]
    pub walk: WalkArgs,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: WhichArgs,
    #[command(flatten)]
    pub how: HowArgs,
    /// Print JSON: one array, an object per scene and device
    #[arg(long)]
    pub json: bool,
    /// Time every kernel of the build too; with the cargo feature traffic, tell what it moves
    #[arg(long)]
    pub profile: bool,
    /// Measure three times, and tell how that differs from what another version wrote with --json
    #[arg(long, value_name = "FILE.json", conflicts_with = "profile")]
    pub compare_with: Option<PathBuf>,
}
