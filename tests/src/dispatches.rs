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
use std::{
    cell::{Cell, RefCell},
    rc::Rc,
};

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

/// One dispatch: the kernel, and name and hash of the buffers it may write.
#[derive(Debug, PartialEq, Eq)]
struct Dispatch {
    kernel: &'static str,
    buffers: Vec<(&'static str, u64)>,
}

/// The words of those buffers.
type Words = Vec<Vec<u32>>;

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
    fn run(&self, [device, by_doubles]: &[Device; 2]) -> Result<(), Error> {
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
                // The only one with kernels of its own for these.
                if traversal == Traversal::Wide {
                    scene.any(&rays)?;
                    scene.steps(&rays)?;
                }
            }
        }
        // Of many triangles by more kernels than of few.
        scene.traverse_by(Traversal::Wide)?;
        look_up(device, tree.view(), self.seed)?;
        exact_queries(device, self.seed)?;
        exact_queries(by_doubles, self.seed)?;
        number_rays(device, self.seed as u32 % 1000)
    }

    /// Runs on a device, one dispatch at a time, in buffers that start as garbage. After each, `meddle` may do
    /// something to its buffers; then `see` is given its number, what it was and what it left. Ends where `see` gives
    /// something back, which this gives back too.
    fn until<R: 'static>(
        &self,
        device: &Device,
        meddle: Meddle,
        mut see: impl FnMut(usize, Dispatch, Words) -> Option<R> + 'static,
    ) -> Result<Option<R>, Error> {
        let found = Rc::new(RefCell::new(None));
        let watcher = {
            let (found, mut number) = (Rc::clone(&found), 0);
            move |device: &Device, step: &Step<'_>| {
                meddle(device, step);
                let mut buffers = Vec::new();
                let mut left = Words::new();
                for (slot, &buffer) in step.kernel.slots.iter().zip(&step.buffers) {
                    if slot.access == Access::Write {
                        let words: Buffer<u32> = buffer.view();
                        let words = device.read(&words, 0, words.elements())?;
                        buffers.push((slot.name, hash(&words)));
                        left.push(words);
                    }
                }
                let seen = see(number, Dispatch { kernel: step.kernel.entry_point(), buffers }, left);
                number += 1;
                found.replace(seen);
                // An error ends the job.
                if found.borrow().is_none() { Ok(()) } else { Err(Error::Kernel("enough was seen")) }
            }
        };
        // A GPU is probed before it is watched.
        let both = [false, true].map(|doubles| device.with_doubles(doubles).expect("the GPU has doubles"));
        let done = watching(Box::new(watcher), || self.run(&both));
        found.take().map_or_else(|| done.map(|()| None), |found| Ok(Some(found)))
    }

    /// Runs on a device, for others to be compared with it.
    ///
    /// # Errors
    /// The device failed.
    pub fn record<'a>(&'a self, device: &'a Device) -> Result<Record<'a>, Error> {
        let dispatches = Rc::new(RefCell::new(Vec::new()));
        let log = Rc::clone(&dispatches);
        self.until(
            device,
            |_, _| {},
            move |_, dispatch, _| {
                log.borrow_mut().push(dispatch);
                None::<()>
            },
        )?;
        Ok(Record { job: self, device, dispatches: dispatches.take().into() })
    }

    /// Names of the kernels it runs, in order.
    ///
    /// # Errors
    /// The device failed.
    pub fn kernels(&self, device: &Device) -> Result<Vec<&'static str>, Error> {
        Ok(self.record(device)?.dispatches.iter().map(|dispatch| dispatch.kernel).collect())
    }

    /// Compares devices with the first one, dispatch by dispatch. Each kernel finds the same buffers on both, or
    /// the one before it would have been reported: so the first that differs is the one at fault.
    ///
    /// # Errors
    /// They differ.
    pub fn compare(&self, devices: &[&Device]) -> Result<(), Failure> {
        let record = self.record(devices[0])?;
        devices[1..].iter().try_for_each(|device| record.compare(device, |_, _| {}))
    }
}

/// What the dispatches of a job left on a device.
#[derive(Debug)]
pub struct Record<'a> {
    job: &'a Job<'a>,
    device: &'a Device,
    dispatches: Rc<[Dispatch]>,
}

impl Record<'_> {
    /// Runs the job on another device, up to the first dispatch that differs. `meddle` may change buffers after each
    /// dispatch: a planted fault.
    ///
    /// # Errors
    /// They differ.
    pub fn compare(&self, device: &Device, meddle: Meddle) -> Result<(), Failure> {
        let (expected, seen) = (Rc::clone(&self.dispatches), Rc::new(Cell::new(0)));
        let count = Rc::clone(&seen);
        let differs = self.job.until(device, meddle, move |number, dispatch, words| {
            count.set(number + 1);
            let differs = expected.get(number).is_some_and(|expected| *expected != dispatch);
            differs.then_some((number, dispatch, words))
        })?;
        match differs {
            Some((number, dispatch, words)) => {
                Err(Failure(format!("{}: {}", device.name(), self.tell(number, &dispatch, &words)?)))
            }
            None => same(device.name(), &[self.dispatches.len()], &[seen.get()]),
        }
    }

    /// Tells what differs in dispatch `number`: runs again up to it, for what it should have left.
    fn tell(&self, number: usize, found: &Dispatch, words: &[Vec<u32>]) -> Result<String, Error> {
        let expected = &self.dispatches[number];
        if found.kernel != expected.kernel {
            return Ok(format!("dispatch {number} is {}, expected {}", found.kernel, expected.kernel));
        }
        let right =
            self.job.until(self.device, |_, _| {}, move |at, _, words| (at == number).then_some(words))?;
        let right = right.expect("as many dispatches as before");
        let mut buffers = found.buffers.iter().zip(right.iter().zip(words));
        let first = buffers.find_map(|((name, _), (right, words))| same(name, right, words).err());
        let first = first.map_or("not the same from run to run".to_owned(), |e| e.to_string());
        Ok(format!("dispatch {number}, kernel {}, buffer {first}", found.kernel))
    }
}

/// Changes buffers of a step that has run.
pub type Meddle = fn(&Device, &Step<'_>);
