//! `raykd calibrate`: what trees cost on this machine's devices.

use super::chart::Checked;
use crate::{
    args::{Which, WhichArgs},
    costs::measure,
    files::Files,
    machine::{Machines, wish},
    notes::Notes,
    report::{Table, count, three, write_json},
    task::Task,
};
use clap::Parser;
use raykd::{
    internals::quoted,
    plan::{CHOICES, create_cache_file},
};
use std::{
    io::{StdoutLock, Write as _},
    path::PathBuf,
    process::ExitCode,
};

const EXAMPLES: &str = "\
Examples:
  raykd calibrate                               all devices, into the cache
  raykd calibrate --device cpu -o cpu.json      one device, into a file
  raykd render dragon -o d.png --quality auto   uses what was measured
  raykd calibrate --check teapot dragon sponza  was auto right?";

/// Measure what trees cost on this machine's devices, for --quality auto, and keep that in the user's cache.
///
/// Leaning teapots of some sizes are built and traced by every choice that auto has. The cache is the folder named by
/// RAYKD_CACHE, or raykd in the system's. --check measures scenes instead, and tells how well auto would do there; more
/// than a million rays are not traced: the rate goes on.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CalibrateArgs {
    /// Write the costs of one device to this file, not to the cache
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Compare auto's choices with the best in hindsight, for 1e3 to 1e9 rays at these scenes
    #[arg(long, value_name = "SCENE", num_args = 1.., conflicts_with = "output")]
    pub check: Vec<String>,
    #[command(flatten)]
    pub on: WhichArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

impl Task for CalibrateArgs {
    fn files(&self) -> Files {
        Files::of_scenes(&self.check, Default::default()).write("-o", self.output.clone())
    }

    fn check(&self) -> Result<(), String> {
        let one = matches!(wish(self.on.device, &self.on.more), Some(Which::Cpu | Which::Gpu));
        if self.output.is_some() && !one {
            return Err("a file holds one device's costs: say which by --device cpu or gpu".to_owned());
        }
        Ok(())
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        let machines = Machines::choose(self.on.device, &self.on.more, &notes)?;
        if !self.check.is_empty() {
            let checked = Checked::new(&self.check, &machines, &notes)?;
            notes.clear();
            if self.json {
                write_json(out, &checked)?
            } else {
                checked.write(out)?
            }
            return Ok(ExitCode::SUCCESS);
        }
        let mut places = Vec::new();
        for device in machines.iter() {
            places.push((device, self.output.clone().map_or_else(|| create_cache_file(device), Ok)?));
        }
        let mut all = Vec::new();
        for (device, path) in places {
            let calibration = measure(device, &notes)?;
            calibration.save(&path)?;
            all.push((calibration, path));
        }
        notes.clear();
        if self.json {
            write_json(out, &all.iter().map(|(calibration, _)| calibration).collect::<Vec<_>>())?;
            return Ok(ExitCode::SUCCESS);
        }
        for (calibration, path) in &all {
            writeln!(out, "{}  {}", calibration.device().to_uppercase(), calibration.name())?;
            let mut table = Table::new([
                "Choice",
                "triangles",
                "upload ms",
                "build ms",
                "launch ms",
                "ns/ray",
                "bytes",
                "spread",
            ]);
            for &choice in CHOICES {
                for cost in calibration.costs().iter().filter(|cost| cost.choice == choice.name) {
                    let triangles = count(cost.triangles.into());
                    let numbers = [cost.upload_ms, cost.build_ms, cost.launch_ms, cost.ray_ns].map(three);
                    let cells = [cost.choice.clone(), triangles].into_iter().chain(numbers);
                    table.row(cells.chain([count(cost.bytes), three(cost.spread)]));
                }
            }
            writeln!(out, "{table}\nkept in {}\n", quoted(path.display()))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
