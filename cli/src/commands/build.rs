//! `raykd build`: one tree, its statistics and its file.

use crate::{
    amount::{self, Job},
    args::{HowArgs, OneArgs, ReadArgs, Which, whole},
    builders,
    files::Files,
    input::{Input, RepairCounts},
    machine::Machines,
    measure::{self, Kernel, kernel_table, ms},
    notes::Notes,
    report::{bytes, count, three, write_json},
    task::Task,
};
use clap::Parser;
use raykd::{BuildOptions, Device, Error, KdTree, Traversal, internals::quoted};
use std::{
    ffi::OsString,
    io::{StdoutLock, Write as _},
    path::PathBuf,
    process::ExitCode,
};

const EXAMPLES: &str = "\
Examples:
  raykd build dragon                            statistics of the tree
  raykd build mesh.ply.gz -o mesh.kd            save it, for trace --tree or the crate raykd-shared
  raykd build mesh.obj --cost-test 2 --json     dearer triangle tests: more nodes, shorter leaves
  raykd build sponza --builder exact            the best tree, more slowly
  raykd build --compare dragon                  every builder on CPU and GPU, in a table
  raykd build --scaling                         how build time grows with the mesh";

/// Build the tree of a mesh, and print its statistics and digest; or compare builders.
///
/// --compare builds by every builder on CPU and GPU and traces a picture's rays and a bounce from each hit; exit code
/// 1 if a builder's trees differ. --scaling builds teapots of a thousand to ten million triangles.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct BuildArgs {
    /// Scene name or mesh file
    #[arg(required_unless_present = "scaling")]
    pub mesh: Option<OsString>,
    /// Save the tree to this file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Compare all builders on CPU and GPU
    #[arg(long, conflicts_with_all = ["output", "builder", "profile", "scaling", "quality"])]
    pub compare: bool,
    /// Build teapots of many sizes on CPU and GPU
    #[arg(long, conflicts_with_all = ["output", "profile", "mesh", "quality"])]
    pub scaling: bool,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: OneArgs,
    #[command(flatten)]
    pub how: HowArgs,
    /// With --quality auto: how many rays the tree is for; left out: a million
    #[arg(long, value_name = "N", value_parser = whole(1, u64::MAX))]
    pub rays: Option<u64>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Time every kernel too; with the cargo feature traffic, tell what it moves
    #[arg(long)]
    pub profile: bool,
}

/// Rays that a tree is for if nothing is said.
const USUAL_RAYS: u64 = 1_000_000;

/// What is told about a tree.
#[derive(Debug, serde::Serialize)]
struct Told {
    scene: String,
    /// In the file.
    triangles: usize,
    /// That take part.
    kept: usize,
    repairs: RepairCounts,
    device: &'static str,
    adapter: String,
    load_ms: f64,
    upload_ms: f64,
    build_ms: f64,
    /// Laying triangles out for tracing, after the build.
    layout_ms: f64,
    /// How many builds these times are medians of; one more came before, to warm up.
    builds: usize,
    /// How often each build was repeated with more room, or at a higher price.
    retries: u32,
    /// What the tries before the last took in all, in the last of the builds.
    failed_ms: f64,
    /// Whether the host built the tree because the device had not the room to.
    by_host: bool,
    nodes: u32,
    leaves: u32,
    empty_leaves: u32,
    largest_leaf: u32,
    depth: u32,
    refs: u32,
    refs_per_triangle: f64,
    tree_bytes: u64,
    peak_bytes: u64,
    builder: &'static str,
    clip: bool,
    cost_step: f32,
    cost_test: f32,
    sah_cost: f64,
    /// Of a random line that meets the root's box.
    expected_steps: f64,
    expected_tests: f64,
    /// SHA-256 of header, nodes and references.
    digest: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    auto: Option<amount::Told>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    kernels: Vec<Kernel>,
}

impl Task for BuildArgs {
    fn files(&self) -> Files {
        Files::of_scenes(self.mesh.as_slice(), self.read)
            .read("--costs", &self.how.amount.costs)
            .write("-o", self.output.clone())
    }

