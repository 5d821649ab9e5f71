//! `raykd chart`: measure, and draw what raykd knows about itself on one page.

mod accuracy;
mod data;
mod draw;
mod figure;
mod growth;
mod page;
mod peers;
mod scale;
mod talk;
mod totals;
mod trees;
mod verdict;

use crate::report::{Table, capitals, count};
use crate::{
    args::{WhichArgs, whole},
    files::Files,
    input::Input,
    machine::Machines,
    notes::Notes,
    task::Task,
};
use clap::Parser;
use data::{Data, Effort};
use figure::{Figure, plain};
use raykd::{
    Mesh,
    internals::{output, quoted},
};
use std::{
    collections::{BTreeMap, HashSet},
    fs,
    io::{self, StdoutLock, Write as _},
    path::{Path, PathBuf},
    process::Command,
    process::ExitCode,
    time::{Instant, SystemTime},
};
use verdict::{Pair, Verdict};

const EXAMPLES: &str = "\
Examples:
  raykd chart --quick                           the teapot, into charts/index.html
  raykd chart dragon sponza stadium -o out      three scenes
  raykd chart dragon --peers peers.json         other crates too, see peers/README.md
  raykd chart teapot --device cpu --rays 4096   small";

/// Measure scenes, and draw what raykd knows about itself: one page without links, and SVG, PNG and CSV files.
///
/// The first scene is also traced by every triangle test and traversal. Times are the best of some.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ChartArgs {
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
    #[arg(long, value_name = "N", value_parser = whole(256_u32, 1 << 26))]
    pub rays: Option<u32>,
    /// What peers/ wrote with --json, for a figure of other crates
    #[arg(long, value_name = "FILE")]
    pub peers: Option<PathBuf>,
    #[command(flatten)]
    pub on: WhichArgs,
}

/// The page.
const INDEX: &str = "index.html";
/// Of the files of a figure.
const ENDINGS: [&str; 3] = ["svg", "png", "csv"];

impl Task for ChartArgs {
    fn files(&self) -> Files {
        Files::of_scenes(&self.scenes, Default::default())
            .read("--peers", &self.peers)
            .write("-o", replaced(&self.output))
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(false);
        let start = Instant::now();
        let peers = self.peers.as_deref().map(peers::read).transpose()?.unwrap_or_default();
        let folder = &self.output;
        if folder == Path::new("-") {
            anyhow::bail!("charts go to a folder, not to standard output; for a folder '-' write ./-");
        }
        output::check_folder(folder)?;
        let (inputs, machines) =
            (inputs(&self.scenes, &notes)?, Machines::choose(self.on.device, &self.on.more, &notes)?);
        let effort = Effort { quick: self.quick, rays: self.rays.unwrap_or(0) as usize };
        let mut jobs = data::scenes(&inputs, &machines, effort);
        jobs.extend(data::accuracy(&inputs[0], &machines, effort));
        jobs.extend(data::growth(&machines, effort));
        jobs.extend(data::calibrations(&machines, effort));
        let data = data::run(jobs, &notes)?;
        notes.stage("drawing");
        let (mut drawn, mut files) = (Vec::new(), Vec::new());
        for figure in figures(&data, &inputs, &peers) {
            let svg = draw::svg(&figure)?;
            let png = draw::png(&figure)?;
            let parts = [svg.as_bytes().to_vec(), png, figure.grid.csv().into_bytes()];
            files.extend(
                ENDINGS
                    .into_iter()
                    .zip(parts)
                    .map(|(ending, part)| (format!("{}.{ending}", figure.file), part)),
            );
            drawn.push((figure, svg));
        }
        let made = made(&machines);
        let page = page::page("raykd in charts", &drawn, &made);
        files.push((INDEX.to_owned(), page.into_bytes()));
        output::write_folder(folder, &files)?;
        notes.clear();
        for (figure, _) in &drawn {
            writeln!(out, "{}: {}\n", plain(&figure.title), plain(&figure.say))?;
        }
        let took = start.elapsed().as_secs();
        writeln!(
            out,
            "{} figures in {}, {took} s",
            count(drawn.len() as u64),
            quoted(folder.join(INDEX).display())
        )?;
        Ok(ExitCode::SUCCESS)
    }
}

fn inputs(names: &[String], notes: &Notes) -> anyhow::Result<Vec<Input>> {
    let usual = ["teapot".to_owned()];
    let names = if names.is_empty() { &usual } else { names };
    names.iter().map(|name| data::input(name, notes)).collect()
}

/// Files of a folder that charts may be written over.
pub(super) fn replaced(folder: &Path) -> Vec<PathBuf> {
    let files = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let figure = |path: &PathBuf| {
        let numbered = path.file_name().is_some_and(|name| name.as_encoded_bytes()[0].is_ascii_digit());
        numbered && path.extension().is_some_and(|ending| ENDINGS.iter().any(|known| ending == *known))
    };
    let index = folder.is_dir().then(|| folder.join(INDEX));
    files.filter(figure).chain(index).collect()
}

