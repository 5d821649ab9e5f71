//! Rays on the device.

use super::{Query, Scene, Traced};
use crate::{
    Error,
    exec::{Buffer, Device, Step},
    rays::AnyRay,
};
use raykd_kernels::{
    Kernel,
    trace::job::{JOB_WORDS, OUTCOME_INVALID, OUTCOME_STATUS, OUTCOME_WORDS},
};
use raykd_shared::{Hit, status};
use std::time::{Duration, Instant};

impl Scene {
    /// Puts rays on the device, to trace them as often as one likes.
    ///
    /// # Errors
    /// They do not fit the device, or it failed.
    pub fn resident(&self, rays: &[impl AnyRay]) -> Result<Resident, Error> {
        Ok(Resident { scene: self.clone(), batch: Batch::new(self, rays)? })
    }
}

/// Rays that stay on the device, with room for their hits.
///
/// One trace at a time: it writes the hits of the one before.
///
/// ```compile_fail
/// fn twice(resident: raykd::Resident) {
///     std::thread::scope(|scope| {
///         scope.spawn(|| resident.trace(raykd::Query::Closest));
///         scope.spawn(|| resident.trace(raykd::Query::Any));
///     });
/// }
/// ```
#[derive(Debug)]
pub struct Resident {
    scene: Scene,
    batch: Batch,
}

impl Resident {
    /// Traces all rays once and says how long the kernel took.
    ///
    /// # Errors
    /// The device failed.
    pub fn trace(&mut self, query: Query) -> Result<Duration, Error> {
        self.scene.run(&self.batch, self.scene.traversal, query)
    }

    /// The hits of the last trace.
    ///
    /// # Errors
    /// The device failed.
    pub fn hits(&self) -> Result<Vec<Hit>, Error> {
        self.batch.outcome(&self.scene.device)?;
        self.batch.hits(&self.scene.device)
    }

    /// How many rays of the last trace were none, see [`Traced::invalid`].
    ///
    /// # Errors
    /// The device failed.
    pub fn invalid(&self) -> Result<u32, Error> {
        self.batch.outcome(&self.scene.device)
    }
}

/// Buffers of one dispatch of rays.
#[derive(Debug)]
pub(super) struct Batch {
    pub count: u32,
    pub job: Buffer,
    pub rays: Buffer,
    pub hits: Buffer,
    pub outcome: Buffer,
    pub counts: Buffer,
}

impl Batch {
    pub(super) fn new(scene: &Scene, rays: &[impl AnyRay]) -> Result<Self, Error> {
        Self::with_room(scene, rays, 1)
    }

    /// With room for so many hits a ray. Rays come in the mesh's own coordinates; here they are moved.
    pub(super) fn with_room(scene: &Scene, rays: &[impl AnyRay], room: u32) -> Result<Self, Error> {
        let (device, rays) = (&scene.device, &*AnyRay::local(rays, scene.translation));
        let batch = Self {
            count: u32::try_from(rays.len()).unwrap_or(u32::MAX),
            job: device.alloc("job", u64::from(JOB_WORDS) * 4)?,
            rays: device.alloc("rays", size_of_val(rays) as u64)?,
            hits: device.alloc("hits", rays.len() as u64 * 16 * u64::from(room))?,
            outcome: device.alloc("outcome", u64::from(OUTCOME_WORDS) * 4)?,
            counts: device.alloc("steps", rays.len() as u64 * 16)?,
        };
        device.write(&batch.rays, 0, bytemuck::cast_slice(rays))?;
        Ok(batch)
    }

    pub(super) fn buffers<'a>(&'a self, scene: &'a Scene) -> Vec<&'a Buffer> {
        vec![
            &self.job,
            &scene.header_buffer,
            &scene.nodes,
            scene.leaf_triangles(),
            &self.rays,
            &self.hits,
            &self.outcome,
        ]
    }

    /// Runs the kernel of a query over the rays, and says how long it took.
    pub(super) fn ask(
        &self,
        device: &Device,
        kernel: &'static Kernel,
        buffers: Vec<&Buffer>,
        query: Query,
    ) -> Result<Duration, Error> {
        self.begin(device, u32::from(query == Query::Any))?;
        Ok(device.dispatch(&[Step::over(kernel, self.count, buffers)], false)?.total)
    }

    /// Forgets what earlier kernels reported, and sets the words of the job: how many rays, and what is asked.
    pub(super) fn begin(&self, device: &Device, option: u32) -> Result<(), Error> {
        let job: [u32; JOB_WORDS as usize] = [self.count, 0, 0, option];
        device.write(&self.job, 0, bytemuck::cast_slice(&job))?;
        device.write(&self.outcome, 0, &[0; OUTCOME_WORDS as usize * 4])
    }

    /// Checks the status the kernel left and returns how many rays were none.
    pub(super) fn outcome(&self, device: &Device) -> Result<u32, Error> {
        outcome(device, &self.outcome)
    }

    pub(super) fn hits(&self, device: &Device) -> Result<Vec<Hit>, Error> {
        device.read(&self.hits, 0, self.count as usize)
    }

    /// Adds hits and how many rays were none, and the time to fetch them.
    pub(super) fn finish(&self, device: &Device, traced: &mut Traced) -> Result<(), Error> {
        let start = Instant::now();
        traced.invalid += self.outcome(device)?;
        traced.hits.extend(self.hits(device)?);
        traced.download += start.elapsed();
        Ok(())
    }
}

/// Checks the status a kernel left and returns how many rays were none.
pub(super) fn outcome(device: &Device, outcome: &Buffer) -> Result<u32, Error> {
    let words: Vec<u32> = device.read(outcome, 0, OUTCOME_WORDS as usize)?;
    match words[OUTCOME_STATUS as usize] {
        0 => Ok(words[OUTCOME_INVALID as usize]),
        bits => Err(Error::Kernel(status::describe(bits))),
    }
}
