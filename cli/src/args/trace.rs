//! What `raykd trace` can be told.

use super::{HowArgs, OneArgs, ReadArgs, WalkArgs};
use clap::{Parser, ValueEnum};
use std::{ffi::OsString, path::PathBuf};

const EXAMPLES: &str = "\
Rays: records of 8 little-endian f32: origin x y z, direction x y z, t_min, t_max (may be
infinite), in the mesh's own coordinates; with --f64, of 8 f64. Hits: records of u32 triangle
(0xFFFFFFFF: none), f32 t, f32 u, f32 v, one a ray, in the order of the rays. Triangles are
numbered from 0 in file order. Rays that are none (NaN, zero direction) miss and are counted.
--query all writes LIMIT records a ray, by rising t, the rest of them misses; --query count writes
one u32 a ray.

Examples:
  raykd trace mesh.ply --rays rays.bin --hits hits.bin
  raykd trace mesh.ply --rays rays.bin --hits hits.bin --any --device cpu --threads 1
  raykd trace mesh.ply --rays rays.bin --hits hits.bin --query all --limit 4
  raykd trace --compare dragon                  every traversal on CPU and GPU, in a table
  raykd trace --compare teapot --brute          brute force too
  raykd trace mesh.ply --tree mesh.kd --rays rays.bin --hits hits.bin --json";

/// Trace a file of rays, and write a file of hits; or compare all traversals.
///
/// Times are medians of 5 traces, on the device's clock, transfers apart. --compare takes a picture's rays, or
/// those of a file, one diffuse bounce from each hit, and one shadow ray; exit code 1 if any hits differ.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct TraceArgs {
    /// Scene name or mesh file
    pub mesh: OsString,
    /// File of rays
    #[arg(long, value_name = "FILE", required_unless_present = "compare")]
    pub rays: Option<PathBuf>,
    /// Rays are records of f64, for meshes whose coordinates have more digits than f32
    #[arg(long, requires = "rays")]
    pub f64: bool,
    /// File of hits to write
    #[arg(long, value_name = "FILE", required_unless_present = "compare")]
    pub hits: Option<PathBuf>,
    /// Use this tree, saved by raykd build -o, rather than building one
    #[arg(long, value_name = "FILE", conflicts_with_all = ["TreeArgs", "quality"])]
    pub tree: Option<PathBuf>,
    /// What to ask of each ray
    #[arg(long, value_enum, default_value_t = Ask::Closest)]
    pub query: Ask,
    /// Short for --query any
    #[arg(long, conflicts_with = "query")]
    pub any: bool,
    /// With --query all: hits a ray to write; left out: 8
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub limit: Option<u32>,
    #[command(flatten)]
    pub walk: WalkArgs,
    /// Compare all traversals on CPU and GPU, rather than write hits
    #[arg(long, conflicts_with_all = ["hits", "tree", "query", "any", "limit", "traversal", "intersector", "quality"])]
    pub compare: bool,
    /// With --compare: brute force too, which takes hours where the others take a second; for small scenes and few rays
    #[arg(long)]
    pub brute: bool,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: OneArgs,
    #[command(flatten)]
    pub how: HowArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// What is asked of each ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Ask {
    /// The hit with the smallest t, the lowest triangle of several
    Closest,
    /// Some hit
    Any,
    /// How many hits there are
    Count,
    /// The first hits, up to a limit
    All,
}
