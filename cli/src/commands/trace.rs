//! `raykd trace`: a file of rays to a file of hits.

use crate::{
    amount::{self, Job},
    args::{HowArgs, OneArgs, ReadArgs, WalkArgs, Which, whole},
    compare,
    files::Files,
    input::{Input, RepairCounts},
    machine::Machines,
    measure::{self, mrays, ms},
    notes::Notes,
    npy,
    ray_file::{self, Rays},
    report::{INVALID, count, three, write_json},
    task::Task,
};
use anyhow::anyhow;
use clap::{Parser, ValueEnum};
use raykd::{
    BuildOptions, Device, Error, Hit, KdTree, Query, Ray, Scene, TraceTimes, Traced, Traversal,
    internals::{digest_of, output, quoted},
};
use std::{
    ffi::OsString,
    io::{self, StdoutLock, Write as _},
    path::{Path, PathBuf},
    process::ExitCode,
    time::{Duration, Instant},
};

const EXAMPLES: &str = "\
Rays: records of 8 little-endian f32: origin x y z, direction x y z, t_min, t_max (may be
infinite), in the mesh's own coordinates; with --f64, of 8 f64. Hits: records of u32 triangle
(0xFFFFFFFF: none), f32 t, f32 u, f32 v, one a ray, in the order of the rays. Triangles are
numbered from 0 in file order. Invalid rays (NaN, zero direction) miss and are counted.
--query all writes LIMIT records a ray, by rising t, the rest of them misses; --query count writes
one u32 a ray.

Files named .npy are arrays of numpy: rays of N x 8 f32 or f64, hits and numbers of hits one after
the other.

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
    #[arg(long, value_name = "K", value_parser = whole(1_u32, 65536))]
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

/// Hits a ray that are written if nothing is said.
const USUAL_LIMIT: u32 = 8;

/// What is told about a trace.
#[derive(Debug, serde::Serialize)]
struct Told {
    scene: String,
    triangles: usize,
    repairs: RepairCounts,
    device: &'static str,
    adapter: String,
    query: &'static str,
    traversal: &'static str,
    intersector: &'static str,
    /// Reading the mesh, and the tree if it was saved.
    load_ms: f64,
    /// 0 for a tree that was saved.
    build_ms: f64,
    /// What the traversal needs beside the tree.
    prepare_ms: f64,
    /// Mesh, rays and a tree that was saved to device.
    upload_ms: f64,
    trace_ms: f64,
    download_ms: f64,
    mrays: f64,
    rays: usize,
    /// Rays that hit something.
    hits: usize,
    /// All hits, if all were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    total_hits: Option<u64>,
    /// Invalid rays.
    invalid: u64,
    /// Of the tree.
    digest: String,
    hits_digest: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    auto: Option<amount::Told>,
    /// Laying out the leaves, after the build.
    #[serde(skip)]
    layout_ms: f64,
    /// Of the upload, the rays.
    #[serde(skip)]
    ray_upload_ms: f64,
}

impl TraceArgs {
    fn asks_for_all(&self) -> bool {
        matches!(self.query, Ask::Count | Ask::All)
    }
}

impl Task for TraceArgs {
    fn files(&self) -> Files {
        Files::of_scenes(std::slice::from_ref(&self.mesh), self.read)
            .read("--rays", &self.rays)
            .read("--tree", &self.tree)
            .read("--costs", &self.how.amount.costs)
            .write("--hits", self.hits.clone())
    }

