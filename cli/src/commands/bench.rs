//! `raykd bench`: the two tables of Meng Zhou, *Build and Travel KD-Tree with CUDA*, and whether the devices agree.

use crate::{
    amount::{self, Amount, Job},
    args::{HowArgs, ReadArgs, WalkArgs, WhichArgs, whole},
    changes,
    files::Files,
    input::{Input, RepairCounts},
    machine::Machines,
    measure::{self, Kernel, kernel_table, mrays, ms},
    notes::Notes,
    report::{Table, bytes, count, three, write_json},
    task::Task,
};
use clap::Parser;
use raykd::{
    Device, Error, Query, Ray,
    internals::{hits_digest, quoted},
    rays::{self, sets::Sets},
};
use std::{
    ffi::OsString,
    io::{StdoutLock, Write},
    path::PathBuf,
    process::ExitCode,
};

const EXAMPLES: &str = "\
Sets of rays, the same on every machine, by which raykd is compared with others:
  a      50,000 from the sphere around the box to uniform points of the box
  b      a picture of 1024 x 1024, pixel centres; teapot, dragons and sponza have their own cameras
  c      a cosine-distributed bounce from every hit of b
  d      from the same points to a ball light: its closest hit, and whether there is any

Examples:
  raykd bench                                   the teapot on both devices
  raykd bench teapot:30 dragon --rays 1000000   two scenes, a million rays
  raykd bench dragon --device cpu --threads 1   one thread
  raykd bench dragon --intersector moeller      another triangle test, the same rays
  raykd bench dragon --adapter nvidia --profile kernel by kernel on that GPU
  raykd bench dragon --quality auto             what auto builds for the random rays, and its time
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
    #[arg(long, value_name = "N", default_value_t = 50_000, value_parser = whole(1_u32, 1 << 28))]
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

/// Random rays are the same in every run.
const SEED: u64 = 2026;
/// Width and height of the picture whose rays are timed.
const PICTURE: u32 = 2048;

/// One scene on one device.
#[derive(Clone, Debug, Default, serde::Serialize)]
struct Row {
    scene: String,
    /// In the file.
    triangles: usize,
    device: &'static str,
    adapter: String,
    traversal: &'static str,
    intersector: &'static str,
    load_ms: f64,
    /// Mesh to device.
    upload_ms: f64,
    /// All kernels of the build.
    build_ms: f64,
    /// The kernel, random rays.
    trace_ms: f64,
    /// Hits to host.
    download_ms: f64,
    /// Random rays, millions a second.
    mrays: f64,
    rays: usize,
    nodes: u32,
    leaves: u32,
    depth: u32,
    refs_per_triangle: f64,
    tree_bytes: u64,
    peak_bytes: u64,
    sah_cost: f64,
    digest: String,
    hits_digest: String,
    /// Laying triangles out for tracing, after the build.
    layout_ms: f64,
    /// Random rays to device.
    ray_upload_ms: f64,
    /// Rays of a picture, millions a second.
    primary_mrays: f64,
    /// The peers' sets of rays, see [`Sets`], millions a second.
    mrays_a: f64,
    mrays_b: f64,
    mrays_c: f64,
    mrays_d: f64,
    /// Set d, any hit.
    mrays_d_any: f64,
    /// Of the closest hits of sets a to d.
    sets_digest: String,
    /// Random rays that hit something.
    hits: usize,
    /// Triangles that take part.
    kept: usize,
    repairs: RepairCounts,
    /// Whether both devices gave the same trees and hits, if both ran.
    identical: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    auto: Option<amount::Told>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    kernels: Vec<Kernel>,
}

impl Row {
    /// Which tree auto chose; none if it was not asked.
    fn choice(&self) -> Option<&'static str> {
        self.auto.as_ref().map(|auto| auto.choice)
    }
}

impl Task for BenchArgs {
    fn files(&self) -> Files {
        Files::of_scenes(&self.scenes, self.read)
            .read("--costs", &self.how.amount.costs)
            .read("--compare-with", &self.compare_with)
    }

