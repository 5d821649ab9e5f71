//! What the program can be told.

use crate::{BuildOptions, Builder, Error, Intersector, Traversal};
use clap::{CommandFactory as _, Parser, Subcommand, ValueEnum, error::ErrorKind};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  raykd bench                            the teapot on CPU and GPU, compared byte by byte
  raykd bench dragon sponza --json       two scenes, for scripts
  raykd build mesh.ply -o mesh.kd        build a tree and save it
  raykd trace mesh.ply --rays r --hits h trace a file of rays
  raykd render dragon -o dragon.png      make a picture
  raykd stress                           the scenes in which ray tracers fail
  raykd chart --quick                    what raykd knows about itself, drawn
  raykd calibrate                        measure costs, for --quality auto
  raykd devices                          what raykd can run on

A scene is a mesh file (.obj, .ply, either also .gz) or a name: teapot, teapot:LEVEL, dragon,
dragon_res2, dragon_res3, dragon_res4, sponza (`cargo xtask scenes` gets all but the teapot).

Exit code: 0 success, 1 an error or a difference between devices, 2 wrong usage.";

const BENCH_EXAMPLES: &str = "\
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
  raykd bench dragon --json > old.json          then, with a newer raykd:
  raykd bench dragon --compare-with old.json    what has changed, and how sure that is
  raykd bench sponza --json | jq '.[].build_ms'";

const BUILD_EXAMPLES: &str = "\
Examples:
  raykd build dragon                            statistics of the tree
  raykd build mesh.ply.gz -o mesh.kd            save it, for raykd trace --tree or the crate raykd-shared
  raykd build mesh.obj --cost-test 2 --json     dearer triangle tests: more nodes, shorter leaves
  raykd build sponza --builder exact            the best tree, slowly
  raykd build --compare dragon                  every builder on CPU and GPU, in a table
  raykd build --scaling                         how build time grows with the mesh";

const TRACE_EXAMPLES: &str = "\
Rays: records of 8 little-endian f32: origin x y z, direction x y z, t_min, t_max (may be
infinite). Hits: records of u32 triangle (0xFFFFFFFF: none), f32 t, f32 u, f32 v, one a ray, in
the order of the rays. Triangles are numbered from 0 in file order. Rays that are none (NaN, zero
direction) miss and are counted. --query all writes LIMIT records a ray, by rising t, the rest of
them misses; --query count writes one u32 a ray.

Examples:
  raykd trace mesh.ply --rays rays.bin --hits hits.bin
  raykd trace mesh.ply --rays rays.bin --hits hits.bin --any --device cpu --threads 1
  raykd trace mesh.ply --rays rays.bin --hits hits.bin --query all --limit 4
  raykd trace --compare dragon                  every traversal on CPU and GPU, in a table
  raykd trace mesh.ply --tree mesh.kd --rays rays.bin --hits hits.bin --json";

const RENDER_EXAMPLES: &str = "\
Examples:
  raykd render teapot:20 -o teapot.png
  raykd render dragon -o heat.png --shading heat --size 1920x1080
  raykd render sponza -o hall.png --eye=-10,4,0 --target 10,5,0 --fov 70";

const STRESS_EXAMPLES: &str = "\
Examples:
  raykd stress                                  all scenes and methods, a minute or less
  raykd stress --list                           what there is
  raykd stress --scene slivers --method exact   one scene, by all ways with the exact test
  raykd stress --scene dragon --method exact    rays at a mesh of one's own, against the exact answers
  raykd stress --scene leaks --rays 1000000000 --method exact/stack --device gpu
                                                a billion rays at each of five surfaces without gaps
  raykd stress --json > f.json; raykd stress --replay f.json
                                                the rays that failed, once more";

const CHART_EXAMPLES: &str = "\
Examples:
  raykd chart --quick                           the teapot, into charts/index.html
  raykd chart dragon sponza stadium -o out      three scenes
  raykd chart dragon --peers peers.json         other crates too, see peers/README.md
  raykd chart teapot --device cpu --rays 4096   small";

const CALIBRATE_EXAMPLES: &str = "\
Examples:
  raykd calibrate                               all devices, into the cache
  raykd calibrate --device cpu -o cpu.json      one device, into a file
  raykd render dragon -o d.png --quality auto   uses what was measured
  raykd calibrate --check teapot dragon sponza  was auto right?";

const DEVICES_EXAMPLES: &str = "\
Every adapter computes some thousand sums and products, which are compared with the CPU's. One
that rounds otherwise, contracts or rearranges would build other trees: it is refused, unless
RAYKD_ALLOW_INEXACT=1 is set.

