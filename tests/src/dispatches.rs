//! Every dispatch of a job, with what it left in the buffers it may write.

use crate::{Failure, built_from, rays::rays, same};
use raykd::{
    BuildOptions, Builder, Device, Error, Intersector, Mesh, Query, Ray, Scene, Traversal,
    internals::{
        Buffer, Launch as _, Step,
        kernels::{
            Access,
            trace::{job::OUTCOME_WORDS, locate, prepare::workgroups},
        },
        watch::watching,
    },
    rays::Random,
    shared::TreeView,
};
use std::{cell::RefCell, rc::Rc};

/// What is run: everything raykd does with a mesh and rays.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// How its tree is built.
    pub options: &'a BuildOptions,
    /// What the rays come from.
    pub seed: u64,
}

/// One dispatch: the kernel, and name, hash and (if asked for) words of the buffers it may write.
#[derive(Debug)]
struct Dispatch {
    kernel: &'static str,
    buffers: Vec<(&'static str, u64, Vec<u32>)>,
}

/// A hash that is quick for many words. A step takes different sums to different sums, so one word that differs is
/// always seen.
fn hash(words: &[u32]) -> u64 {
    let step = |sum: u64, word: u64| (sum ^ word).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29);
    let mut sums = [1, 2, 3, 4];
    for four in words.chunks(4) {
        for (sum, &word) in sums.iter_mut().zip(four) {
            *sum = step(*sum, word.into());
        }
    }
    sums.into_iter().fold(words.len() as u64, step)
}

/// One of the kernels that only encoders of wgpu programs use.
fn number_rays(device: &Device, rays: u32) -> Result<(), Error> {
    let (count, job) = (device.upload("count", &[rays])?, device.upload("job", &[500, 0, 0, 0])?);
    let args = device.upload("workgroups", &[0; 3])?;
    let step = workgroups::Buffers { count: &count, job: job.out(), args: args.out() }.over(1);
    // SAFETY: the kernel writes the first word of the job and the three arguments.
    unsafe { device.run(&[step], false) }?;
    Ok(())
}

/// All queries by the exact test, of a mesh in which no ray goes so many rounds that llvmpipe cuts them short.
fn exact_queries(device: &Device, seed: u64) -> Result<(), Error> {
    let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mesh = Mesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).expect("a tetrahedron");
    let leaf = BuildOptions::default().with_max_depth(0);
    let mut scene = Scene::build(device, &mesh, &leaf)?;
    scene.intersect_by(Intersector::Exact)?;
    let mut random = Random::new(seed);
    // One of them through a vertex, which floats do not decide.
    let mut rays = vec![Ray::new([2.0, 0.0, 0.0], [-1.0, 0.0, 0.0])];
    rays.extend((0..20).map(|_| Ray::new(random.point().map(|x| 2.0 * x), random.point())));
    // So few lie apart.
    scene.closest(&rays)?;
    scene.any(&rays)?;
    scene.all(&rays, 3)?;
    scene.steps(&rays)?;
    scene.trace_except(Query::Closest, &rays, &vec![0; rays.len()])?;
    scene.crossings(&rays)?;
    Ok(())
}

/// Looks points up in a tree. An empty leaf may name any place, so that is what is found there.
fn look_up(device: &Device, tree: TreeView<'_>, seed: u64) -> Result<(), Error> {
    let (lo, hi, scale) = (tree.header.lo, tree.header.hi, tree.header.scale);
    let mut random = Random::new(seed);
    let mut place = || [0, 1, 2].map(|i| (lo[i] + 1.2 * (hi[i] - lo[i]) * random.unit() as f32) / scale);
    let mut points: Vec<[f32; 3]> = (0..150).map(|_| place()).collect();
    points.push([f32::NAN; 3]);
    let found = device.upload("found", &vec![0; points.len()])?;
    let outcome = device.upload("outcome", &[0; OUTCOME_WORDS as usize])?;
    let step = locate::Buffers {
        job: &device.upload("job", &[points.len() as u32, 0, 0, 0])?,
        header: &device.upload("header", &[*tree.header])?,
        regions: &device.upload("regions", tree.nodes)?.view(),
        points: &device.upload("points", &points)?.view(),
        found: found.out(),
        outcome: outcome.out(),
    };
    // SAFETY: the kernel writes a word a point, and of the outcome.
    unsafe { device.run(&[step.over(points.len() as u32)], false) }?;
    Ok(())
}

