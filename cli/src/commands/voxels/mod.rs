//! `raykd voxels`: a mesh as cubes.

mod file;
mod grid;

use crate::{
    args::{OneArgs, ReadArgs, TreeArgs, whole},
    files::Files,
    input::{Input, RepairCounts},
    machine::Machine,
    measure::ms,
    notes::Notes,
    report::{count, three, write_json},
    task::Task,
};
use anyhow::Context as _;
use clap::Parser;
use file::{Format, VoxelFile};
use grid::{Grid, Spent, volume};
use raykd::{
    BuildTimes, Device, Error, Scene,
    internals::{output, quoted},
};
use std::{
    ffi::OsString,
    io::{self, StdoutLock, Write as _},
    path::PathBuf,
    process::ExitCode,
    time::{Duration, Instant},
};

/// How many voxels are filled at once, a byte each.
const AT_ONCE: usize = 1 << 27;

const EXAMPLES: &str = "\
A voxel is filled if the winding number of its centre is not 0, as raykd inside tells it: whether
the mesh is turned inside out, overlaps itself, or has corners right at centres, is no matter. The
longest side of the mesh's box gets --size voxels, the others as many as they need.

  .npy   a numpy array of booleans, [x, y, z]; read it by numpy.load
  .vox   MagicaVoxel, 256 voxels along an axis at most; z is up there
  .png   one picture of all slices across z, from left to right, then down; x goes right, y up; 1024
         at most. In Fiji: Image > Stacks > Tools > Montage to Stack

A mesh that is not closed gets stripes along z behind its holes: a note says so, and raykd check
says where.

Examples:
  raykd voxels mesh.ply --size 256 -o mesh.npy
  raykd voxels mesh.ply --size 100 -o mesh.vox --json --device cpu";

/// Fill a closed mesh with voxels.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct VoxelsArgs {
    /// Scene name or mesh file
    pub mesh: OsString,
    /// Voxels along the longest side of the mesh's box
    #[arg(long, value_name = "N", value_parser = whole(1_u16, 4096))]
    pub size: u16,
    /// File to write: .npy, .vox or .png
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
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

/// What is told about it.
#[derive(Debug, serde::Serialize)]
struct Told {
    scene: String,
    triangles: usize,
    repairs: RepairCounts,
    closed: bool,
    device: &'static str,
    adapter: String,
    load_ms: f64,
    build_ms: f64,
    /// Of all voxels, without writing them.
    fill_ms: f64,
    /// Parts of it.
    upload_ms: f64,
    trace_ms: f64,
    download_ms: f64,
    write_ms: f64,
    rays: u64,
    /// Voxels along x, y and z.
    counts: [usize; 3],
    /// Length of an edge of a voxel.
    size: f64,
    /// The lowest corner of the first voxel.
    corner: [f64; 3],
    inside: u64,
    /// Of the voxels inside.
    volume: f64,
    /// Of the mesh, by the divergence theorem.
    mesh_volume: f64,
    /// Slices side by side in a picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    across: Option<usize>,
}

impl VoxelsArgs {
    /// What the file to write is, if it takes voxels of that size.
    fn format(&self) -> Result<Format, String> {
        Format::of(&self.output, self.size.into())
    }
}

impl Task for VoxelsArgs {
    fn files(&self) -> Files {
        Files::of_scenes(std::slice::from_ref(&self.mesh), self.read).write("-o", [self.output.clone()])
    }