    fn check(&self) -> Result<(), String> {
        self.how.check(false)?;
        self.walk.check(None)
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        if let Some(path) = &self.compare_with {
            let before = changes::read(path)?;
            let mut runs = Vec::new();
            for _ in 0..changes::RUNS {
                runs.extend(rows(self, &notes)?.0);
                // After the first, so that nobody waits for the others in vain.
                changes::check(&before, &changes::values(&runs)?)?;
            }
            notes.clear();
            if differ(&runs) {
                notes.note("CPU and GPU differ: raykd bench without --compare-with tells where");
            }
            changes::tell(&before, &changes::values(&runs)?, self.json, out)?;
            return Ok(exit_code(&runs));
        }
        let (rows, machines) = rows(self, &notes)?;
        notes.clear();
        if self.json { write_json(out, &rows) } else { print(&rows, &machines, out) }?;
        Ok(exit_code(&rows))
    }
}

/// Measures all scenes on all devices.
fn rows(args: &BenchArgs, notes: &Notes) -> anyhow::Result<(Vec<Row>, Machines)> {
    let mut machines = Machines::choose(args.on.device, &args.on.more, notes)?;
    let names = if args.scenes.is_empty() { &["teapot".into()] } else { args.scenes.as_slice() };
    let mut rows = Vec::new();
    for name in names {
        let input = Input::load(name, args.read, notes)?;
        let random = rays::random(input.mesh.bounds(), args.rays as usize, SEED);
        let picture = rays::Camera::framing(input.mesh.bounds()).rays(PICTURE, PICTURE);
        let first = rows.len();
        let measure = |device| -> anyhow::Result<Result<Row, Error>> {
            let needs_tree = args.walk.needs_tree();
            let job = Job { mesh: &input.mesh, rays: u64::from(args.rays), needs_tree };
            let amount = amount::on(device, &args.how, args.walk.traversal, job, notes)?;
            Ok(bench(device, &input, &amount, [&random, &picture], args, notes))
        };
        if let Some(cpu) = &machines.cpu {
            rows.push(measure(cpu)??);
        }
        if let Some(gpu) = &machines.gpu {
            match machines.spared(gpu, measure(gpu)?, "with the CPU alone", notes)? {
                Some(row) => rows.push(row),
                None => machines.gpu = None,
            }
        }
        compare(&mut rows[first..]);
    }
    Ok((rows, machines))
}

/// Notes whether both devices gave the same for a scene.
fn compare(rows: &mut [Row]) {
    if let [a, b] = rows {
        let same = [&a.hits_digest, &a.sets_digest] == [&b.hits_digest, &b.sets_digest]
            && (a.digest == b.digest || a.choice() != b.choice());
        (a.identical, b.identical) = (Some(same), Some(same));
    }
}

/// Whether the devices disagree on any scene.
fn differ(rows: &[Row]) -> bool {
    rows.iter().any(|row| row.identical == Some(false))
}

