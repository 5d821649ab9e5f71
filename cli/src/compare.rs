//! `raykd trace --compare`: every traversal on every device, in one table.

use crate::{
    input::Input,
    machine::Machines,
    measure::{self, mrays},
    notes::Notes,
    ray_file::Rays,
    report::{Table, bytes, count, three, write_json},
};
use raykd::{
    BuildOptions, Device, Error, Query, Ray, RaySteps, Scene, Stepped, Traversal,
    internals::{digest_of, quoted},
    rays,
};
use std::{
    io::{StdoutLock, Write as _},
    process::ExitCode,
};

/// Width and height of the picture whose rays are traced.
const PICTURE: u32 = 1024;
/// Of bounces and shadows.
const SEED: u64 = 2026;

/// One traversal on one device.
#[derive(Clone, Debug, Default, serde::Serialize)]
struct Row {
    traversal: &'static str,
    device: &'static str,
    mrays_primary: f64,
    mrays_diffuse: f64,
    mrays_shadow: f64,
    /// Inner nodes passed by a primary ray that enters the scene's box.
    steps_mean: f64,
    steps_p50: u32,
    steps_p99: u32,
    steps_max: u32,
    leaves_p50: u32,
    tests_p50: u32,
    /// Restarts, climbs or ropes followed, mean of a primary ray.
    restarts: f64,
    /// What a ray keeps between two leaves.
    state_bytes: u32,
    /// Nodes, references, and what the traversal needs beside them.
    tree_bytes: u64,
    /// Of the closest hits of primary and diffuse rays, and whether shadow rays hit.
    hits_digest: String,
}

/// The rays that are traced.
struct Sets {
    primary: Vec<Ray>,
    diffuse: Vec<Ray>,
    shadow: Vec<Ray>,
}

/// How traversals are compared.
#[derive(Debug)]
pub(super) struct How {
    pub options: BuildOptions,
    /// Brute force too.
    pub brute: bool,
    pub json: bool,
}

