//! What `raykd stress` can be told.

use super::{ReadArgs, WhichArgs};
use clap::Parser;
use std::{ffi::OsString, path::PathBuf};

const EXAMPLES: &str = "\
Examples:
  raykd stress                                  all scenes and methods, a minute or less
  raykd stress --list                           what there is
  raykd stress --scene slivers --method exact   one scene, by all ways with the exact test
  raykd stress --scene dragon --method exact    rays at a mesh of one's own, against the exact answers
  raykd stress --scene leaks --rays 1000000000 --method exact/stack --device gpu
                                                a billion rays at each of five surfaces without gaps
  raykd stress --json > f.json; raykd stress --replay f.json
                                                the rays that failed, once more";

/// Trace the scenes in which ray tracers fail, and judge every answer exactly.
///
/// Each scene is traced by each method: a triangle test and a way to find triangles, or a form of the literature
/// with its traps (textbook/..., on the CPU only). A failure is an answer that is not exact even for triangles moved
/// by a few ULP of the distance, a miss where there is no gap, a difference from brute force with the same test or
/// from the CPU's bytes. Exit code 1 if a method fails where it is not known to.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct StressArgs {
    /// Scenes of these names, or meshes as other commands take them; left out: all but leaks
    #[arg(long = "scene", value_name = "NAME", value_delimiter = ',')]
    pub scenes: Vec<OsString>,
    /// Methods whose names start like this; left out: all
    #[arg(long = "method", value_name = "NAME", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Rays a scene; of leaks, a surface
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    pub rays: u64,
    /// Trace the failing rays of an earlier --json output again
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scenes", "methods", "rays"])]
    pub replay: Option<PathBuf>,
    /// List scenes and methods
    #[arg(long, exclusive = true)]
    pub list: bool,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: WhichArgs,
    /// Print JSON: one array, an object per scene, method and device
    #[arg(long)]
    pub json: bool,
}