fn exit_code(rows: &[Row]) -> ExitCode {
    if differ(rows) { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// One scene on one device.
fn bench(
    device: &Device,
    input: &Input,
    amount: &Amount,
    [random, picture]: [&[Ray]; 2],
    args: &BenchArgs,
    notes: &Notes,
) -> Result<Row, Error> {
    let (name, mesh) = (&input.name, &input.mesh);
    let stage = |what: &str| notes.stage_on(name, what, device);
    stage("building");
    let options = amount.options.clone().with_profile(args.profile);
    let mut built = measure::build(device, mesh, &options)?;
    built.scene.traverse_by(amount.traversal)?;
    // By the default triangle test: whatever is measured, the rays are the same.
    let sets = Sets::new(name, mesh, |rays| built.scene.closest(rays))?;
    built.scene.intersect_by(args.walk.intersector)?;
    stage("tracing random rays");
    let traced = measure::trace(&built.scene, Query::Closest, random)?;
    stage("tracing a picture");
    let primary = measure::time(&built.scene, Query::Closest, picture)?;
    stage("tracing the peers' rays");
    let Sets { a, b, c, d } = &sets;
    let mut rates = [0.0; 5];
    let closest = [a, b, c, d].map(|rays| (Query::Closest, rays));
    for (rate, (query, rays)) in rates.iter_mut().zip(closest.into_iter().chain([(Query::Any, d)])) {
        *rate = mrays(rays.len(), measure::time(&built.scene, query, rays)?);
    }
    let all: Vec<Ray> = [a, b, c, d].into_iter().flatten().copied().collect();
    let sets_digest = hits_digest(&built.scene.closest(&all)?);
    let header = *built.scene.header();
    let moved = ms(traced.times.upload + traced.times.trace + traced.times.download);
    let before = ms(built.upload + built.build + built.layout + built.scene.times().prepare);
    Ok(Row {
        auto: amount.plan.as_ref().map(|plan| amount::Told::new(plan, before, Some(moved))),
        scene: name.clone(),
        triangles: mesh.triangles().len(),
        device: device.kind().name(),
        adapter: device.name().to_owned(),
        traversal: amount.traversal.name(),
        intersector: args.walk.intersector.name(),
        load_ms: ms(input.load),
        upload_ms: ms(built.upload),
        build_ms: ms(built.build),
        trace_ms: ms(traced.times.trace),
        download_ms: ms(traced.times.download),
        mrays: mrays(random.len(), traced.times.trace),
        rays: random.len(),
        nodes: header.nodes,
        leaves: built.report.leaves,
        depth: header.depth,
        refs_per_triangle: f64::from(header.refs) / mesh.triangles().len() as f64,
        tree_bytes: built.tree.size_in_bytes(),
        peak_bytes: built.scene.times().peak_bytes,
        sah_cost: built.report.sah_cost,
        digest: built.tree.digest(),
        hits_digest: hits_digest(&traced.hits),
        layout_ms: ms(built.layout),
        ray_upload_ms: ms(traced.times.upload),
        primary_mrays: mrays(picture.len(), primary),
        mrays_a: rates[0],
        mrays_b: rates[1],
        mrays_c: rates[2],
        mrays_d: rates[3],
        mrays_d_any: rates[4],
        sets_digest,
        hits: traced.hits.iter().filter(|hit| hit.is_hit()).count(),
        kept: mesh.kept().len(),
        repairs: input.into(),
        identical: None,
        kernels: built.kernels,
    })
}

/// The tables.
fn print(rows: &[Row], machines: &Machines, out: &mut impl Write) -> anyhow::Result<()> {
    machines.write_names(out)?;
    writeln!(out, "Times are medians on the device's clock; transfers are not part of them.\n")?;
    writeln!(out, "{}", build_table(rows))?;
    writeln!(out, "{}", travel_table(rows))?;
    writeln!(out, "{}", sets_table(rows))?;
    writeln!(out, "{}", tree_table(rows))?;
    for row in rows.iter().filter(|row| !row.kernels.is_empty()) {
        writeln!(
            out,
            "{}",
            kernel_table(&format!("{}, {}", quoted(&row.scene), row.device.to_uppercase()), &row.kernels)
        )?;
    }
    for row in rows {
        if let Some(auto) = &row.auto {
            writeln!(out, "{}, {}: auto: {}", quoted(&row.scene), row.device.to_uppercase(), auto.words())?;
        }
    }
    for scene in scenes(rows) {
        let row = scene.any();
        if let Some(told) = row.repairs.told() {
            writeln!(out, "{}: {told}", quoted(&row.scene))?;
        }
        match scene {
            Both { cpu: Some(cpu), gpu: Some(gpu) } if gpu.identical == Some(true) => {
                let trees =
                    if cpu.choice() == gpu.choice() { "trees and hits" } else { "hits by other trees" };
                writeln!(out, "{}: CPU and GPU gave byte-identical {trees}", quoted(&gpu.scene))?;
                writeln!(out, "  tree {}\n  hits {}", gpu.digest, gpu.hits_digest)?;
            }
            Both { cpu: Some(cpu), gpu: Some(gpu) } => {
                let mark = |same| if same { "same     " } else { "DIFFERENT" };
                writeln!(out, "{}: CPU AND GPU DIFFER", quoted(&cpu.scene))?;
                for (what, a, b) in [
                    ("tree", &cpu.digest, &gpu.digest),
                    ("hits", &cpu.hits_digest, &gpu.hits_digest),
                    ("sets", &cpu.sets_digest, &gpu.sets_digest),
                ] {
                    writeln!(out, "  {what} {}  CPU {a}\n                  GPU {b}", mark(a == b))?;
                }
            }
            _ => writeln!(
                out,
                "{}: only the {} ran, nothing to compare\n  tree {}\n  hits {}",
                quoted(&row.scene),
                row.device.to_uppercase(),
                row.digest,
                row.hits_digest
            )?,
        }
    }
    Ok(())
}

/// The rows of one scene.
#[derive(Clone, Copy)]
struct Both<'a> {
    cpu: Option<&'a Row>,
    gpu: Option<&'a Row>,
}

impl<'a> Both<'a> {
    fn any(self) -> &'a Row {
        self.cpu.or(self.gpu).expect("one of them ran")
    }

    /// A number of each, and how many times the GPU's goes into the CPU's.
    fn compare(self, number: impl Fn(&Row) -> f64) -> [String; 3] {
        let [cpu, gpu] = [self.cpu, self.gpu].map(|row| row.map(&number));
        let ratio = cpu.zip(gpu).filter(|(_, gpu)| *gpu > 0.0).map(|(cpu, gpu)| cpu / gpu);
        [cpu, gpu, ratio].map(|x| x.map_or_else(|| "-".to_owned(), three))
    }
}