Examples:
  raykd devices
  raykd devices --json | jq -r '.[].adapter'";

/// kd-trees for ray tracing triangle meshes: one kernel source, identical bytes on CPU and GPU.
#[derive(Debug, Parser)]
#[command(name = "raykd", version, after_help = EXAMPLES, arg_required_else_help = true)]
pub(super) struct Args {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    Bench(BenchArgs),
    Build(BuildArgs),
    Trace(TraceArgs),
    Render(RenderArgs),
    Devices(DevicesArgs),
    Stress(StressArgs),
    Chart(ChartArgs),
    Calibrate(CalibrateArgs),
}

/// Build and trace scenes, time both, and compare the devices byte by byte.
///
/// Random rays start on the sphere around the scene and aim into its box, always the same ones. Times are
/// medians of 5 (of 3 where a build takes over 2 s), on the device's clock, transfers apart.
/// Exit code 1 if trees or hits differ between the devices.
#[derive(Debug, Parser)]
#[command(after_help = BENCH_EXAMPLES)]
pub(super) struct BenchArgs {
    /// Scene names or mesh files; the teapot if there are none
    #[arg(value_name = "SCENE")]
    pub scenes: Vec<String>,
    /// Random rays to trace
    #[arg(long, value_name = "N", default_value_t = 50_000, value_parser = clap::value_parser!(u32).range(1..=1 << 28))]
    pub rays: u32,
    /// The way through the tree, see docs/traversals.md; hits do not depend on it
    #[arg(long, value_enum, value_name = "NAME", default_value_t = Traversal::Stack)]
    pub traversal: Traversal,
    /// How triangles are tested, see docs/accuracy.md; the others lose hits
    #[arg(long, value_enum, value_name = "NAME", default_value_t = Intersector::Exact)]
    pub intersector: Intersector,
    /// Left out: both if there is any Vulkan adapter, a software one too, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<Which>,
    #[command(flatten)]
    pub machine: MachineArgs,
    #[command(flatten)]
    pub how: TreeArgs,
    /// Print JSON: one array, an object per scene and device
    #[arg(long)]
    pub json: bool,
    /// Time every kernel of the build too
    #[arg(long)]
    pub profile: bool,
    /// Measure three times, and tell how that differs from what another version wrote with --json
    #[arg(long, value_name = "FILE.json", conflicts_with = "profile")]
    pub compare_with: Option<PathBuf>,
}

/// How the tree is built. Hits do not depend on it.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TreeArgs {
    /// How planes are chosen
    #[arg(long, value_enum, value_name = "NAME", default_value_t = Builder::Binned)]
    pub builder: Builder,
    /// Keep references where only a triangle's box reaches, not the triangle
    #[arg(long)]
    pub no_clip: bool,
    /// SAH cost of a traversal step
    #[arg(long, value_name = "X", value_parser = within(1e-6_f32, 1e6))]
    pub cost_step: Option<f32>,
    /// SAH cost of a triangle test
    #[arg(long, value_name = "X", value_parser = within(1e-6_f32, 1e6))]
    pub cost_test: Option<f32>,
    /// Price of a reference: tests a ray it has to save, times the number of triangles; more makes smaller trees
    #[arg(long, value_name = "X", value_parser = within(0.0_f32, 1e9))]
    pub price: Option<f32>,
    /// Most references a triangle, on average, at least 1: the price is doubled until the tree keeps to it (median and zhou may not)
    #[arg(long, value_name = "X", value_parser = within(1.0_f32, 1e6))]
    pub budget: Option<f32>,
    /// Factor on the cost of planes that cut off empty space, from 0 to 1
    #[arg(long, value_name = "X", value_parser = within(0.0_f32, 1.0))]
    pub empty: Option<f32>,
}

/// How much is done for the rays. Hits do not depend on it.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct AmountArgs {
    /// auto: device, builder and traversal that take the least time for this scene and so many rays
    #[arg(long, value_enum, default_value_t = Quality::Usual, conflicts_with_all =
        ["builder", "no_clip", "cost_step", "cost_test", "price", "budget", "empty"])]
    pub quality: Quality,
    /// Costs of the device by `raykd calibrate -o FILE`, for --quality auto; left out: those kept, or measured now
    #[arg(long, value_name = "FILE")]
    pub costs: Option<PathBuf>,
}

impl TreeArgs {
    /// As the library is told.
    pub(super) fn options(&self) -> BuildOptions {
        let usual = BuildOptions::default();
        BuildOptions {
            builder: self.builder,
            clip: !self.no_clip,
            cost_step: self.cost_step.unwrap_or(usual.cost_step),
            cost_test: self.cost_test.unwrap_or(usual.cost_test),
            price: self.price.unwrap_or(usual.price),
            budget: self.budget,
            empty: self.empty.unwrap_or(usual.empty),
            ..usual
        }
    }
}