/// All traversals on all devices, of the rays given or a picture's.
pub(super) fn run(
    input: &Input,
    given: Option<&Rays>,
    machines: &Machines,
    how: &How,
    notes: &Notes,
    out: &mut StdoutLock<'_>,
) -> anyhow::Result<ExitCode> {
    let given = given.map(|rays| rays.local(input.translation));
    let given = given.as_deref();
    let mut sets = None;
    let mut rows = Vec::new();
    for device in machines.iter() {
        let done = compare(device, input, how, given, &mut sets, notes);
        rows.extend(machines.spared(device, done, "with the CPU alone", notes)?.into_iter().flatten());
    }
    notes.clear();
    let same = agree(&rows);
    if how.json {
        write_json(out, &rows)?;
    } else {
        machines.write_names(out)?;
        if let Some(sets) = &sets {
            let [primary, diffuse, shadow] =
                [&sets.primary, &sets.diffuse, &sets.shadow].map(|set| count(set.len() as u64));
            writeln!(
                out,
                "{}: {primary} primary, {diffuse} diffuse, {shadow} shadow rays",
                quoted(&input.name)
            )?;
        }
        writeln!(
            out,
            "Steps, leaves and tests are those of primary rays that enter the scene's box.\n\n{}",
            table(&rows)
        )?;
        writeln!(out, "{}", if same { "All hits are the same bytes." } else { "HITS DIFFER" })?;
    }
    Ok(if same { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Whether all found the same.
fn agree(rows: &[Row]) -> bool {
    rows.windows(2).all(|pair| pair[0].hits_digest == pair[1].hits_digest)
}

/// All traversals on one device. The first device makes the rays.
fn compare(
    device: &Device,
    input: &Input,
    how: &How,
    given: Option<&[Ray]>,
    sets: &mut Option<Sets>,
    notes: &Notes,
) -> Result<Vec<Row>, Error> {
    let mesh = &input.mesh;
    notes.stage_on(&input.name, "building", device);
    let mut scene = Scene::build(device, mesh, &how.options)?;
    if sets.is_none() {
        let camera = || rays::Camera::framing(mesh.bounds()).rays(PICTURE, PICTURE);
        let primary = given.map_or_else(camera, <[Ray]>::to_vec);
        let hits = scene.closest(&primary)?;
        let (light, radius) = rays::light(mesh.bounds());
        let diffuse = rays::bounces(mesh, &primary, &hits, SEED);
        let shadow = rays::shadows(mesh, &primary, &hits, light, radius, SEED);
        *sets = Some(Sets { primary, diffuse, shadow });
    }
    let sets = sets.as_ref().expect("made above");
    let traversals = Traversal::ALL.iter().copied().filter(|&way| how.brute || way != Traversal::Brute);
    traversals
        .map(|traversal| {
            notes.stage_on(&input.name, traversal, device);
            row(&mut scene, traversal, sets)
        })
        .collect()
}

fn row(scene: &mut Scene, traversal: Traversal, sets: &Sets) -> Result<Row, Error> {
    scene.traverse_by(traversal)?;
    let Stepped { hits: primary, mut steps, .. } = scene.steps(&sets.primary)?;
    // Rays that pass the scene by cost nothing and say nothing.
    steps.retain(|s| s.inner + s.leaves + s.tests > 0);
    let diffuse = scene.closest(&sets.diffuse)?;
    let shadow = scene.any(&sets.shadow)?;
    let mut found: Vec<u8> = bytemuck::cast_slice(&primary).to_vec();
    found.extend_from_slice(bytemuck::cast_slice(&diffuse));
    found.extend(shadow.iter().map(|hit| u8::from(hit.is_hit())));
    let rate = |query, rays: &[Ray]| measure::time(scene, query, rays).map(|time| mrays(rays.len(), time));
    let [steps_p50, steps_p99, steps_max] = percentiles(&steps, |s| s.inner);
    let mean = |of: fn(&RaySteps) -> u32| {
        steps.iter().map(|s| f64::from(of(s))).sum::<f64>() / steps.len().max(1) as f64
    };
    Ok(Row {
        traversal: traversal.name(),
        device: scene.device().kind().name(),
        mrays_primary: rate(Query::Closest, &sets.primary)?,
        mrays_diffuse: rate(Query::Closest, &sets.diffuse)?,
        mrays_shadow: rate(Query::Any, &sets.shadow)?,
        steps_mean: mean(|s| s.inner),
        steps_p50,
        steps_p99,
        steps_max,
        leaves_p50: percentiles(&steps, |s| s.leaves)[0],
        tests_p50: percentiles(&steps, |s| s.tests)[0],
        restarts: mean(|s| s.turns),
        state_bytes: traversal.state_bytes(),
        tree_bytes: scene.tree_bytes(),
        hits_digest: digest_of(&found),
    })
}

/// The middle value, the one that a hundredth is above, and the largest.
fn percentiles(steps: &[RaySteps], pick: impl Fn(&RaySteps) -> u32) -> [u32; 3] {
    let mut values: Vec<u32> = steps.iter().map(pick).collect();
    values.sort_unstable();
    let at = |share: usize| values.get(values.len().saturating_sub(1) * share / 100).copied().unwrap_or(0);
    [at(50), at(99), at(100)]
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new([
        "Traversal",
        "device",
        "primary",
        "diffuse",
        "shadow",
        "steps",
        "p50",
        "p99",
        "max",
        "leaves",
        "tests",
        "restarts",
        "state",
        "tree",
    ]);
    for row in rows {
        table.row([
            row.traversal.to_owned(),
            row.device.to_uppercase(),
            three(row.mrays_primary),
            three(row.mrays_diffuse),
            three(row.mrays_shadow),
            three(row.steps_mean),
            row.steps_p50.to_string(),
            row.steps_p99.to_string(),
            row.steps_max.to_string(),
            row.leaves_p50.to_string(),
            row.tests_p50.to_string(),
            three(row.restarts),
            bytes(row.state_bytes.into()),
            bytes(row.tree_bytes),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_other_digest_is_a_difference() {
        let mut rows = vec![Row { hits_digest: "a".to_owned(), ..Row::default() }; 3];
        assert!(agree(&rows));
        rows[1].hits_digest = "b".to_owned();
        assert!(!agree(&rows));
        assert!(agree(&[]));
    }

    #[test]
    fn percentiles_of_few_and_many() {
        let steps = |values: &[u32]| -> Vec<RaySteps> {
            values.iter().map(|&inner| RaySteps { inner, ..RaySteps::default() }).collect()
        };
        assert_eq!(percentiles(&[], |s| s.inner), [0; 3]);
        assert_eq!(percentiles(&steps(&[7]), |s| s.inner), [7; 3]);
        let many: Vec<u32> = (0..=1000).rev().collect();
        assert_eq!(percentiles(&steps(&many), |s| s.inner), [500, 990, 1000]);
    }
}
