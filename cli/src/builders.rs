//! `raykd build --compare`: every builder on every device, in one table; `--scaling`: cost against size.

use crate::{
    input::Input,
    machine::{Machines, at_fault},
    measure::{self, mrays, ms},
    notes::Notes,
    report::{Table, bytes, capitals, count, three, write_json},
};
use raykd::{
    BuildOptions, Builder, Device, Error, Mesh, Query,
    internals::{quoted, teapot_level_for},
    rays::sets::Sets,
};
use std::{
    io::{StdoutLock, Write as _},
    process::ExitCode,
};

/// One builder on one device.
#[derive(Clone, Debug, Default, serde::Serialize)]
struct Row {
    builder: &'static str,
    device: &'static str,
    build_ms: f64,
    build_ms_per_million: f64,
    upload_ms: f64,
    sah_cost: f64,
    /// Of a random line that meets the root's box.
    expected_steps: f64,
    expected_tests: f64,
    /// Measured: mean of primary and diffuse rays.
    steps_per_ray: f64,
    tests_per_ray: f64,
    leaves: u32,
    empty_leaves: u32,
    depth: u32,
    refs_per_triangle: f64,
    bytes_per_triangle: f64,
    peak_bytes: u64,
    mrays_primary: f64,
    mrays_diffuse: f64,
    digest: String,
}

/// A build of one size.
#[derive(Clone, Debug, serde::Serialize)]
struct Size {
    device: &'static str,
    triangles: usize,
    build_ms: f64,
    build_ms_per_million: f64,
    peak_bytes: u64,
    /// How the time grew since the size before: as its power; 1 is linear.
    exponent: Option<f64>,
}