/// Build the tree of a mesh, and print its statistics and digest; or compare builders.
///
/// --compare builds by every builder on CPU and GPU and traces a picture's rays and a bounce from each hit; exit code
/// 1 if a builder's trees differ. --scaling builds teapots of a thousand to ten million triangles.
#[derive(Debug, Parser)]
#[command(after_help = BUILD_EXAMPLES)]
pub(super) struct BuildArgs {
    /// Scene name or mesh file
    #[arg(required_unless_present = "scaling")]
    pub mesh: Option<String>,
    /// Save the tree to this file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Compare all builders on CPU and GPU
    #[arg(long, conflicts_with_all = ["output", "builder", "profile", "scaling"])]
    pub compare: bool,
    /// Build teapots of many sizes on CPU and GPU
    #[arg(long, conflicts_with_all = ["output", "profile", "mesh"])]
    pub scaling: bool,
    /// Left out: a real GPU if there is one, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<One>,
    #[command(flatten)]
    pub machine: MachineArgs,
    #[command(flatten)]
    pub how: TreeArgs,
    #[command(flatten)]
    pub amount: AmountArgs,
    /// How many rays the tree is for, with --quality auto
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: u64,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Time every kernel too
    #[arg(long)]
    pub profile: bool,
}

/// Trace a file of rays, and write a file of hits; or compare all traversals.
///
/// Times are medians of 5 traces, on the device's clock, transfers apart. --compare takes a picture's rays, or
/// those of a file, one diffuse bounce from each hit, and one shadow ray; exit code 1 if any hits differ.
#[derive(Debug, Parser)]
#[command(after_help = TRACE_EXAMPLES)]
pub(super) struct TraceArgs {
    /// Scene name or mesh file
    pub mesh: String,
    /// File of rays
    #[arg(long, value_name = "FILE", required_unless_present = "compare")]
    pub rays: Option<PathBuf>,
    /// File of hits to write
    #[arg(long, value_name = "FILE", required_unless_present = "compare")]
    pub hits: Option<PathBuf>,
    /// Use this tree, saved by raykd build -o, rather than building one
    #[arg(long, value_name = "FILE", conflicts_with_all =
        ["builder", "no_clip", "cost_step", "cost_test", "price", "budget", "empty", "quality"])]
    pub tree: Option<PathBuf>,
    /// What to ask of each ray
    #[arg(long, value_enum, default_value_t = Ask::Closest)]
    pub query: Ask,
    /// Short for --query any
    #[arg(long, conflicts_with = "query")]
    pub any: bool,
    /// Hits a ray to write with --query all
    #[arg(long, value_name = "K", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub limit: u32,
    /// The way through the tree, see docs/traversals.md; hits do not depend on it
    #[arg(long, value_enum, value_name = "NAME", default_value_t = Traversal::Stack, conflicts_with = "quality")]
    pub traversal: Traversal,
    /// How triangles are tested, see docs/accuracy.md; the others lose hits
    #[arg(long, value_enum, value_name = "NAME", default_value_t = Intersector::Exact)]
    pub intersector: Intersector,
    /// Compare all traversals on CPU and GPU, rather than write hits
    #[arg(long, conflicts_with_all = ["hits", "tree", "query", "any", "limit", "traversal", "intersector"])]
    pub compare: bool,
    /// Left out: a real GPU if there is one, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<One>,
    #[command(flatten)]
    pub machine: MachineArgs,
    #[command(flatten)]
    pub how: TreeArgs,
    #[command(flatten)]
    pub amount: AmountArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Make a picture of a mesh.
#[derive(Debug, Parser)]
#[command(after_help = RENDER_EXAMPLES)]
pub(super) struct RenderArgs {
    /// Scene name or mesh file
    pub mesh: String,
    /// The picture, a PNG file
    #[arg(short, long, value_name = "FILE.png")]
    pub output: PathBuf,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub size: [u32; 2],
    /// What colours show
    #[arg(long, value_enum, default_value_t = Shading::Normal)]
    pub shading: Shading,
    /// The way through the tree, see docs/traversals.md; only heat depends on it
    #[arg(long, value_enum, value_name = "NAME", default_value_t = Traversal::Stack, conflicts_with = "quality")]
    pub traversal: Traversal,
    /// How triangles are tested, see docs/accuracy.md; the others lose hits
    #[arg(long, value_enum, value_name = "NAME", default_value_t = Intersector::Exact)]
    pub intersector: Intersector,
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
    /// Left out: a real GPU if there is one, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<One>,
    #[command(flatten)]
    pub machine: MachineArgs,
    #[command(flatten)]
    pub how: TreeArgs,
    #[command(flatten)]
    pub amount: AmountArgs,
}

