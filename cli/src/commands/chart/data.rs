//! What charts are drawn from: measured numbers, and how they are measured.

use crate::report::{capitals, count};
use crate::{
    args::ReadArgs,
    input::Input,
    machine::{Machines, at_fault, is_software},
    notes::Notes,
};
use anyhow::Context as _;
use raykd::{
    BuildOptions, Builder, Device, Error, Intersector, Mesh, Ray, Scene, Traversal,
    internals::{Moving, measure, teapot_level_for, usual_rays},
    plan::{CHOICES, Calibration, Choice, Cost},
    shared::Report,
    stress::{CASES, Method, Rule, Way},
};
use std::rc::Rc;

/// Prices of a reference beside those of [`CHOICES`]: how the size of trees is varied.
const PRICES: [f32; 4] = [0.0, 1.0, 15.0, 120.0];
/// A mesh whose build takes so long is the last one of the growing ones, in milliseconds.
const LONG: f64 = 3000.0;

/// How often all choices are measured in turn by `raykd calibrate --check`.
const ROUNDS: usize = 3;

/// One way to build and trace on one device.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    pub scene: String,
    /// `cpu` or `gpu`.
    pub device: &'static str,
    pub threads: usize,
    pub choice: Choice,
    pub cost: Cost,
    pub sah: f64,
    pub refs_per_triangle: f64,
}

impl Sample {
    pub(super) fn builder(&self) -> &'static str {
        self.choice.options().builder.name()
    }

    pub(super) fn bytes_per_triangle(&self) -> f64 {
        self.cost.bytes as f64 / f64::from(self.cost.triangles.max(1))
    }

    /// One for tests.
    #[cfg(test)]
    pub(super) fn example(choice: &str, build_ms: f64, ray_ns: f64) -> Self {
        let cost = serde_json::json!({
            "choice": choice,
            "triangles": 10,
            "upload_ms": 0.0,
            "build_ms": build_ms,
            "launch_ms": 0.0,
            "ray_ns": ray_ns,
            "worst_ns": ray_ns,
            "transfer_ns": 0.0,
            "bytes": 100,
            "spread": 1.0,
        });
        let cost: Cost = serde_json::from_value(cost).unwrap();
        let choice = Choice::named(choice).unwrap();
        Self {
            scene: "s".to_owned(),
            device: "cpu",
            threads: 0,
            choice,
            cost,
            sah: 1.0,
            refs_per_triangle: 1.0,
        }
    }
}

/// A triangle test and a way to find triangles.
#[derive(Clone, Debug)]
pub(super) struct Accuracy {
    pub method: String,
    pub test: Intersector,
    /// Of the stress scenes, on the CPU.
    pub rays: u64,
    pub failures: u64,
    /// Of these, in scenes where the method is known to fail.
    pub known: u64,
    /// Millions of usual rays a second in the first scene, by device.
    pub mrays: Vec<(&'static str, f64)>,
}

impl Accuracy {
    pub(super) fn per_million(&self) -> f64 {
        self.failures as f64 * 1e6 / self.rays.max(1) as f64
    }
}

/// The rays by which a mesh is measured, and what moving them takes.
#[derive(Clone, Debug)]
struct Rays {
    rays: Rc<[Ray]>,
    moving: Moving,
}

/// Of which scene rays are, how many triangles it has, how many rays, and on which device with how many threads.
type Key = (String, usize, usize, String);

/// All of it.
#[derive(Debug, Default)]
pub(super) struct Data {
    pub samples: Vec<Sample>,
    /// Teapots of growing size.
    pub sizes: Vec<Sample>,
    /// One teapot by growing numbers of threads.
    pub threads: Vec<Sample>,
    pub accuracy: Vec<Accuracy>,
    pub calibrations: Vec<Calibration>,
    /// Those that were used last.
    last_rays: Option<(Key, Rays)>,
}

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    pub quick: bool,
    /// Rays a sample; a device has its own number if 0.
    pub rays: usize,
}

impl Effort {
    pub(super) fn rays(self, device: &Device) -> usize {
        if self.rays > 0 { self.rays } else { raykd::internals::rays_for(device) }
    }
}

/// Something to measure, with its name.
type Job<'a> = (String, Box<dyn FnOnce(&mut Data) -> anyhow::Result<()> + 'a>);

fn job<'a>(what: String, work: impl FnOnce(&mut Data) -> anyhow::Result<()> + 'a) -> Job<'a> {
    (what, Box::new(work))
}

/// A scene of raykd, a mesh file, or a stress scene's first mesh.
pub(super) fn input(name: &str, notes: &Notes) -> anyhow::Result<Input> {
    let Some(case) = CASES.iter().find(|case| case.name == name) else {
        return Input::load(name.as_ref(), ReadArgs::default(), notes);
    };
    let trial = case.prepare(1)?;
    let mesh = trial.parts().first().context("a stress scene without parts")?.mesh.clone();
    Ok(Input { name: name.to_owned(), mesh, translation: [0.0; 3], load: std::time::Duration::ZERO })
}