/// Rows of the same scene are neighbours, the CPU's first.
fn scenes(rows: &[Row]) -> Vec<Both<'_>> {
    let mut scenes: Vec<Both<'_>> = Vec::new();
    for row in rows {
        match (row.device, scenes.last_mut()) {
            ("cpu", _) => scenes.push(Both { cpu: Some(row), gpu: None }),
            (_, Some(last)) if last.gpu.is_none() => last.gpu = Some(row),
            _ => scenes.push(Both { cpu: None, gpu: Some(row) }),
        }
    }
    scenes
}

fn build_table(rows: &[Row]) -> Table {
    let mut table = Table::new(["Build", "triangles", "CPU ms", "GPU ms", "upload ms", "CPU/GPU"]);
    for scene in scenes(rows) {
        let row = scene.any();
        let [cpu, gpu, ratio] = scene.compare(|row| row.build_ms);
        let upload = scene.gpu.map_or_else(|| "-".to_owned(), |gpu| three(gpu.upload_ms));
        table.row([row.scene.clone(), count(row.triangles as u64), cpu, gpu, upload, ratio]);
    }
    table
}

fn travel_table(rows: &[Row]) -> Table {
    let titles = ["Travel", "rays", "CPU ms", "GPU ms", "CPU/GPU", "CPU Mray/s", "GPU Mray/s"];
    let mut table = Table::new(titles);
    for scene in scenes(rows) {
        let row = scene.any();
        let [cpu, gpu, ratio] = scene.compare(|row| row.trace_ms);
        let [cpu_rate, gpu_rate, _] = scene.compare(|row| row.mrays);
        let rays = format!("{} random", count(row.rays as u64));
        table.row([row.scene.clone(), rays, cpu, gpu, ratio, cpu_rate, gpu_rate]);
        let picture = f64::from(PICTURE) * f64::from(PICTURE);
        let [cpu, gpu, ratio] = scene.compare(|row| picture / row.primary_mrays * 1.0e-3);
        let [cpu_rate, gpu_rate, _] = scene.compare(|row| row.primary_mrays);
        let rays = format!("{PICTURE}x{PICTURE} picture");
        table.row([String::new(), rays, cpu, gpu, ratio, cpu_rate, gpu_rate]);
    }
    table
}