/// List what raykd can run on: adapters, drivers, limits, and whether they compute exactly.
#[derive(Debug, Parser)]
#[command(after_help = DEVICES_EXAMPLES)]
pub(super) struct DevicesArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Trace the scenes in which ray tracers fail, and judge every answer exactly.
///
/// Each scene is traced by each method: a triangle test and a way to find triangles, or a form of the literature
/// with its traps (textbook/..., on the CPU only). A failure is an answer that is not exact even for triangles moved
/// by a few ULP of the distance, a miss where there is no gap, a difference from brute force with the same test or
/// from the CPU's bytes. Exit code 1 if a method fails where it is not known to (docs/accuracy.md).
#[derive(Debug, Parser)]
#[command(after_help = STRESS_EXAMPLES)]
pub(super) struct StressArgs {
    /// Scenes of these names, or meshes as other commands take them; left out: all but leaks
    #[arg(long = "scene", value_name = "NAME", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Methods whose names start like this; left out: all
    #[arg(long = "method", value_name = "NAME", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Rays a scene; of leaks, a surface
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    pub rays: u64,
    /// Trace the failing rays of an earlier --json output again
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scenes", "methods", "rays", "list"])]
    pub replay: Option<PathBuf>,
    /// List scenes and methods
    #[arg(long)]
    pub list: bool,
    /// Left out: both if there is any Vulkan adapter, a software one too, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<Which>,
    #[command(flatten)]
    pub machine: MachineArgs,
    /// Print JSON: one array, an object per scene, method and device
    #[arg(long)]
    pub json: bool,
}

/// Measure scenes, and draw what raykd knows about itself: one page without links, and SVG, PNG and CSV files.
///
/// The first scene is also traced by every triangle test and traversal. Times are the best of some.
#[derive(Debug, Parser)]
#[command(after_help = CHART_EXAMPLES)]
pub(super) struct ChartArgs {
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
    /// Left out: both if there is any Vulkan adapter, a software one too, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<Which>,
    #[command(flatten)]
    pub machine: MachineArgs,
}

/// Measure what trees cost on this machine's devices, for --quality auto, and keep that in the user's cache.
///
/// Teapots of some sizes are built and traced by every choice that auto has. The cache is the folder named by
/// RAYKD_CACHE, or raykd in the system's. --check measures scenes instead, and tells how well auto would do there.
#[derive(Debug, Parser)]
#[command(after_help = CALIBRATE_EXAMPLES)]
pub(super) struct CalibrateArgs {
    /// Write the costs of one device to this file, not to the cache
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Compare auto's choices with the best in hindsight, for 1e3 to 1e9 rays at these scenes
    #[arg(long, value_name = "SCENE", num_args = 1.., conflicts_with = "output")]
    pub check: Vec<String>,
    /// Left out: both if there is any Vulkan adapter, a software one too, else the CPU
    #[arg(long, value_enum)]
    pub device: Option<Which>,
    #[command(flatten)]
    pub machine: MachineArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// More about the devices to run on.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct MachineArgs {
    /// The GPU whose name or driver contains this (any case); implies the GPU
    #[arg(long, value_name = "SUBSTRING")]
    pub adapter: Option<String>,
    /// Threads of the CPU; implies the CPU where one device is used; left out: all
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
}

/// What is asked of each ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Ask {
    /// The hit with the smallest t, the lowest triangle of several
    Closest,
    /// Some hit
    Any,
    /// How many hits there are
    Count,
    /// The first hits, up to a limit
    All,
}

/// One device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum One {
    /// The processor
    Cpu,
    /// The best Vulkan adapter, a software one too
    Gpu,
}

/// How a tree is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Quality {
    /// The default, or what the other options say
    Usual,
    /// The right amount for the scene and the rays
    Auto,
}

/// One device or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Which {
    /// The processor
    Cpu,
    /// The best Vulkan adapter, a software one too
    Gpu,
    /// One after the other
    Both,
}

