//! `raykd calibrate`: what trees cost on this machine's devices.

use super::{args::CalibrateArgs, chart::Checked, machine::Machines, notes::Notes, write_json};
use crate::{
    Device, Error, output,
    plan::{CHOICES, Calibration, cache},
    report::{Table, count, three},
};
use anyhow::{Context as _, bail};
use std::{
    io::{StdoutLock, Write as _},
    path::Path,
};

pub(super) fn run(args: &CalibrateArgs, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let notes = Notes::new(args.json);
    if let Some(path) = &args.output {
        output::check(path)?;
    }
    let machines = Machines::choose(args.on.device, &args.on.more, &notes)?;
    if args.output.is_some() && machines.iter().count() > 1 {
        bail!("a file holds one device's costs: say which by --device");
    }
    if !args.check.is_empty() {
        let checked = Checked::new(&args.check, &machines, &notes)?;
        notes.clear();
        return if args.json { write_json(out, &checked) } else { Ok(checked.write(out)?) };
    }
    let mut all = Vec::new();
    for device in machines.iter() {
        let calibration = measure(device, &notes)?;
        let path = match &args.output {
            Some(path) => path.clone(),
            None => cache(device)?,
        };
        keep(&calibration, &path)?;
        all.push((calibration, path));
    }
    notes.clear();
    if args.json {
        return write_json(out, &all.iter().map(|(calibration, _)| calibration).collect::<Vec<_>>());
    }
    for (calibration, path) in &all {
        writeln!(out, "{}  {}", calibration.device.to_uppercase(), calibration.name)?;
        let mut table =
            Table::new(["Choice", "triangles", "upload ms", "build ms", "launch ms", "ns/ray", "bytes"]);
        for choice in CHOICES {
            for cost in calibration.costs.iter().filter(|cost| cost.choice == choice.name) {
                let triangles = count(cost.triangles.into());
                let numbers = [cost.upload_ms, cost.build_ms, cost.launch_ms, cost.ray_ns].map(three);
                let cells = [cost.choice.clone(), triangles].into_iter().chain(numbers);
                table.row(cells.chain([count(cost.bytes)]));
            }
        }
        writeln!(out, "{table}\nkept in {}\n", path.display())?;
    }
    Ok(())
}

fn measure(device: &Device, notes: &Notes) -> Result<Calibration, Error> {
    Calibration::of(device, |done| {
        notes.stage(format_args!(
            "measuring what trees cost on the {}, {:.0} %",
            device.kind().to_uppercase(),
            100.0 * done
        ));
    })
}

/// Writes the costs, and the folder above if it is missing.
fn keep(calibration: &Calibration, path: &Path) -> anyhow::Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    Ok(calibration.save(path)?)
}

/// The costs of a device: from the file given, or the cache, or measured now and kept there.
pub(super) fn costs(device: &Device, file: Option<&Path>, notes: &Notes) -> anyhow::Result<Calibration> {
    if let Some(path) = file {
        return Ok(Calibration::load(path, device)?);
    }
    let path = cache(device)?;
    if path.exists() {
        match Calibration::load(&path, device) {
            Ok(found) => return Ok(found),
            Err(error) => notes.note(error),
        }
    }
    notes.note(format_args!("measuring what trees cost on this {}, once", device.kind().to_uppercase()));
    let calibration = measure(device, notes)?;
    keep(&calibration, &path)?;
    Ok(calibration)
}