/// Every builder on every device, by these options but for the builder.
pub(super) fn compare(
    input: &Input,
    machines: &Machines,
    (options, json): (&BuildOptions, bool),
    notes: &Notes,
    out: &mut StdoutLock<'_>,
) -> anyhow::Result<ExitCode> {
    let mut sets = None;
    let mut rows = Vec::new();
    for device in machines.iter() {
        for &builder in Builder::ALL {
            notes.stage_on(&input.name, builder.name(), device);
            let options = options.clone().with_builder(builder).with_profile(false);
            let done = row(device, input, &options, &mut sets);
            rows.extend(machines.spared(device, done, "without it", notes)?);
        }
    }
    notes.clear();
    let same = agree(&rows);
    if json {
        write_json(out, &rows)?;
    } else {
        machines.write_names(out)?;
        let triangles = count(input.mesh.triangles().len() as u64);
        writeln!(out, "{}: {triangles} triangles.", quoted(&input.name))?;
        writeln!(out, "\n{}", table(&rows))?;
        writeln!(out, "{}", if same { "Each builder's trees are the same bytes." } else { "TREES DIFFER" })?;
    }
    Ok(if same { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Whether each builder made the same tree on all devices.
fn agree(rows: &[Row]) -> bool {
    rows.iter().all(|a| rows.iter().all(|b| a.builder != b.builder || a.digest == b.digest))
}

fn row(
    device: &Device,
    input: &Input,
    options: &BuildOptions,
    sets: &mut Option<Sets>,
) -> Result<Row, Error> {
    let mesh = &input.mesh;
    let built = measure::build(device, mesh, options)?;
    let scene = &built.scene;
    if sets.is_none() {
        *sets = Some(Sets::new(&input.name, mesh, |rays| scene.closest(rays))?);
    }
    let Sets { b: primary, c: diffuse, .. } = sets.as_ref().expect("made above");
    let rate = |rays| -> Result<f64, Error> {
        Ok(mrays(<[_]>::len(rays), measure::time(scene, Query::Closest, rays)?))
    };
    let (mrays_primary, mrays_diffuse) = (rate(primary)?, rate(diffuse)?);
    let (mut steps, mut tests) = (0, 0);
    for rays in [primary, diffuse] {
        for ray in scene.steps(rays)?.steps {
            steps += u64::from(ray.inner);
            tests += u64::from(ray.tests);
        }
    }
    let (header, report, triangles) = (scene.header(), built.report, mesh.triangles().len().max(1) as f64);
    let rays = (primary.len() + diffuse.len()) as f64;
    Ok(Row {
        builder: options.builder.name(),
        device: device.kind().name(),
        build_ms: ms(built.build),
        build_ms_per_million: ms(built.build) / triangles * 1e6,
        upload_ms: ms(built.upload),
        sah_cost: report.sah_cost,
        expected_steps: report.expected_steps,
        expected_tests: report.expected_tests,
        steps_per_ray: steps as f64 / rays,
        tests_per_ray: tests as f64 / rays,
        leaves: report.leaves,
        empty_leaves: report.empty_leaves,
        depth: header.depth,
        refs_per_triangle: f64::from(header.refs) / triangles,
        bytes_per_triangle: built.tree.size_in_bytes() as f64 / triangles,
        peak_bytes: scene.times().peak_bytes,
        mrays_primary,
        mrays_diffuse,
        digest: built.tree.digest(),
    })
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new([
        "Builder", "device", "build ms", "SAH", "steps", "tests", "leaves", "empty", "depth", "refs/tri",
        "B/tri", "peak", "primary", "diffuse", "digest",
    ]);
    for row in rows {
        table.row([
            row.builder.to_owned(),
            row.device.to_uppercase(),
            three(row.build_ms),
            three(row.sah_cost),
            three(row.steps_per_ray),
            three(row.tests_per_ray),
            count(row.leaves.into()),
            count(row.empty_leaves.into()),
            row.depth.to_string(),
            three(row.refs_per_triangle),
            three(row.bytes_per_triangle),
            bytes(row.peak_bytes),
            three(row.mrays_primary),
            three(row.mrays_diffuse),
            row.digest.chars().take(8).collect(),
        ]);
    }
    table
}

/// Teapots of a thousand to ten million triangles, as far as the device has room.
pub(super) fn scaling(
    machines: &Machines,
    (options, json): (&BuildOptions, bool),
    notes: &Notes,
    out: &mut StdoutLock<'_>,
) -> anyhow::Result<ExitCode> {
    let mut sizes: Vec<Size> = Vec::new();
    for device in machines.iter() {
        let mut last: Option<(f64, f64)> = None;
        for triangles in [1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000] {
            let mesh = Mesh::teapot(teapot_level_for(triangles));
            let number = mesh.triangles().len();
            notes.stage(format_args!("{} triangles on the {}", count(number as u64), capitals(device)));
            let options = options.clone().with_profile(false);
            let built = match measure::build(device, &mesh, &options) {
                Ok(built) => built,
                Err(error) if at_fault(&error) => {
                    notes.note(format_args!("{} triangles: {error}", count(number as u64)));
                    break;
                }
                Err(error) => return Err(error.into()),
            };
            let (n, time) = (number as f64, ms(built.build));
            sizes.push(Size {
                device: device.kind().name(),
                triangles: number,
                build_ms: time,
                build_ms_per_million: time / n * 1e6,
                peak_bytes: built.scene.times().peak_bytes,
                exponent: last.map(|(m, before)| (time / before).ln() / (n / m).ln()),
            });
            last = Some((n, time));
        }
    }
    notes.clear();
    if json {
        write_json(out, &sizes)?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut table = Table::new(["Triangles", "device", "build ms", "ms per million", "peak", "exponent"]);
    for size in &sizes {
        table.row([
            count(size.triangles as u64),
            size.device.to_uppercase(),
            three(size.build_ms),
            three(size.build_ms_per_million),
            bytes(size.peak_bytes),
            size.exponent.map_or_else(String::new, |e| format!("{e:.2}")),
        ]);
    }
    writeln!(out, "{table}\nTime grows as the exponent's power of the size; N log N is 1.05 to 1.1 here.")?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trees_of_one_builder_must_agree() {
        let row = |builder, digest: &str| Row { builder, digest: digest.to_owned(), ..Row::default() };
        assert!(agree(&[row("median", "a"), row("binned", "b"), row("median", "a")]));
        assert!(!agree(&[row("median", "a"), row("binned", "b"), row("median", "c")]));
    }
}