impl From<One> for Which {
    fn from(one: One) -> Self {
        match one {
            One::Cpu => Self::Cpu,
            One::Gpu => Self::Gpu,
        }
    }
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Shading {
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

impl Args {
    /// Finds contradictions that clap does not see by itself.
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        let (name, device, machine) = match &self.command {
            Command::Bench(a) => ("bench", a.device, &a.machine),
            Command::Build(a) => ("build", a.device.map(Which::from), &a.machine),
            Command::Trace(a) => ("trace", a.device.map(Which::from), &a.machine),
            Command::Render(a) => ("render", a.device.map(Which::from), &a.machine),
            Command::Stress(a) => ("stress", a.device, &a.machine),
            Command::Chart(a) => ("chart", a.device, &a.machine),
            Command::Calibrate(a) => ("calibrate", a.device, &a.machine),
            Command::Devices(_) => return Ok(()),
        };
        let conflict = |what: &str| {
            let mut command = Self::command();
            command.build();
            let command = command.find_subcommand_mut(name).expect("it was parsed");
            Err(command.error(ErrorKind::ArgumentConflict, what))
        };
        match (&machine.adapter, machine.threads) {
            (Some(_), _) if device == Some(Which::Cpu) => {
                conflict("--adapter names a GPU, --device cpu uses none")
            }
            (_, Some(_)) if device == Some(Which::Gpu) => {
                conflict("--threads is for the CPU, --device gpu does not use it")
            }
            (Some(_), Some(_)) if matches!(name, "build" | "trace" | "render") => {
                conflict("--adapter is for the GPU, --threads for the CPU: use one of them")
            }
            _ => self.check_test().or_else(|error| conflict(&error.to_string())),
        }
    }

    /// Whether the triangle test does what is asked for.
    fn check_test(&self) -> Result<(), Error> {
        let (test, traversal, more) = match &self.command {
            Command::Bench(a) => (a.intersector, a.traversal, None),
            Command::Trace(a) => {
                let all = matches!(a.query, Ask::Count | Ask::All);
                (a.intersector, a.traversal, all.then_some("a query for all hits"))
            }
            Command::Render(a) => {
                (a.intersector, a.traversal, (a.shading == Shading::Heat).then_some("counting steps"))
            }
            _ => return Ok(()),
        };
        match more.filter(|_| test != Intersector::Exact) {
            Some(asked) => Err(Error::Intersector { name: test.name(), asked: asked.to_owned() }),
            None => test.check(traversal),
        }
    }
}

/// A parser of numbers in a range.
fn within<T>(lo: T, hi: T) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: std::str::FromStr + PartialOrd + std::fmt::Display + Copy,
{
    move |text| {
        let x: T = text.parse().map_err(|_| "not a number".to_owned())?;
        if lo <= x && x <= hi { Ok(x) } else { Err(format!("this lies between {lo} and {hi}")) }
    }
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse().ok().filter(|n| (1..=16384).contains(n));
    let sides = text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?]));
    sides.ok_or_else(|| "write it like 1024x768, each from 1 to 16384".to_owned())
}

fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|x: &f64| x.abs() <= 1.0e30)).collect();
    let numbers = numbers.and_then(|n| <[f64; 3]>::try_from(n).ok());
    numbers.ok_or_else(|| "write it like 1,2.5,-3".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definition_holds_together() {
        Args::command().debug_assert();
    }

    #[test]
    fn values() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for wrong in ["640", "0x1", "1x16385", "x", "axb", "1x2x3"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
        assert_eq!(point("1,-2.5, 3e2"), Ok([1.0, -2.5, 300.0]));
        for wrong in ["1,2", "1,2,3,4", "a,b,c", "", "nan,0,0", "inf,0,0"] {
            assert!(point(wrong).is_err(), "{wrong}");
        }
        let cost = within(1e-6_f32, 1e6);
        assert!(cost("nan").is_err() && cost("-1").is_err() && cost("inf").is_err() && cost("0.5").is_ok());
    }

    #[test]
    fn contradictions() {
        let check = |line: &str| Args::try_parse_from(line.split(' ')).unwrap().check();
        for wrong in [
            "raykd bench --device cpu --adapter x",
            "raykd bench --device gpu --threads 2",
            "raykd build m --adapter x --threads 2",
            "raykd trace m --rays r --hits h --device cpu --adapter x",
            "raykd render m -o p --device gpu --threads 1",
            "raykd bench --intersector woop --traversal ropes",
            "raykd trace m --rays r --hits h --intersector plane --query all",
            "raykd render m -o p --intersector moeller --shading heat",
        ] {
            assert_eq!(check(wrong).unwrap_err().kind(), ErrorKind::ArgumentConflict, "{wrong}");
        }
        check("raykd bench --adapter x --threads 2").unwrap();
        check("raykd bench --intersector woop --traversal brute").unwrap();
        check("raykd build m --device cpu --threads 2").unwrap();
    }
}
