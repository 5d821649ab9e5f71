//! Every dispatch of a job, with what it left in the buffers it may write.

use crate::{Failure, rays::rays, same};
use raykd::{
    BuildOptions, Device, Error, Mesh, Scene,
    exec::{Step, watch::watching},
    kernels::Access,
};
use std::{
    cell::RefCell,
    collections::hash_map::DefaultHasher,
    hash::{Hash as _, Hasher as _},
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

/// One dispatch: the kernel, and name, hash and (if asked for) words of the buffers it may write.
#[derive(Debug)]
struct Dispatch {
    kernel: &'static str,
    buffers: Vec<(&'static str, u64, Vec<u32>)>,
}

impl Job<'_> {
    fn run(&self, device: &Device) -> Result<(), Error> {
        let scene = Scene::build(device, self.mesh, self.options)?;
        let rays = rays(self.mesh, scene.tree()?.view(), 100, self.seed);
        scene.closest(&rays)?;
        scene.any(&rays)?;
        scene.steps(&rays)?;
        scene.brute(&rays)?;
        Ok(())
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
                        let words: Vec<u32> =
                            device.read(buffer, 0, buffer.bytes() as usize / 4).expect("buffers can be read");
                        let mut hasher = DefaultHasher::new();
                        words.hash(&mut hasher);
                        let keep = kept == Some(log.len());
                        buffers.push((slot.name, hasher.finish(), if keep { words } else { Vec::new() }));
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

    /// Compares two devices dispatch by dispatch. Each kernel finds the same buffers on both, or the one before
    /// it would have been reported: so the first that differs is the one at fault.
    ///
    /// # Errors
    /// They differ.
    pub fn compare(&self, expected: &Device, found: &Device) -> Result<(), Failure> {
        self.compare_meddled(expected, found, |_, _| {})
    }

    /// Compares with a device whose buffers `meddle` may change after each dispatch: a planted fault.
    ///
    /// # Errors
    /// They differ.
    pub fn compare_meddled(&self, expected: &Device, found: &Device, meddle: Meddle) -> Result<(), Failure> {
        let both = |kept| -> Result<_, Failure> {
            Ok((self.record(expected, |_, _| {}, kept)?, self.record(found, meddle, kept)?))
        };
        let (a, b) = both(None)?;
        let differ = |(a, b): (&Dispatch, &Dispatch)| a.kernel != b.kernel || a.buffers != b.buffers;
        let Some(number) = a.iter().zip(&b).position(differ) else {
            return same("number of dispatches", &[a.len()], &[b.len()]);
        };
        // Once more, to tell what differs.
        let (a, b) = both(Some(number))?;
        let (a, b) = (&a[number], &b[number]);
        if a.kernel != b.kernel {
            return Err(Failure(format!("dispatch {number} is {}, expected {}", b.kernel, a.kernel)));
        }
        for ((name, _, expected), (_, _, found)) in a.buffers.iter().zip(&b.buffers) {
            same(&format!("{name} of kernel {} (dispatch {number})", b.kernel), expected, found)?;
        }
        Err(Failure(format!("{} (dispatch {number}) differs from run to run", b.kernel)))
    }
}

/// Changes buffers of a step that has run.
pub type Meddle = fn(&Device, &Step<'_>);