    fn check(&self) -> Result<(), String> {
        self.how.check(self.rays.is_some())
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        let several = || Machines::choose(self.on.device.map(Which::from), &self.on.more, &notes);
        let options = self.how.tree.options();
        if self.compare {
            let input = Input::load(self.mesh.as_deref().unwrap_or_default(), self.read, &notes)?;
            return builders::compare(&input, &several()?, (&options, self.json), &notes, out);
        }
        if self.scaling {
            return builders::scaling(&several()?, (&options, self.json), &notes, out);
        }
        let input = Input::load(self.mesh.as_deref().unwrap_or_default(), self.read, &notes)?;
        let job = Job { mesh: &input.mesh, rays: self.rays.unwrap_or(USUAL_RAYS), needs_tree: true };
        let device = &self.on;
        let (machine, amount) = amount::decide(&self.how, Traversal::default(), device, job, &notes)?;
        notes.stage(format_args!("{}: building", input.name));
        let options = amount.options.with_profile(self.profile);
        let (mut told, tree) = machine.run(&notes, |device| build(device, &input, &options))?;
        let before = told.upload_ms + told.build_ms + told.layout_ms;
        told.auto = amount.plan.map(|plan| amount::Told::new(&plan, before, None));
        if let Some(path) = &self.output {
            notes.stage(format_args!("writing {}", path.display()));
            tree.save(path)?;
        }
        if let Some(budget) = self.how.tree.budget
            && told.refs > (f64::from(budget) * told.kept as f64) as u32
        {
            let each = f64::from(told.refs) / told.kept as f64;
            notes.note(format_args!(
                "{} does not keep to the budget: {each:.2} references a triangle",
                told.builder
            ));
        }
        if told.by_host {
            notes.note(format_args!(
                "{} has not the room to build by exact; the host built the same tree",
                told.adapter
            ));
        }
        notes.clear();
        if self.json { write_json(out, &told) } else { print(&told, self, out) }?;
        Ok(ExitCode::SUCCESS)
    }
}

fn build(device: &Device, input: &Input, options: &BuildOptions) -> Result<(Told, KdTree), Error> {
    let mesh = &input.mesh;
    let built = measure::build(device, mesh, options)?;
    let (header, report, times) = (*built.scene.header(), built.report, built.scene.times());
    let told = Told {
        scene: input.name.clone(),
        triangles: mesh.triangles().len(),
        kept: mesh.kept().len(),
        repairs: input.into(),
        device: device.kind().name(),
        adapter: device.name().to_owned(),
        load_ms: ms(input.load),
        upload_ms: ms(built.upload),
        build_ms: ms(built.build),
        layout_ms: ms(built.layout),
        builds: built.builds,
        retries: times.retries,
        failed_ms: ms(times.failed),
        by_host: times.by_host,
        nodes: header.nodes,
        leaves: report.leaves,
        empty_leaves: report.empty_leaves,
        largest_leaf: report.largest_leaf,
        depth: header.depth,
        refs: header.refs,
        refs_per_triangle: f64::from(header.refs) / mesh.triangles().len() as f64,
        tree_bytes: built.tree.size_in_bytes(),
        peak_bytes: times.peak_bytes,
        builder: options.builder.name(),
        clip: options.clip,
        cost_step: header.cost_step,
        cost_test: header.cost_test,
        sah_cost: report.sah_cost,
        expected_steps: report.expected_steps,
        expected_tests: report.expected_tests,
        digest: built.tree.digest(),
        auto: None,
        kernels: built.kernels,
    };
    Ok((told, built.tree))
}

fn print(t: &Told, args: &BuildArgs, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let each = |bytes: u64| three(bytes as f64 / t.triangles as f64);
    let mut line = |name: &str, what: String| writeln!(out, "{name:<10} {what}");
    line("scene", format!("{}, {} triangles", quoted(&t.scene), count(t.triangles as u64)))?;
    line("repairs", t.repairs.told().unwrap_or_else(|| "none".to_owned()))?;
    line("device", format!("{}, {}", t.device.to_uppercase(), t.adapter))?;
    line(
        "times",
        format!(
            "load {} ms; medians of {} builds, after one more: upload {} ms, build {} ms, layout for tracing {} ms",
            three(t.load_ms),
            t.builds,
            three(t.upload_ms),
            three(t.build_ms),
            three(t.layout_ms)
        ),
    )?;
    if t.retries > 0 {
        line(
            "retries",
            format!("{} tries before, {} ms more for each build", t.retries, three(t.failed_ms)),
        )?;
    }
    line(
        "nodes",
        format!(
            "{}, of these {} leaves ({} empty), depth {}",
            count(t.nodes.into()),
            count(t.leaves.into()),
            count(t.empty_leaves.into()),
            t.depth
        ),
    )?;
    line(
        "references",
        format!(
            "{}, {} per triangle, at most {} in a leaf",
            count(t.refs.into()),
            three(t.refs_per_triangle),
            count(t.largest_leaf.into())
        ),
    )?;
    line(
        "bytes",
        format!(
            "tree {} ({} per triangle), at most {} ({}) while building",
            bytes(t.tree_bytes),
            each(t.tree_bytes),
            bytes(t.peak_bytes),
            each(t.peak_bytes)
        ),
    )?;
    line(
        "SAH cost",
        format!(
            "{}: {} steps at {}, {} triangle tests at {}",
            three(t.sah_cost),
            three(t.expected_steps),
            t.cost_step,
            three(t.expected_tests),
            t.cost_test
        ),
    )?;
    if let Some(auto) = &t.auto {
        line("auto", auto.words())?;
    }
    line("digest", t.digest.clone())?;
    if let Some(path) = &args.output {
        line("saved", quoted(path.display()))?;
    }
    if !t.kernels.is_empty() {
        write!(out, "\n{}", kernel_table("kernel", &t.kernels))?;
    }
    Ok(())
}
