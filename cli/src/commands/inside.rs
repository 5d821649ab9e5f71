//! `raykd inside`: which points a mesh goes round.

use crate::{
    args::{OneArgs, ReadArgs, TreeArgs},
    files::Files,
    input::{Input, RepairCounts},
    machine::Machine,
    measure::{mrays, ms},
    notes::Notes,
    npy,
    points::Points,
    report::{count, three, write_json},
    task::Task,
};
use clap::Parser;
use raykd::{
    Counted, Device, Error, Scene,
    internals::{output, quoted},
};
use std::{
    ffi::OsString,
    io::{StdoutLock, Write as _},
    path::PathBuf,
    process::ExitCode,
};

const EXAMPLES: &str = "\
Points: a CSV of x,y,z a line (more columns and a line of names are kept, lines that begin with #
are not), an NPY array of N x 3 f32 or f64, or the vertices of a PLY file. Out come the same points
with the winding number in one more column: 0 outside, 1 inside a mesh whose triangles are
counterclockwise seen from outside, -1 if clockwise, more where the mesh overlaps itself.

A file to write whose name ends in .npy becomes an NPY array of f64 with four columns, any other a
CSV. Standard output gets an NPY array if the points came in one, else a CSV. Points with NaN or
infinite coordinates get 0, and are counted.

A point on the surface counts as if it were moved a little, always in the same direction. Of a mesh
that is not closed no number is right everywhere: a note says so, and raykd check says where.

Examples:
  raykd inside mesh.ply --points points.csv                     to standard output
  raykd inside mesh.ply --points points.npy -o winding.npy
  raykd inside mesh.ply --points points.csv -o out.csv --json --device cpu";

/// Tell which points are inside a mesh: the winding number of each.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct InsideArgs {
    /// Scene name or mesh file
    pub mesh: OsString,
    /// File of points: .csv, .npy or .ply
    #[arg(long, value_name = "FILE")]
    pub points: PathBuf,
    /// File to write; left out: standard output
    #[arg(short, long, value_name = "FILE", required_if_eq("json", "true"))]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub tree: TreeArgs,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: OneArgs,
    /// Print JSON about it
    #[arg(long)]
    pub json: bool,
}

const INVALID: &str = "(NaN, infinite or too far away): they get 0";

/// What is told about it.
#[derive(Debug, serde::Serialize)]
struct Told {
    scene: String,
    triangles: usize,
    repairs: RepairCounts,
    /// Whether the surface is closed and turned one way, part by part.
    closed: bool,
    device: &'static str,
    adapter: String,
    load_ms: f64,
    build_ms: f64,
    upload_ms: f64,
    trace_ms: f64,
    download_ms: f64,
    /// Millions of points a second, by the kernel's time.
    mpoints: f64,
    points: usize,
    /// Points whose winding number is not 0.
    inside: usize,
    /// Invalid points.
    invalid: u64,
}

impl Task for InsideArgs {
    fn files(&self) -> Files {
        Files::of_scenes(std::slice::from_ref(&self.mesh), self.read)
            .read("--points", [&self.points])
            .write("-o", self.output.clone())
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json || self.output.is_none());
        let points = Points::read(&self.points, self.read.limit())?;
        let input = Input::load(&self.mesh, self.read, &notes)?;
        let [x, y, z] = input.translation;
        let local: Vec<[f64; 3]> = points.points.iter().map(|p| [p[0] - x, p[1] - y, p[2] - z]).collect();
        let closed = input.is_closed(&notes);
        let machine = Machine::choose(self.on.device, &self.on.more, &notes)?;
        let options = self.tree.options();
        let work = |device: &Device| -> Result<_, Error> {
            notes.stage(format_args!("{}: building", input.name));
            let scene = Scene::build(device, &input.mesh, &options)?;
            notes.stage(format_args!("{}: {} points", input.name, count(local.len() as u64)));
            let found = scene.winding(&local)?;
            Ok((found, scene.times().clone(), device.kind().name(), device.name().to_owned()))
        };
        let (found, times, device, adapter) = machine.run(&notes, work)?;
        let Counted { counts, times: spent, invalid, .. } = found;
        let told = Told {
            scene: input.name.clone(),
            triangles: input.mesh.triangles().len(),
            repairs: RepairCounts::from(&input),
            closed,
            device,
            adapter,
            load_ms: ms(input.load),
            build_ms: ms(times.build),
            upload_ms: ms(times.upload + spent.upload),
            trace_ms: ms(spent.trace),
            download_ms: ms(spent.download),
            mpoints: mrays(counts.len(), spent.trace),
            points: counts.len(),
            inside: counts.iter().filter(|&&winding| winding != 0).count(),
            invalid,
        };
        let Some(path) = &self.output else {
            if invalid > 0 {
                notes.note(format_args!("invalid points: {} {INVALID}", count(invalid)));
            }
            notes.clear();
            points.write(out, &counts, points.are_npy())?;
            return Ok(ExitCode::SUCCESS);
        };
        notes.stage(format_args!("writing {}", path.display()));
        output::write_whole(path, |file| points.write(file, &counts, npy::is_named(path)))?;
        notes.clear();
        if self.json { write_json(out, &told) } else { print(&told, path, out) }?;
        Ok(ExitCode::SUCCESS)
    }
}

fn print(t: &Told, path: &std::path::Path, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let mut line = |name: &str, what: String| writeln!(out, "{name:<7} {what}");
    line("scene", format!("{}, {} triangles", quoted(&t.scene), count(t.triangles as u64)))?;
    if let Some(told) = t.repairs.told() {
        line("repairs", told)?;
    }
    line("device", format!("{}, {}", t.device.to_uppercase(), t.adapter))?;
    let times = [("load", t.load_ms), ("build", t.build_ms), ("trace", t.trace_ms)];
    line("times", times.map(|(name, ms)| format!("{name} {} ms", three(ms))).join(", "))?;
    line(
        "points",
        format!(
            "{} ({} inside), {} Mpoint/s",
            count(t.points as u64),
            count(t.inside as u64),
            three(t.mpoints)
        ),
    )?;
    if t.invalid > 0 {
        line("invalid", format!("{} {INVALID}", count(t.invalid)))?;
    }
    line("written", quoted(path.display()))?;
    Ok(())
}
