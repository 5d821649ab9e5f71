//! `raykd devices`: what there is to run on.

use crate::{
    notes::Notes,
    report::{bytes, write_json},
    task::Task,
};
use clap::Parser;
use raykd::{Device, Error};
use std::io::{StdoutLock, Write as _};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Every adapter computes some thousand sums and products, which are compared with the CPU's. One
that rounds otherwise, contracts or rearranges would build other trees: it is refused, unless
RAYKD_ALLOW_INEXACT=1 is set.

Examples:
  raykd devices
  raykd devices --json | jq -r '.[].adapter'";

/// List what raykd can run on: adapters, drivers, limits, and whether they compute exactly.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DevicesArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// One device; fields that only adapters have are missing for the CPU.
#[derive(Debug, Default, serde::Serialize)]
struct Told {
    device: &'static str,
    adapter: String,
    /// exact, inexact or unusable.
    probe: &'static str,
    /// Why it is not exact.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    /// Whether it is taken when no device is asked for.
    default: bool,
    max_binding_bytes: u64,
    #[serde(flatten)]
    vulkan: Option<Vulkan>,
}

/// What is known about an adapter beyond that.
#[derive(Debug, serde::Serialize)]
struct Vulkan {
    kind: &'static str,
    backend: &'static str,
    driver: String,
    driver_info: String,
    api: Option<String>,
    max_buffer_bytes: u64,
    workgroup_bytes: u32,
    workgroup_lanes: u32,
    buffers_per_kernel: u32,
    subgroup: [u32; 2],
    passthrough: bool,
    timestamps: bool,
    /// Whether the exact test computes with doubles.
    doubles: bool,
    /// Whether subnormal results survive; raykd does not depend on it.
    subnormals: Option<bool>,
}

impl Task for DevicesArgs {
    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        notes.stage("probing adapters");
        let mut devices = adapters();
        let cpu = Device::cpu();
        let first = devices.iter_mut().find(|told| told.vulkan.as_ref().is_some_and(|v| v.kind != "cpu"));
        let default = match first {
            Some(hardware) if hardware.probe == "exact" => {
                hardware.default = true;
                false
            }
            _ => true,
        };
        devices.push(Told {
            device: cpu.kind().name(),
            adapter: cpu.name().to_owned(),
            probe: "exact",
            default,
            max_binding_bytes: cpu.limit().bytes,
            ..Told::default()
        });
        notes.clear();
        if self.json {
            write_json(out, &devices)?;
            return Ok(ExitCode::SUCCESS);
        }
        for told in &devices {
            print(told, out)?;
        }
        if devices.len() == 1 {
            writeln!(out, "{}", Error::NoAdapter { wanted: None })?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

#[cfg(feature = "gpu")]
fn adapters() -> Vec<Told> {
    use raykd::{AdapterReport, AdapterVerdict};
    let tell = |report: AdapterReport| {
        let (probe, reason, subnormals) = match report.verdict {
            AdapterVerdict::Exact { subnormals } => ("exact", None, Some(subnormals)),
            AdapterVerdict::Inexact(reason) => ("inexact", Some(reason), None),
            AdapterVerdict::Unusable(reason) => ("unusable", Some(reason), None),
            other => ("unknown", Some(format!("{other:?}")), None),
        };
        let vulkan = Vulkan {
            kind: report.device_type,
            backend: report.backend,
            driver: report.driver,
            driver_info: report.driver_info,
            api: report.api,
            max_buffer_bytes: report.max_buffer_bytes,
            workgroup_bytes: report.workgroup_bytes,
            workgroup_lanes: report.workgroup_lanes,
            buffers_per_kernel: report.buffers_per_kernel,
            subgroup: report.subgroup,
            passthrough: report.passthrough,
            timestamps: report.timestamps,
            doubles: report.doubles,
            subnormals,
        };
        Told {
            device: "gpu",
            adapter: report.name,
            probe,
            reason,
            default: false,
            max_binding_bytes: report.max_binding_bytes,
            vulkan: Some(vulkan),
        }
    };
    raykd::adapters().into_iter().map(tell).collect()
}

#[cfg(not(feature = "gpu"))]
fn adapters() -> Vec<Told> {
    Vec::new()
}

fn print(t: &Told, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let default = if t.default { " (default)" } else { "" };
    writeln!(out, "{}  {}{default}", t.device.to_uppercase(), t.adapter)?;
    if let Some(v) = &t.vulkan {
        let kind = if v.kind == "cpu" { "software rasteriser" } else { v.kind };
        let api = v.api.as_deref().unwrap_or("?");
        let yes = |there: bool| if there { "yes" } else { "no" };
        writeln!(out, "     kind       {kind}, {} {api}", v.backend)?;
        writeln!(out, "     driver     {} {}", v.driver, v.driver_info)?;
        writeln!(
            out,
            "     limits     {} per binding, {} per buffer, {} buffers per kernel",
            bytes(t.max_binding_bytes),
            bytes(v.max_buffer_bytes),
            v.buffers_per_kernel
        )?;
        let [least, most] = v.subgroup;
        let subgroup = if least == most { least.to_string() } else { format!("{least} to {most}") };
        writeln!(
            out,
            "     workgroup  {} lanes, {} shared, subgroups of {subgroup}",
            v.workgroup_lanes,
            bytes(v.workgroup_bytes.into())
        )?;
        writeln!(
            out,
            "     features   SPIR-V passthrough {}, timestamps {}, quick doubles {}",
            yes(v.passthrough),
            yes(v.timestamps),
            yes(v.doubles)
        )?;
        let subnormals = match v.subnormals {
            Some(true) => "; keeps subnormals",
            Some(false) => "; flushes subnormals, which does no harm",
            None => "",
        };
        match (t.probe, &t.reason) {
            ("exact", _) => writeln!(out, "     probe      exact{subnormals}")?,
            (probe, reason) => {
                writeln!(out, "     probe      {probe}: {}", reason.as_deref().unwrap_or_default())?;
            }
        }
    }
    Ok(())
}