    fn check(&self) -> Result<(), String> {
        if self.limit.is_some() && self.query != Ask::All {
            return Err("--limit is for --query all".to_owned());
        }
        if self.f64 && self.rays.as_deref().is_some_and(npy::is_named) {
            return Err("--f64 is for records; a file named .npy says itself what its numbers are".to_owned());
        }
        if self.brute && !self.compare {
            return Err("--brute is for --compare".to_owned());
        }
        self.how.check(false)?;
        self.walk.check(self.asks_for_all().then_some("a query for all hits"))
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        let limit = self.read.limit();
        let rays = self.rays.as_deref().map(|path| Rays::read(path, self.f64, limit)).transpose()?;
        let (Some(rays), Some(hits)) = (&rays, &self.hits) else {
            let input = Input::load(&self.mesh, self.read, &notes)?;
            let machines = Machines::choose(self.on.device.map(Which::from), &self.on.more, &notes)?;
            let how = compare::How { options: self.how.tree.options(), brute: self.brute, json: self.json };
            return compare::run(&input, rays.as_ref(), &machines, &how, &notes, out);
        };
        let mut input = Input::load(&self.mesh, self.read, &notes)?;
        let rays = &*rays.local(input.translation);
        let start = Instant::now();
        let tree = self.tree.as_deref().map(|path| KdTree::load_up_to(path, limit)).transpose()?;
        input.load += start.elapsed();
        let needs_tree = self.asks_for_all() || self.walk.needs_tree();
        let job = Job { mesh: &input.mesh, rays: rays.len() as u64, needs_tree };
        let device = &self.on;
        let (machine, amount) = amount::decide(&self.how, self.walk.traversal, device, job, &notes)?;
        let how = (&amount.options, amount.traversal);
        let work = |device: &Device| trace(device, &input, tree.as_ref(), self, how, rays, &notes);
        let (mut told, found) = machine.run(&notes, work).map_err(|error| match (error, &self.tree) {
            (Error::Tree { why, .. }, Some(tree)) => {
                anyhow!("{} and {}: {why}", quoted(tree.display()), quoted(self.mesh.display()))
            }
            (other, _) => other.into(),
        })?;
        told.auto = amount.plan.map(|plan| {
            let rays = told.ray_upload_ms + told.trace_ms + told.download_ms;
            amount::Told::new(
                &plan,
                told.upload_ms - told.ray_upload_ms + told.build_ms + told.prepare_ms + told.layout_ms,
                Some(rays),
            )
        });
        notes.stage(format_args!("writing {}", hits.display()));
        output::write_whole(hits, |file| found.write(hits, file))?;
        notes.clear();
        if self.json { write_json(out, &told) } else { print(&told, hits, out) }?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Traces, and says what that took and what to write.
fn trace(
    device: &Device,
    input: &Input,
    tree: Option<&KdTree>,
    args: &TraceArgs,
    (options, traversal): (&BuildOptions, Traversal),
    rays: &[Ray],
    notes: &Notes,
) -> Result<(Told, Found), Error> {
    let mesh = &input.mesh;
    let mut scene;
    let (build, upload, digest);
    if let Some(tree) = tree {
        scene = Scene::with_tree(device, mesh, tree)?;
        (build, upload, digest) = (Duration::ZERO, scene.times().upload, tree.digest());
    } else {
        notes.stage(format_args!("{}: building", input.name));
        let built = measure::build(device, mesh, options)?;
        (build, upload, digest) = (built.build, built.upload, built.tree.digest());
        scene = built.scene;
    }
    scene.traverse_by(traversal)?;
    scene.intersect_by(args.walk.intersector)?;
    notes.stage(format_args!("{}: tracing {} rays", input.name, count(rays.len() as u64)));
    let ask = if args.any { Ask::Any } else { args.query };
    let answer = answer(&scene, ask, args.limit.unwrap_or(USUAL_LIMIT), rays)?;
    let told = Told {
        scene: input.name.clone(),
        triangles: mesh.triangles().len(),
        repairs: input.into(),
        device: device.kind().name(),
        adapter: device.name().to_owned(),
        query: match ask {
            Ask::Closest => "closest",
            Ask::Any => "any",
            Ask::Count => "count",
            Ask::All => "all",
        },
        traversal: traversal.name(),
        intersector: args.walk.intersector.name(),
        load_ms: ms(input.load),
        build_ms: ms(build),
        prepare_ms: ms(scene.times().prepare),
        upload_ms: ms(upload + answer.times.upload),
        trace_ms: ms(answer.times.trace),
        download_ms: ms(answer.times.download),
        mrays: mrays(rays.len(), answer.times.trace),
        rays: rays.len(),
        hits: answer.hits,
        total_hits: answer.total_hits,
        invalid: answer.invalid,
        digest,
        hits_digest: digest_of(answer.found.bytes()),
        auto: None,
        layout_ms: ms(scene.times().layout),
        ray_upload_ms: ms(answer.times.upload),
    };
    Ok((told, answer.found))
}

/// What was found, and what that took: medians.
struct Answer {
    /// Rays that hit something.
    hits: usize,
    /// All hits, if all were asked for.
    total_hits: Option<u64>,
    invalid: u64,
    times: TraceTimes,
    found: Found,
}

/// What is written.
enum Found {
    Hits(Vec<Hit>),
    Totals(Vec<u32>),
}

impl Found {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Hits(hits) => bytemuck::cast_slice(hits),
            Self::Totals(totals) => bytemuck::cast_slice(totals),
        }
    }