impl Data {
    /// The rays for a mesh on a device: kept until others are asked for.
    fn rays(&mut self, name: &str, mesh: &Mesh, device: &Device, effort: Effort) -> Result<Rays, Error> {
        let key = (name.to_owned(), mesh.kept().len(), effort.rays(device), device.name().to_owned());
        if let Some((known, rays)) = &self.last_rays
            && *known == key
        {
            return Ok(rays.clone());
        }
        let scene = Scene::build(device, mesh, &BuildOptions::default())?;
        let rays: Rc<[Ray]> = usual_rays(mesh, key.2, |rays| scene.closest(rays))?.into();
        let rays = Rays { moving: Moving::measure(&scene, &rays)?, rays };
        self.last_rays = Some((key, rays.clone()));
        Ok(rays)
    }
}

/// Adds a sample. Of one that is there already each cost becomes the lower one.
fn keep(samples: &mut Vec<Sample>, sample: Sample) {
    let same =
        |s: &&mut Sample| (&s.scene, s.device, s.choice) == (&sample.scene, sample.device, sample.choice);
    match samples.iter_mut().find(same) {
        Some(known) => known.cost = sample.cost.or_less(&known.cost),
        None => samples.push(sample),
    }
}

/// Measures one choice.
fn sample(name: &str, mesh: &Mesh, device: &Device, choice: Choice, by: &Rays) -> Result<Sample, Error> {
    let (cost, scene) = measure(device, mesh, &choice, &by.rays, &by.moving)?;
    let tree = scene.tree()?;
    let Report { sah_cost, .. } = tree.validate()?;
    Ok(Sample {
        scene: name.to_owned(),
        device: device.kind().name(),
        threads: 0,
        choice,
        sah: sah_cost,
        refs_per_triangle: f64::from(tree.view().header.refs) / f64::from(cost.triangles.max(1)),
        cost,
    })
}

/// Every choice and some more prices, for each scene on each device.
pub(super) fn scenes<'a>(inputs: &'a [Input], machines: &'a Machines, effort: Effort) -> Vec<Job<'a>> {
    let mut choices = CHOICES.to_vec();
    for (builder, name) in [(Builder::Binned, "binned"), (Builder::Exact, "exact")] {
        choices.extend(PRICES.map(|price| Choice::of(name, builder, price)));
    }
    trees(inputs, machines, effort, &choices, 1)
}

/// Every choice that auto has. They take turns, so that what else the machine does for a while seldom slows a choice in
/// all rounds.
pub(super) fn choices<'a>(inputs: &'a [Input], machines: &'a Machines, effort: Effort) -> Vec<Job<'a>> {
    trees(inputs, machines, effort, CHOICES, ROUNDS)
}

fn trees<'a>(
    inputs: &'a [Input],
    machines: &'a Machines,
    effort: Effort,
    choices: &[Choice],
    rounds: usize,
) -> Vec<Job<'a>> {
    let mut jobs: Vec<Job<'a>> = Vec::new();
    for input in inputs {
        for device in machines.iter() {
            for &choice in (0..rounds).flat_map(|_| choices) {
                let options = choice.options();
                let what = format!("{}: {} at price {}", input.name, choice.name, options.price);
                jobs.push(job(what, move |data| {
                    let rays = data.rays(&input.name, &input.mesh, device, effort)?;
                    keep(&mut data.samples, sample(&input.name, &input.mesh, device, choice, &rays)?);
                    Ok(())
                }));
            }
        }
    }
    jobs
}

/// Growing teapots, and growing numbers of threads.
pub(super) fn growth<'a>(machines: &'a Machines, effort: Effort) -> Vec<Job<'a>> {
    let sizes: &[u32] = if effort.quick {
        &[1_000, 3_000, 10_000, 30_000]
    } else {
        &[1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000]
    };
    let usual = Choice::named("binned").expect("a choice");
    let mut jobs: Vec<Job<'a>> = Vec::new();
    for device in machines.iter() {
        for &size in sizes.iter().filter(|&&size| !is_software(device) || size <= 30_000) {
            jobs.push(job(format!("a teapot of {} triangles", count(size.into())), move |data| {
                let slow = |s: &Sample| s.device == device.kind().name() && s.cost.build_ms > LONG;
                if !data.sizes.iter().any(slow) {
                    let mesh = Mesh::teapot(teapot_level_for(size));
                    let rays = data.rays("teapots", &mesh, device, effort)?;
                    data.sizes.push(sample("teapots", &mesh, device, usual, &rays)?);
                }
                Ok(())
            }));
        }
    }
    if machines.cpu.is_some() {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        let mut counts: Vec<usize> = (0..).map(|i| 1 << i).take_while(|&n| n < all).collect();
        counts.push(all);
        for threads in counts {
            jobs.push(job(format!("{threads} threads"), move |data| {
                let device = Device::cpu_with_threads(threads)?;
                let mesh = Mesh::teapot(teapot_level_for(if effort.quick { 10_000 } else { 100_000 }));
                for choice in [usual, Choice::named("exact").expect("a choice")] {
                    let rays = data.rays("threads", &mesh, &device, effort)?;
                    let sample = sample("threads", &mesh, &device, choice, &rays)?;
                    data.threads.push(Sample { threads, ..sample });
                }
                Ok(())
            }));
        }
    }
    jobs
}