    fn check(&self) -> Result<(), String> {
        self.format().map(drop)
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        let format = self.format().map_err(anyhow::Error::msg)?;
        let input = Input::load(&self.mesh, self.read, &notes)?;
        let grid = Grid::around(&input.mesh, self.size.into()).with_context(|| {
            format!("{}: no triangle has an area, so there is nothing to fill", input.name)
        })?;
        let closed = input.is_closed(&notes);
        let machine = Machine::choose(self.on.device, &self.on.more, &notes)?;
        let done = machine.run(&notes, |device| fill(device, self, format, (&input, &grid), &notes))?;
        notes.clear();
        let told = Told {
            scene: input.name.clone(),
            triangles: input.mesh.triangles().len(),
            repairs: RepairCounts::from(&input),
            closed,
            device: done.device,
            adapter: done.adapter,
            load_ms: ms(input.load),
            build_ms: ms(done.times.build),
            fill_ms: ms(done.fill),
            upload_ms: ms(done.times.upload + done.spent.times.upload),
            trace_ms: ms(done.spent.times.trace),
            download_ms: ms(done.spent.times.download),
            write_ms: ms(done.write),
            rays: done.spent.rays,
            counts: grid.counts,
            size: grid.size,
            corner: [0, 1, 2].map(|axis| grid.corner[axis] + input.translation[axis]),
            inside: done.inside,
            volume: done.inside as f64 * grid.size.powi(3),
            mesh_volume: volume(&input.mesh),
            across: (format == Format::Png).then(|| file::across(grid.counts)),
        };
        if self.json { write_json(out, &told) } else { print(&told, &self.output, out) }?;
        Ok(ExitCode::SUCCESS)
    }
}

/// What was done on a device.
struct Done {
    times: BuildTimes,
    device: &'static str,
    adapter: String,
    inside: u64,
    spent: Spent,
    fill: Duration,
    write: Duration,
}

/// Fills the voxels and writes them.
fn fill(
    device: &Device,
    args: &VoxelsArgs,
    format: Format,
    (input, grid): (&Input, &Grid),
    notes: &Notes,
) -> Result<Done, Error> {
    notes.stage(format_args!("{}: building", input.name));
    let scene = Scene::build(device, &*grid.traced(&input.mesh)?, &args.tree.options())?;
    notes.stage(format_args!("{}: filling", input.name));
    let slabs = grid.slabs(AT_ONCE);
    notes.expect(slabs.len());
    let (mut inside, mut spent, mut fill) = (0, Spent::default(), Duration::ZERO);
    let mut failed = None;
    let start = Instant::now();
    let written = output::write_whole(&args.output, |to| {
        let mut file = VoxelFile::begin(to, format, grid.counts)?;
        for xs in slabs {
            let start = Instant::now();
            let filled = grid.fill(&scene, xs.clone(), &mut spent);
            fill += start.elapsed();
            let voxels = filled.map_err(|error| {
                failed = Some(error);
                io::ErrorKind::Other
            })?;
            inside += voxels.iter().map(|&voxel| u64::from(voxel)).sum::<u64>();
            file.add(xs, &voxels)?;
            notes.step();
        }
        file.end()
    });
    if let Some(error) = failed {
        return Err(error);
    }
    written?;
    Ok(Done {
        times: scene.times().clone(),
        device: device.kind().name(),
        adapter: device.name().to_owned(),
        inside,
        spent,
        fill,
        write: start.elapsed() - fill,
    })
}

fn print(t: &Told, path: &std::path::Path, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let mut line = |name: &str, what: String| writeln!(out, "{name:<7} {what}");
    line("scene", format!("{}, {} triangles", quoted(&t.scene), count(t.triangles as u64)))?;
    if let Some(told) = t.repairs.told() {
        line("repairs", told)?;
    }
    line("device", format!("{}, {}", t.device.to_uppercase(), t.adapter))?;
    let times = [("load", t.load_ms), ("build", t.build_ms), ("fill", t.fill_ms), ("write", t.write_ms)];
    line("times", times.map(|(name, ms)| format!("{name} {} ms", three(ms))).join(", "))?;
    let ([x, y, z], [a, b, c]) = (t.counts, t.corner);
    line("grid", format!("{x} x {y} x {z} voxels, {} wide, from {a},{b},{c}", t.size))?;
    line("inside", format!("{} voxels, {} rays", count(t.inside), count(t.rays)))?;
    line("volume", format!("{} (of the mesh: {})", three(t.volume), three(t.mesh_volume)))?;
    if let Some(across) = t.across {
        line("slices", format!("{across} side by side"))?;
    }
    line("written", quoted(path.display()))?;
    Ok(())
}