/// All figures, by number.
fn figures(data: &Data, inputs: &[Input], peers: &[peers::Peer]) -> Vec<Figure> {
    let scenes: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
    let mut all: Vec<Figure> = accuracy::figure(data, scenes[0]).into_iter().collect();
    for scene in &scenes {
        all.extend(trees::figures(data, scene));
        all.extend(totals::figure(data, scene));
    }
    all.extend(growth::sizes(data));
    all.extend(growth::threads(data));
    all.extend(talk::figures(data, &scenes));
    all.extend(peers::figures(peers));
    all.extend(verdict::auto(&verdict::verdicts(data, &meshes(inputs))));
    all.sort_by_key(|figure| figure.file.as_bytes()[0]);
    name_apart(&mut all);
    all
}

/// Numbers files of the same name: scenes may differ in what [`figure::slug`] leaves out alone.
fn name_apart(figures: &mut [Figure]) {
    let mut taken: HashSet<String> = HashSet::new();
    for figure in figures {
        let name = figure.file.clone();
        let mut number = 2;
        while !taken.insert(figure.file.clone()) {
            figure.file = format!("{name}-{number}");
            number += 1;
        }
    }
}

fn meshes(inputs: &[Input]) -> Vec<(&str, &Mesh)> {
    inputs.iter().map(|input| (input.name.as_str(), &input.mesh)).collect()
}

/// What auto would choose for scenes, and what all choices take there.
#[derive(Debug, serde::Serialize)]
pub(super) struct Checked {
    /// About how many rays were traced on each device; for more the measured rate goes on.
    traced: BTreeMap<&'static str, usize>,
    cases: Vec<Verdict>,
    costs: Vec<Pair>,
}

impl Checked {
    /// `raykd calibrate --check`.
    pub(super) fn new(names: &[String], machines: &Machines, notes: &Notes) -> anyhow::Result<Self> {
        let inputs = inputs(names, notes)?;
        let effort = Effort { quick: false, rays: 0 };
        let mut jobs = data::choices(&inputs, machines, effort);
        jobs.extend(data::calibrations(machines, effort));
        let data = data::run(jobs, notes)?;
        let meshes = meshes(&inputs);
        Ok(Self {
            traced: machines.iter().map(|device| (device.kind().name(), effort.rays(device))).collect(),
            cases: verdict::verdicts(&data, &meshes),
            costs: verdict::pairs(&data, &meshes),
        })
    }

    /// The cases, for people.
    pub(super) fn write(&self, out: &mut impl io::Write) -> io::Result<()> {
        let grid = verdict::table(&self.cases);
        let mut table = Table::new(grid.titles);
        grid.rows.into_iter().for_each(|row| table.row(row));
        writeln!(out, "{table}\n{}", verdict::say(&self.cases))?;
        for (device, &rays) in &self.traced {
            let (device, rays) = (device.to_uppercase(), count(rays as u64));
            writeln!(out, "On the {device} {rays} rays were traced; for more that rate goes on.")?;
        }
        Ok(())
    }
}

/// Machine, driver, date, commit and command.
fn made(machines: &Machines) -> Vec<String> {
    let mut made: Vec<String> =
        machines.iter().map(|device| format!("{}: {}", capitals(device), device.name())).collect();
    let now = humantime::format_rfc3339_seconds(SystemTime::now());
    // Of the checkout that this was built in, if it still is one.
    let git = Command::new("git")
        .args(["-C", env!("CARGO_MANIFEST_DIR"), "rev-parse", "--short=12", "HEAD"])
        .output();
    let commit = git
        .ok()
        .filter(|git| git.status.success())
        .map(|git| String::from_utf8_lossy(&git.stdout).trim().to_owned());
    let commit = commit.map_or_else(String::new, |commit| format!(", commit {commit}"));
    let debug = if cfg!(debug_assertions) { ", with debug checks" } else { "" };
    made.push(format!("raykd {}{commit}{debug}, {now}", env!("CARGO_PKG_VERSION")));
    // A folder's name need not be Unicode.
    let command: Vec<String> =
        std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    made.push(format!("raykd {}", command.join(" ")));
    made
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_told_and_what_was_traced() {
        let (traced, cases) = (BTreeMap::from([("cpu", 32_768)]), vec![Verdict::example(4.0, 2.0)]);
        let (case, mut told) = (verdict::say(&cases), Vec::new());
        Checked { traced, cases, costs: Vec::new() }.write(&mut told).unwrap();
        let told = String::from_utf8(told).unwrap();
        let end = format!("{case}\nOn the CPU 32,768 rays were traced; for more that rate goes on.\n");
        assert!(told.ends_with(&end) && case.starts_with("Of 1 case"), "{told}");
        assert!(told.contains("best in hindsight") && told.contains("1e3"), "{told}");
    }
}