    fn write(&self, path: &Path, file: &mut dyn io::Write) -> io::Result<()> {
        match self {
            Self::Hits(hits) => ray_file::write_hits(path, file, hits),
            Self::Totals(totals) => ray_file::write_counts(path, file, totals),
        }
    }
}

/// Asks for the hits of rays, up to a limit a ray if for all of them.
fn answer(scene: &Scene, ask: Ask, limit: u32, rays: &[Ray]) -> Result<Answer, Error> {
    let query = match ask {
        Ask::Closest => Query::Closest,
        Ask::Any => Query::Any,
        Ask::Count | Ask::All => {
            let all = ask == Ask::All;
            let (Traced { hits, times, invalid, .. }, totals) =
                measure::all(scene, rays, if all { limit } else { 0 })?;
            return Ok(Answer {
                hits: totals.iter().filter(|&&n| n > 0).count(),
                total_hits: Some(totals.iter().map(|&n| u64::from(n)).sum()),
                invalid,
                times,
                found: if all { Found::Hits(hits) } else { Found::Totals(totals) },
            });
        }
    };
    let Traced { hits, times, invalid, .. } = measure::trace(scene, query, rays)?;
    Ok(Answer {
        hits: hits.iter().filter(|hit| hit.is_hit()).count(),
        total_hits: None,
        invalid,
        times,
        found: Found::Hits(hits),
    })
}

fn print(t: &Told, hits: &Path, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let mut line = |name: &str, what: String| writeln!(out, "{name:<7} {what}");
    line("scene", format!("{}, {} triangles", quoted(&t.scene), count(t.triangles as u64)))?;
    if let Some(told) = t.repairs.told() {
        line("repairs", told)?;
    }
    line("device", format!("{}, {}", t.device.to_uppercase(), t.adapter))?;
    line(
        "times",
        format!(
            "load {} ms, build {} ms, prepare {} ms, upload {} ms, trace {} ms, download {} ms",
            three(t.load_ms),
            three(t.build_ms),
            three(t.prepare_ms),
            three(t.upload_ms),
            three(t.trace_ms),
            three(t.download_ms)
        ),
    )?;
    line(
        "rays",
        format!(
            "{} ({} hit), {} Mray/s, {} query, {}, {} test",
            count(t.rays as u64),
            count(t.hits as u64),
            three(t.mrays),
            t.query,
            t.traversal,
            t.intersector
        ),
    )?;
    if let Some(total) = t.total_hits {
        line("all", format!("{} hits", count(total)))?;
    }
    if t.invalid > 0 {
        line("invalid", format!("{} {INVALID}", count(t.invalid)))?;
    }
    if let Some(auto) = &t.auto {
        line("auto", auto.words())?;
    }
    line("tree", t.digest.clone())?;
    line("hits", t.hits_digest.clone())?;
    line("written", quoted(hits.display()))?;
    Ok(())
}
