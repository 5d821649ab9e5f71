//! Rays on the device.

use super::{Scene, Traced};
use crate::{
    Error, Query,
    clock::Instant,
    exec::{Buffer, Device, OnDevice, Step},
    rays::AnyRay,
};
use raykd_kernels::{
    glam::{UVec4, Vec4},
    trace::{
        job::{JOB_WORDS, OUTCOME_INVALID, OUTCOME_STATUS, OUTCOME_WORDS},
        queries,
    },
};
use raykd_shared::{Hit, Ray, status};
use std::time::Duration;

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
    pub job: Buffer<u32>,
    pub rays: Buffer<Vec4>,
    pub hits: Buffer<UVec4>,
    pub outcome: Buffer<u32>,
    pub counts: Buffer<UVec4>,
}

impl Batch {
    pub(super) fn new(scene: &Scene, rays: &[impl AnyRay]) -> Result<Self, Error> {
        Self::with_room(scene, rays, 1)
    }

    /// With room for so many hits a ray. Rays come in the mesh's own coordinates; here they are moved.
    pub(super) fn with_room(scene: &Scene, rays: &[impl AnyRay], room: u32) -> Result<Self, Error> {
        Self::of_local(scene, &AnyRay::local(rays, scene.translation), room)
    }

    /// Of rays that are where the mesh is.
    pub(super) fn of_local(scene: &Scene, rays: &[Ray], room: u32) -> Result<Self, Error> {
        let device = &scene.device;
        Ok(Self {
            count: u32::try_from(rays.len()).unwrap_or(u32::MAX),
            job: device.alloc("job", u64::from(JOB_WORDS))?,
            rays: device.upload("rays", rays)?.view(),
            hits: device.alloc("hits", rays.len() as u64 * u64::from(room))?,
            outcome: device.alloc("outcome", u64::from(OUTCOME_WORDS))?,
            counts: device.alloc("steps", rays.len() as u64)?,
        })
    }

    /// What all queries of the tree bind.
    pub(super) fn query<'a>(&'a self, scene: &'a Scene) -> queries::Query<'a, OnDevice> {
        queries::Query {
            job: &self.job,
            header: &scene.header_buffer,
            pairs: &scene.nodes,
            corners: scene.leaf_triangles(),
            rays: &self.rays,
            hits: self.hits.out(),
            outcome: self.outcome.out(),
        }
    }

    /// Runs a query over the rays, and says how long it took.
    pub(super) fn run(&self, device: &Device, step: Step<'_>, query: Query) -> Result<Duration, Error> {
        self.begin(device, u32::from(query == Query::Any))?;
        Ok(device.dispatch(&[step], false)?.total)
    }

    /// Forgets what earlier kernels reported, and sets the words of the job: how many rays, and what is asked.
    pub(super) fn begin(&self, device: &Device, option: u32) -> Result<(), Error> {
        let job: [u32; JOB_WORDS as usize] = [self.count, 0, 0, option];
        device.write(&self.job, 0, &job)?;
        device.write(&self.outcome, 0, &[0; OUTCOME_WORDS as usize])
    }

    /// Checks the status the kernel left and returns how many rays were none.
    pub(super) fn outcome(&self, device: &Device) -> Result<u32, Error> {
        outcome(device, &self.outcome)
    }

    pub(super) fn hits(&self, device: &Device) -> Result<Vec<Hit>, Error> {
        device.read(&self.hits.view(), 0, self.count as usize)
    }

    /// Fetches hits, and adds how many rays were none and the time that takes to what is known of the trace.
    pub(super) fn finish(&self, device: &Device, hits: &mut [Hit], traced: Traced) -> Result<Traced, Error> {
        let start = Instant::now();
        let invalid = self.outcome(device)?;
        device.read_into(&self.hits.view(), 0, hits)?;
        Ok(Traced { invalid, download: start.elapsed(), ..traced })
    }
}

/// Checks the status a kernel left and returns how many rays were none.
pub(super) fn outcome(device: &Device, outcome: &Buffer<u32>) -> Result<u32, Error> {
    let words = device.read(outcome, 0, OUTCOME_WORDS as usize)?;
    match words[OUTCOME_STATUS as usize] {
        0 => Ok(words[OUTCOME_INVALID as usize]),
        bits => Err(Error::Kernel(status::describe(bits))),
    }
}
