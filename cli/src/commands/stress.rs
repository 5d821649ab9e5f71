//! `raykd stress`: scenes in which ray tracers fail, by every method, judged exactly.

use crate::{
    args::{ReadArgs, WhichArgs, whole},
    files::Files,
    input::Input,
    machine::Machines,
    notes::Notes,
    report::{Table, capitals, count, three, write_json},
    task::Task,
};
use anyhow::{Context as _, anyhow, bail};
use clap::Parser;
use raykd::{
    Device, Error, Hit, Ray,
    internals::quoted,
    rays,
    rays::Camera,
    stress::{CASES, Case, Method, Outcome, Trial, Way, leaks::Surface},
};
use std::{
    collections::BTreeMap,
    ffi::{OsStr, OsString},
    io::{StdoutLock, Write as _},
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

const EXAMPLES: &str = "\
Examples:
  raykd stress                                  all scenes and methods, a minute or less
  raykd stress --list                           what there is
  raykd stress --scene slivers --method exact   one scene, by all ways with the exact test
  raykd stress --scene dragon --method exact    rays at your own mesh, against the exact answers
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
    /// Rays a scene, at most 2^28 (268435456); of leaks, a surface, and any number; of a mesh, half as many more
    #[arg(long, value_name = "N", default_value_t = 1000)]
    #[arg(value_parser = whole(1_u64, 1_000_000_000_000))]
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

/// Name of the scenes of [`Surface`].
const LEAKS: &str = "leaks";

/// As many rays, if they are not too many to be in memory at once.
fn at_once(rays: u64) -> Result<usize, String> {
    let fits = usize::try_from(rays).ok().filter(|&rays| rays <= 1 << 28);
    fits.ok_or_else(|| {
        format!("{} rays are too many: all scenes but leaks take at most 2^28 (268435456)", count(rays))
    })
}

/// One method in one scene on one device.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
struct Row {
    scene: String,
    method: String,
    device: String,
    rays: u64,
    failures: u64,
    failures_per_million: f64,
    /// The method is known to fail there.
    expected: bool,
    /// No failure, or an expected one.
    ok: bool,
    /// Rays whose answer names another triangle than the exact one, wrong or within rounding.
    inexact: u64,
    /// Failures by kind.
    kinds: BTreeMap<String, u64>,
    /// Errors of `t` in ULP: half of them, 99.9 %, all are at most so large.
    #[serde(skip_serializing_if = "Option::is_none")]
    t_ulp: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mrays: Option<f64>,
    /// Why the device would not do it.
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    example: Option<Example>,
}

/// A ray that failed.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
struct Example {
    /// Rays of the scene that it is one of.
    rays: u64,
    part: usize,
    number: usize,
    why: String,
    /// Bits of origin, direction, `t_min` and `t_max`.
    ray: [u32; 8],
    /// In words.
    told: String,
}

impl Row {
    fn new(scene: &str, method: &Method, device: &Device) -> Self {
        Self {
            scene: scene.to_owned(),
            method: method.name(),
            device: device.kind().to_string(),
            ok: true,
            ..Self::default()
        }
    }

    fn counted(mut self, rays: u64, failures: u64, expected: bool) -> Self {
        self.failures_per_million = failures as f64 * 1.0e6 / rays.max(1) as f64;
        self.ok = failures == 0 || expected;
        Self { rays, failures, expected, ..self }
    }
}

impl Task for StressArgs {
    fn files(&self) -> Files {
        Files::of_scenes(&self.scenes, self.read).read("--replay", &self.replay)
    }

    fn check(&self) -> Result<(), String> {
        // Leaks are traced part by part.
        let in_parts = !self.scenes.is_empty() && self.scenes.iter().all(|scene| scene == LEAKS);
        if in_parts { Ok(()) } else { at_once(self.rays).map(drop) }
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        if self.list {
            return list(out);
        }
        let notes = Notes::new(self.json);
        let methods = methods(&self.methods)?;
        let failed = self.replay.as_deref().map(read).transpose()?;
        let machines = Machines::choose(self.on.device, &self.on.more, &notes)?;
        let rows = match failed {
            Some(failed) => replay(&failed, self.read, &machines, &notes)?,
            None => stress(self, &methods, &machines, &notes)?,
        };
        notes.clear();
        if self.json { write_json(out, &rows) } else { print(&rows, &machines, out) }?;
        Ok(if rows.iter().all(|row| row.ok) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}

fn list(out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
    writeln!(out, "Scenes:")?;
    for case in CASES {
        writeln!(out, "  {:16} {}", case.name, case.about)?;
    }
    writeln!(out, "  {LEAKS:16} rays at edges and vertices of surfaces without gaps, as many as you like")?;
    writeln!(out, "\nMethods:")?;
    for method in Method::all() {
        writeln!(out, "  {}", method.name())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The methods of these names, or whose names start so.
fn methods(wishes: &[String]) -> anyhow::Result<Vec<Method>> {
    let all = Method::all();
    let fits = |method: &Method, wish: &str| {
        let name = method.name();
        name == wish || name.starts_with(wish) && all.iter().all(|method| method.name() != wish)
    };
    if let Some(wish) = wishes.iter().find(|wish| !all.iter().any(|method| fits(method, wish))) {
        bail!("no method is called {}...; `raykd stress --list` names all", quoted(wish));
    }
    let wanted = |method: &Method| wishes.is_empty() || wishes.iter().any(|wish| fits(method, wish));
    Ok(all.iter().copied().filter(wanted).collect())
}

/// The scene of this name, or one of the rays by which other commands look at a mesh.
fn trial(wish: &OsStr, rays: u64, read: ReadArgs, notes: &Notes) -> anyhow::Result<Trial> {
    let name = &*wish.to_string_lossy();
    notes.stage(format_args!("{name}: making it"));
    let rays = at_once(rays).map_err(|why| anyhow!("{}: {why}", quoted(name)))?;
    if let Some(case) = CASES.iter().find(|case: &&Case| case.name == name) {
        return Ok(case.prepare(rays)?);
    }
    let mesh = Input::load(wish, read, notes)
        .with_context(|| {
            format!("{} is neither a stress scene (`raykd stress --list`) nor a mesh", quoted(name))
        })?
        .mesh;
    let side = ((rays as f64).sqrt() as u32).max(1);
    let mut set = Camera::framing(mesh.bounds()).rays(side, side);
    set.extend(rays::random(mesh.bounds(), rays.div_ceil(2), 1));
    notes.stage(format_args!("{name}: exact answers"));
    Ok(Trial::new(name.to_owned(), mesh, set)?)
}

fn stress(
    args: &StressArgs,
    methods: &[Method],
    machines: &Machines,
    notes: &Notes,
) -> anyhow::Result<Vec<Row>> {
    let all = CASES.iter().map(|case| case.name.into()).collect();
    let scenes = if args.scenes.is_empty() { all } else { args.scenes.clone() };
    let mut rows = Vec::new();
    for wish in scenes {
        if wish == LEAKS {
            leaks(args, methods, machines, notes, &mut rows)?;
            continue;
        }
        let mut trial = trial(&wish, args.rays, args.read, notes)?;
        // The CPU's answers first: others are compared with them.
        for device in machines.iter() {
            let methods: Vec<_> = methods.iter().filter(|method| trial.runs(method, device)).collect();
            for method in methods {
                notes.stage_on(wish.display(), method.name(), device);
                let done = row(&mut trial, method, device, args.rays, None);
                rows.extend(machines.spared(device, done, "without it", notes)?);
            }
        }
    }
    Ok(rows)
}

fn row(
    trial: &mut Trial,
    method: &Method,
    device: &Device,
    rays: u64,
    only: Option<(usize, usize)>,
) -> Result<Row, Error> {
    let mut row = Row::new(&trial.name, method, device);
    let outcome = match trial.run(method, device, only) {
        Ok(outcome) => outcome,
        // Said, not wrong.
        Err(error @ Error::Kernel(_)) => {
            row.refused = Some(error.to_string());
            return Ok(row);
        }
        Err(error) => return Err(error),
    };
    row.kinds = outcome.kinds.iter().map(|&(kind, count)| (kind.name().to_owned(), count)).collect();
    row.inexact = outcome.inexact;
    row.t_ulp = outcome.ulps;
    row.example = example(trial, &outcome, rays);
    Ok(row.counted(outcome.rays, outcome.failures, outcome.expected))
}

/// One failing ray, so that it can be found again.
fn example(trial: &Trial, outcome: &Outcome, rays: u64) -> Option<Example> {
    let failed = outcome.example?;
    let part = &trial.parts()[failed.part];
    let ray = part.rays[failed.ray];
    let hit = |hit: &Hit| {
        if hit.is_hit() { format!("triangle {} at {}", hit.triangle, hit.t) } else { "a miss".to_owned() }
    };
    let exact = failed.exact.map_or("a miss".to_owned(), |c| format!("triangle {} at {}", c.triangle, c.t));
    let name = if part.name.is_empty() { String::new() } else { format!(" ({})", part.name) };
    Some(Example {
        rays,
        part: failed.part,
        number: failed.ray,
        why: failed.why.name().to_owned(),
        ray: bytemuck::cast(ray),
        told: format!(
            "ray {}{name}, {:?} + t {:?}, t {} to {}: {}; it is {exact}",
            failed.ray,
            ray.origin,
            ray.direction,
            ray.t_min,
            ray.t_max,
            hit(&failed.answer)
        ),
    })
}

/// Rays at surfaces without gaps.
fn leaks(
    args: &StressArgs,
    methods: &[Method],
    machines: &Machines,
    notes: &Notes,
    rows: &mut Vec<Row>,
) -> anyhow::Result<()> {
    let surfaces = Surface::all();
    if !surfaces.iter().any(|surface| surface.name == "dragon_res4") {
        notes.note("without dragon_res4: `cargo xtask scenes` fetches it");
    }
    for surface in surfaces {
        let name = format!("{LEAKS}/{}", surface.name);
        for device in machines.iter() {
            for method in methods.iter().filter(|m| matches!(m.way, Way::Brute | Way::Tree(..))) {
                let scene = method.scene(device, &surface.mesh, None)?;
                let start = Instant::now();
                let told = |done: u64| {
                    let rate = done as f64 * 1.0e-6 / start.elapsed().as_secs_f64();
                    notes.stage(format_args!(
                        "{name}: {} on the {}, {} of {} rays, {} Mray/s",
                        method.name(),
                        capitals(device),
                        count(done),
                        count(args.rays),
                        three(rate)
                    ));
                };
                let found = surface.run(args.rays, |rays| scene.closest(rays), told)?;
                let mut row = Row::new(&name, method, device);
                row.mrays = Some(found.rays as f64 * 1.0e-6 / start.elapsed().as_secs_f64());
                row.example = found.example.map(|ray: Ray| Example {
                    rays: args.rays,
                    part: 0,
                    number: 0,
                    why: "leak".to_owned(),
                    ray: bytemuck::cast(ray),
                    told: format!("{ray:?}: a miss"),
                });
                if found.leaks > 0 {
                    row.kinds.insert("leak".to_owned(), found.leaks);
                }
                rows.push(row.counted(found.rays, found.leaks, !method.test.keeps_contract()));
            }
        }
    }
    Ok(())
}

/// Rows of an earlier run that have a ray to trace again.
fn read(path: &Path) -> anyhow::Result<Vec<Row>> {
    let bytes = raykd::internals::all_of(path, raykd::default_max_bytes())?;
    let rows: Vec<Row> = serde_json::from_slice(&bytes)
        .with_context(|| format!("{}: not what raykd stress --json writes", quoted(path.display())))?;
    Ok(rows.into_iter().filter(|row| row.example.is_some()).collect())
}

/// Traces one ray each again, on the device it failed on.
fn replay(failed: &[Row], read: ReadArgs, machines: &Machines, notes: &Notes) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for old in failed {
        let Some(example) = &old.example else { continue };
        let method = methods(std::slice::from_ref(&old.method))?.remove(0);
        let Some(device) = machines.iter().find(|device| device.kind().name() == old.device) else {
            notes.note(format_args!(
                "{} failed on a {}; there is none here",
                quoted(&old.scene),
                quoted(&old.device)
            ));
            continue;
        };
        let ray: Ray = bytemuck::cast(example.ray);
        let mut row = Row::new(&old.scene, &method, device);
        if let Some(name) = old.scene.strip_prefix(LEAKS).and_then(|rest| rest.strip_prefix('/')) {
            let surface = Surface::all().into_iter().find(|surface| surface.name == name);
            let surface =
                surface.with_context(|| format!("{}: there is no such surface", quoted(&old.scene)))?;
            let hit = method.scene(device, &surface.mesh, None)?.closest(&[ray])?[0];
            row = row.counted(1, u64::from(!hit.is_hit()), old.expected);
        } else {
            let mut trial = trial(old.scene.as_ref(), example.rays, read, notes)?;
            let at = (example.part, example.number);
            let same = trial.parts().get(at.0).and_then(|part| part.rays.get(at.1));
            if same.is_none_or(|same| bytemuck::bytes_of(same) != bytemuck::bytes_of(&ray)) {
                bail!(
                    "{}: this version of raykd makes other rays; run raykd stress --json again",
                    quoted(&old.scene)
                );
            }
            if let (Some(cpu), "gpu") = (&machines.cpu, device.kind().name()) {
                trial.run(&method, cpu, Some(at))?;
            }
            row = self::row(&mut trial, &method, device, example.rays, Some(at))?;
        }
        row.example = row.example.or_else(|| Some(example.clone()));
        rows.push(row);
    }
    Ok(rows)
}

fn print(rows: &[Row], machines: &Machines, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    /// Rows that are read one by one.
    const FEW: usize = 60;
    machines.write_names(out)?;
    let table = if rows.len() > FEW { matrix(rows) } else { list_of(rows) };
    writeln!(out, "{table}")?;
    for row in rows.iter().filter(|row| !row.ok) {
        if let Some(example) = &row.example {
            writeln!(
                out,
                "{} {} {}: {}, {}",
                quoted(&row.scene),
                row.method,
                row.device,
                example.why,
                example.told
            )?;
        }
    }
    let bad = rows.iter().filter(|row| !row.ok).count();
    writeln!(out, "{bad} of {} rows (scene, method, device) fail and are not known to.", rows.len())?;
    Ok(())
}

/// A cell: the failures per million, and what to think of them.
fn told(row: &Row) -> String {
    match (&row.refused, row.failures, row.expected) {
        (Some(_), ..) => "refused".to_owned(),
        (None, 0, _) => "pass".to_owned(),
        (None, _, true) => format!("{} known", three(row.failures_per_million)),
        (None, _, false) => format!("{} FAILS", three(row.failures_per_million)),
    }
}

/// Scenes by triangle tests: of all ways and devices the worst.
fn matrix(rows: &[Row]) -> Table {
    let group = |row: &Row| row.method.split('/').next().unwrap_or_default().to_owned();
    let mut groups: Vec<String> = Vec::new();
    let mut scenes: Vec<&str> = Vec::new();
    for row in rows {
        if !groups.contains(&group(row)) {
            groups.push(group(row));
        }
        if !scenes.contains(&row.scene.as_str()) {
            scenes.push(&row.scene);
        }
    }
    let mut table = Table::new([&["Failures per million".to_owned()], &groups[..]].concat());
    for scene in scenes {
        let worst = |wanted: &String| {
            let here = rows.iter().filter(|row| row.scene == scene && group(row) == *wanted);
            here.max_by(|a, b| {
                (!a.ok, a.failures_per_million).partial_cmp(&(!b.ok, b.failures_per_million)).expect("no NaN")
            })
        };
        let cells = groups.iter().map(|group| worst(group).map_or_else(String::new, told));
        table.row([vec![scene.to_owned()], cells.collect()].concat());
    }
    table
}

/// One method in one scene on one device a line.
fn list_of(rows: &[Row]) -> Table {
    let mut table =
        Table::new(["Scene", "method", "device", "rays", "failures / M", "kinds", "t ULP 99.9 %"]);
    for row in rows {
        table.row([
            row.scene.clone(),
            row.method.clone(),
            row.device.to_uppercase(),
            count(row.rays),
            told(row),
            row.kinds.keys().cloned().collect::<Vec<_>>().join(" "),
            row.t_ulp.map_or_else(String::new, |[_, most, _]| three(most)),
        ]);
    }
    table
}