/// Millions of rays a second; what the sets are is told by `--help`.
fn sets_table(rows: &[Row]) -> Table {
    let mut table = Table::new(["Mray/s", "device", "a", "b", "c", "d", "d any"]);
    for row in rows {
        let rates = [row.mrays_a, row.mrays_b, row.mrays_c, row.mrays_d, row.mrays_d_any];
        table.row([row.scene.clone(), row.device.to_uppercase()].into_iter().chain(rates.map(three)));
    }
    table
}

fn tree_table(rows: &[Row]) -> Table {
    let titles = [
        "Tree",
        "nodes",
        "leaves",
        "depth",
        "refs/triangle",
        "size",
        "B/triangle",
        "peak",
        "B/triangle",
        "SAH cost",
    ];
    let mut table = Table::new(titles);
    for scene in scenes(rows) {
        let row = scene.any();
        let each = |bytes: u64| three(bytes as f64 / row.triangles as f64);
        table.row([
            row.scene.clone(),
            count(row.nodes.into()),
            count(row.leaves.into()),
            row.depth.to_string(),
            three(row.refs_per_triangle),
            bytes(row.tree_bytes),
            each(row.tree_bytes),
            bytes(row.peak_bytes),
            each(row.peak_bytes),
            three(row.sah_cost),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene on both devices, with these digests of tree and hits.
    fn pair(cpu: [&str; 2], gpu: [&str; 2]) -> Vec<Row> {
        named("box", cpu, gpu)
    }

    fn named(scene: &str, cpu: [&str; 2], gpu: [&str; 2]) -> Vec<Row> {
        let row = |device, [digest, hits]: [&str; 2]| Row {
            scene: scene.to_owned(),
            device,
            triangles: 12,
            digest: digest.to_owned(),
            hits_digest: hits.to_owned(),
            ..Row::default()
        };
        let mut rows = vec![row("cpu", cpu), row("gpu", gpu)];
        compare(&mut rows);
        rows
    }

    fn printed(rows: &[Row]) -> String {
        let mut out = Vec::new();
        let machines = Machines { cpu: None, gpu: None, automatic: false };
        print(rows, &machines, &mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn agreement_is_told() {
        let rows = pair(["t", "h"], ["t", "h"]);
        assert!(!differ(&rows));
        assert!(printed(&rows).contains("box: CPU and GPU gave byte-identical trees and hits"));
    }

    #[test]
    fn all_scenes_are_told() {
        let told = printed(&[pair(["t", "h"], ["t", "h"]), named("ball", ["x", "y"], ["x", "y"])].concat());
        for scene in ["box", "ball"] {
            assert!(
                told.contains(&format!("{scene}: CPU and GPU gave byte-identical trees and hits")),
                "{told}"
            );
            // In the tables of builds, rays, sets (on both devices) and trees.
            let rows = told.lines().filter(|line| line.starts_with(&format!("{scene} ")));
            assert_eq!(rows.count(), 5, "{told}");
        }
    }

    #[test]
    fn trees_that_auto_chose_otherwise_may_differ() {
        let mut rows = pair(["t", "h"], ["x", "h"]);
        assert!(differ(&rows));
        let mut exact = amount::Told::default();
        exact.choice = "exact";
        rows[0].auto = Some(exact);
        compare(&mut rows);
        assert!(!differ(&rows) && printed(&rows).contains("byte-identical hits by other trees"));
        rows[1].hits_digest = "y".to_owned();
        compare(&mut rows);
        assert!(differ(&rows));
    }

    #[test]
    fn any_difference_is_told_and_fails() {
        for (gpu, what) in [(["x", "h"], "tree DIFFERENT"), (["t", "x"], "hits DIFFERENT")] {
            let rows = pair(["t", "h"], gpu);
            assert!(differ(&rows));
            let told = printed(&rows);
            assert!(told.contains("box: CPU AND GPU DIFFER") && told.contains(what), "{told}");
        }
    }

    #[test]
    fn one_device_is_no_difference() {
        let mut rows = pair(["t", "h"], ["x", "y"]);
        rows.truncate(1);
        rows[0].identical = None;
        compare(&mut rows);
        assert!(!differ(&rows));
        assert!(printed(&rows).contains("box: only the CPU ran"));
    }
}