/// Every triangle test by stack and brute force, the exact one by every traversal.
pub(super) fn accuracy<'a>(input: &'a Input, machines: &'a Machines, effort: Effort) -> Vec<Job<'a>> {
    let fits = |method: &Method| match method.way {
        Way::Brute => true,
        Way::Tree(builder, _) => builder == Builder::Binned,
        _ => false,
    };
    let methods: Vec<Method> = Method::all().into_iter().filter(fits).collect();
    let mut jobs: Vec<Job<'a>> = Vec::new();
    for method in methods.clone() {
        let name = method.name();
        jobs.push(job(format!("{}: {name}", input.name), move |data| {
            let mut mrays = Vec::new();
            for device in machines.iter() {
                let Rays { rays, .. } = data.rays(&input.name, &input.mesh, device, effort)?;
                let mut scene = Scene::build(device, &input.mesh, &BuildOptions::default())?;
                if let Way::Tree(_, traversal) = method.way {
                    scene.traverse_by(traversal)?;
                } else {
                    scene.traverse_by(Traversal::Brute)?;
                }
                scene.intersect_by(method.test)?;
                mrays.push((device.kind().name(), raykd::internals::speed(&scene, &rays)?));
            }
            data.accuracy.push(Accuracy {
                method: name,
                test: method.test,
                rays: 0,
                failures: 0,
                known: 0,
                mrays,
            });
            Ok(())
        }));
    }
    for case in CASES {
        let methods = methods.clone();
        jobs.push(job(format!("stress scene {}", case.name), move |data| {
            let device = Device::cpu();
            let mut trial = case.prepare(if effort.quick { 60 } else { 1000 })?;
            // Rays that leave a triangle are for a query of their own.
            if trial.parts().iter().any(|part| matches!(part.rule, Rule::Leaves(_))) {
                return Ok(());
            }
            for method in methods.iter().filter(|method| method.way != Way::Except) {
                let Some(row) = data.accuracy.iter_mut().find(|row| row.method == method.name()) else {
                    continue;
                };
                match trial.run(method, &device, None) {
                    Ok(outcome) => {
                        row.rays += outcome.rays;
                        row.failures += outcome.failures;
                        row.known += if outcome.expected { outcome.failures } else { 0 };
                    }
                    // Said, not wrong.
                    Err(Error::Kernel(_)) => {}
                    Err(error) => return Err(error.into()),
                }
            }
            Ok(())
        }));
    }
    jobs
}

/// What choices cost on each device, from the cache if they are there.
pub(super) fn calibrations<'a>(machines: &'a Machines, effort: Effort) -> Vec<Job<'a>> {
    let costs = |device: &'a Device| {
        job(format!("costs on the {}", capitals(device)), move |data| {
            let cached = raykd::plan::cache_file(device).and_then(|path| Calibration::load(&path, device));
            let found = match cached {
                Ok(found) => found,
                Err(_) if effort.quick => Calibration::small(device)?,
                Err(_) => Calibration::measure(device, |_| ())?,
            };
            data.calibrations.push(found);
            Ok(())
        })
    };
    machines.iter().map(costs).collect()
}

/// Does the jobs, one after the other; what a device cannot do is left out, and said.
pub(super) fn run(jobs: Vec<Job<'_>>, notes: &Notes) -> anyhow::Result<Data> {
    let mut data = Data::default();
    notes.expect(jobs.len());
    for (what, work) in jobs {
        notes.stage(&what);
        if let Err(error) = work(&mut data) {
            match error.downcast_ref::<Error>() {
                Some(fault) if at_fault(fault) => notes.note(format_args!("{what}: {fault}; left out")),
                _ => return Err(error.context(what)),
            }
        }
        notes.step();
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_samples_of_one_choice_the_lower_costs_are_kept() {
        let mut samples = Vec::new();
        for (choice, build_ms, ray_ns) in [("exact", 5.0, 200.0), ("wide", 1.0, 900.0), ("exact", 7.0, 100.0)]
        {
            keep(&mut samples, Sample::example(choice, build_ms, ray_ns));
        }
        let costs: Vec<_> = samples.iter().map(|s| (s.choice.name, s.cost.build_ms, s.cost.ray_ns)).collect();
        assert_eq!(costs, [("exact", 5.0, 100.0), ("wide", 1.0, 900.0)]);
    }
}
