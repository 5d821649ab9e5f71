//! What `raykd render` can be told.

use super::{
    HowArgs, OneArgs, ReadArgs, WalkArgs,
    values::{point, size, within},
};
use clap::{Parser, ValueEnum};
use std::{ffi::OsString, path::PathBuf};

const EXAMPLES: &str = "\
Examples:
  raykd render teapot:20 -o teapot.png
  raykd render dragon -o heat.png --shading heat --size 1920x1080
  raykd render sponza -o hall.png --eye=-10,4,0 --target 10,5,0 --fov 70";

/// Make a picture of a mesh.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct RenderArgs {
    /// Scene name or mesh file
    pub mesh: OsString,
    /// The picture, a PNG file
    #[arg(short, long, value_name = "FILE.png")]
    pub output: PathBuf,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub size: [u32; 2],
    /// What colours show
    #[arg(long, value_enum, default_value_t = Shading::Normal)]
    pub shading: Shading,
    #[command(flatten)]
    pub walk: WalkArgs,
    /// Rays per pixel are the square of this; left out: 2 for normal, else 1
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    pub samples: Option<u32>,
    /// Where the camera is; left out: far enough to see the whole mesh
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub eye: Option<[f64; 3]>,
    /// What it looks at; left out: the middle of the mesh
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "eye")]
    pub target: Option<[f64; 3]>,
    /// Which way is up
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "0,1,0")]
    pub up: [f64; 3],
    /// Angle of view from bottom to top, in degrees
    #[arg(long, value_name = "DEGREES", default_value = "40", value_parser = within(0.1_f64, 170.0))]
    pub fov: f64,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: OneArgs,
    #[command(flatten)]
    pub how: HowArgs,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Shading {
    /// Surfaces under a soft light
    Normal,
    /// Distance: near is bright
    Depth,
    /// Work per pixel: nodes visited and triangles tested
    Heat,
    /// A colour per triangle
    Id,
    /// Ambient occlusion: how much of the sky each point sees
    Ao,
}