impl Job<'_> {
    fn run(&self, device: &Device) -> Result<(), Error> {
        // As if the mesh lay on the device. A leaf is enough: the builders follow.
        let leaf = self.options.clone().with_max_depth(0);
        built_from(device, self.mesh.positions(), self.mesh.triangles(), &leaf)?;
        let mut scene = match self.options.builder {
            // The CPU's own way has no kernels.
            Builder::Exact => Scene::sweep_by_kernels(device, self.mesh, self.options, 5)?,
            _ => Scene::build(device, self.mesh, self.options)?,
        };
        let tree = scene.tree()?;
        if tree.validate().is_err() {
            // What went wrong is on record.
            return Ok(());
        }
        if self.options.builder != Builder::Exact {
            // Two meshes, of which the second is what a device expects that has built the first.
            let expecting = device.expecting();
            for _ in 0..2 {
                built_from(&expecting, self.mesh.positions(), self.mesh.triangles(), self.options)?;
            }
        }
        let rays = rays(self.mesh, tree.view(), 100, self.seed);
        // So few as the first lie apart.
        for rays in [&rays[..10], &rays] {
            scene.closest(rays)?;
            scene.any(rays)?;
        }
        scene.steps(&rays)?;
        let triangles = self.mesh.triangles().len();
        let own: Vec<u32> = (0..rays.len()).map(|i| (i % triangles) as u32).collect();
        for query in [Query::Closest, Query::Any] {
            scene.trace_except(query, &rays, &own)?;
        }
        // In larger meshes these go so many rounds that llvmpipe may cut them short, and so do rays along edges by
        // `exact`.
        let small = triangles <= 64;
        // And all but the usual test where a leaf of a lattice may hold thousands.
        let large = triangles > 1000;
        let (lo, hi) = self.mesh.bounds();
        let size = (0..3).map(|i| hi[i] - lo[i]).fold(f32::MIN_POSITIVE, f32::max);
        let mut random = Random::new(self.seed);
        let mut easy = || {
            let to = [0, 1, 2].map(|i| lo[i] + (hi[i] - lo[i]) * random.unit() as f32);
            let from = random.near(hi, size);
            Ray::new(from, [0, 1, 2].map(|i| to[i] - from[i]))
        };
        let easy: Vec<Ray> = (0..rays.len()).map(|_| easy()).collect();
        for &intersector in Intersector::ALL {
            let rays = match intersector {
                Intersector::Exact if small => &easy,
                Intersector::Exact => continue,
                Intersector::Strict => &rays,
                _ if large => continue,
                _ => &rays,
            };
            scene.intersect_by(intersector)?;
            scene.closest(rays)?;
            scene.any(rays)?;
            scene.brute(rays)?;
        }
        scene.intersect_by(Intersector::Strict)?;
        if small {
            scene.all(&rays, 3)?;
            for &traversal in Traversal::ALL {
                scene.traverse_by(traversal)?;
                scene.closest(&rays)?;
            }
        }
        look_up(device, tree.view(), self.seed)?;
        exact_queries(device, self.seed)?;
        number_rays(device, self.seed as u32 % 1000)
    }

    /// Runs on a device, one dispatch at a time, in buffers that start as garbage. After each, `meddle` may do
    /// something to its buffers. Only dispatch `kept` keeps its words.
    fn record(&self, device: &Device, meddle: Meddle, kept: Option<usize>) -> Result<Vec<Dispatch>, Error> {
        let log = Rc::new(RefCell::new(Vec::new()));
        let watcher = {
            let log = Rc::clone(&log);
            move |device: &Device, step: &Step<'_>| {
                meddle(device, step);
                let mut log = log.borrow_mut();
                let mut buffers = Vec::new();
                for (slot, &buffer) in step.kernel.slots.iter().zip(&step.buffers) {
                    if slot.access == Access::Write {
                        let words: Buffer<u32> = buffer.view();
                        let words = device.read(&words, 0, words.elements()).expect("buffers can be read");
                        let hash = hash(&words);
                        let keep = kept == Some(log.len());
                        buffers.push((slot.name, hash, if keep { words } else { Vec::new() }));
                    }
                }
                log.push(Dispatch { kernel: step.kernel.name(), buffers });
            }
        };
        watching(Box::new(watcher), || self.run(device))?;
        Ok(log.take())
    }

    /// Names of the kernels it runs, in order.
    ///
    /// # Errors
    /// The device failed.
    pub fn kernels(&self, device: &Device) -> Result<Vec<&'static str>, Error> {
        Ok(self.record(device, |_, _| {}, None)?.iter().map(|dispatch| dispatch.kernel).collect())
    }

    /// Compares devices with the first one, dispatch by dispatch. Each kernel finds the same buffers on both, or
    /// the one before it would have been reported: so the first that differs is the one at fault.
    ///
    /// # Errors
    /// They differ.
    pub fn compare(&self, devices: &[&Device]) -> Result<(), Failure> {
        self.compare_meddled(devices, |_, _| {})
    }

    /// Compares with devices whose buffers `meddle` may change after each dispatch: a planted fault.
    ///
    /// # Errors
    /// They differ.
    pub fn compare_meddled(&self, devices: &[&Device], meddle: Meddle) -> Result<(), Failure> {
        let a = self.record(devices[0], |_, _| {}, None)?;
        for device in &devices[1..] {
            let b = self.record(device, meddle, None)?;
            let differ = |(a, b): (&Dispatch, &Dispatch)| a.kernel != b.kernel || a.buffers != b.buffers;
            if let Some(number) = a.iter().zip(&b).position(differ) {
                return Err(Failure(format!(
                    "{}: {}",
                    device.name(),
                    self.tell(devices[0], device, meddle, number)?
                )));
            }
            same(device.name(), &[a.len()], &[b.len()])?;
        }
        Ok(())
    }

    /// Runs again to tell what differs in dispatch `number`.
    fn tell(&self, a: &Device, b: &Device, meddle: Meddle, number: usize) -> Result<String, Error> {
        let a = &self.record(a, |_, _| {}, Some(number))?[number];
        let b = &self.record(b, meddle, Some(number))?[number];
        if a.kernel != b.kernel {
            return Ok(format!("dispatch {number} is {}, expected {}", b.kernel, a.kernel));
        }
        let mut buffers = a.buffers.iter().zip(&b.buffers);
        let first = buffers.find_map(|((name, _, a), (_, _, b))| same(name, a, b).err());
        let first = first.map_or("not the same from run to run".to_owned(), |e| e.to_string());
        Ok(format!("dispatch {number}, kernel {}, buffer {first}", b.kernel))
    }
}

/// Changes buffers of a step that has run.
pub type Meddle = fn(&Device, &Step<'_>);
