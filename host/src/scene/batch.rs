//! Rays on the device.

use super::Scene;
use crate::{
    Error, Query, Traversal,
    exec::{Back, Buffer, Device, OnDevice, Step, Timed, To},
    rays::AnyRay,
};
use raykd_kernels::{
    glam::{UVec4, Vec4},
    trace::{
        job::{JOB_WORDS, OUTCOME_INVALID, OUTCOME_STATUS, OUTCOME_WORDS},
        queries,
    },
};
use raykd_shared::{Hit, Ray};
use std::time::Duration;

impl Scene {
    /// Puts rays on the device, to trace them as often as one likes.
    ///
    /// # Errors
    /// They do not fit the device, or it failed.
    pub fn resident(&self, rays: &[impl AnyRay]) -> Result<ResidentRays, Error> {
        // These may be many at a time: memory of small batches is kept for ever.
        let device = self.device.keeping_nothing();
        let batch = Batch::of_local(&device, &AnyRay::local(rays, self.translation), 1)?;
        Ok(ResidentRays { scene: self.clone(), batch, invalid: None })
    }
}

/// Rays that stay on the device, with room for their hits.
///
/// One trace at a time: it writes the hits of the one before.
///
/// ```compile_fail
/// fn twice(resident: raykd::ResidentRays) {
///     std::thread::scope(|scope| {
///         scope.spawn(|| resident.trace(raykd::Query::Closest));
///         scope.spawn(|| resident.trace(raykd::Query::Any));
///     });
/// }
/// ```
#[derive(Debug)]
pub struct ResidentRays {
    scene: Scene,
    batch: Batch,
    /// How many rays were invalid, once they have been traced: the buffers hold no hits before.
    invalid: Option<u32>,
}

impl ResidentRays {
    /// Traces all rays once and says how long the kernel took.
    ///
    /// # Errors
    /// The device failed.
    pub fn trace(&mut self, query: Query) -> Result<Duration, Error> {
        // A trace that fails leaves some hits of this one and some of the one before.
        self.invalid = None;
        let (time, invalid) = self.scene.run(&self.batch, self.scene.traversal, query, To::Room(&mut []))?;
        self.invalid = Some(invalid);
        Ok(time)
    }

    /// The hits of the last trace.
    ///
    /// # Errors
    /// There was none, or it failed; or the device failed.
    pub fn hits(&self) -> Result<Vec<Hit>, Error> {
        self.invalid()?;
        self.batch.hits(&self.scene.device)
    }

    /// How many rays of the last trace were invalid, see [`Traced::invalid`](super::Traced::invalid).
    ///
    /// # Errors
    /// There was none, or it failed.
    pub fn invalid(&self) -> Result<u64, Error> {
        self.invalid.map(u64::from).ok_or(Error::Untraced)
    }
}

/// What kernels over some rays or points are told, and what they tell beside their answers.
#[derive(Debug)]
pub(super) struct Job {
    pub count: u32,
    /// The logarithm of how far apart the lanes that take them are.
    apart: u32,
    /// What is timed of what is run.
    pub timed: Timed,
    pub record: Buffer<u32>,
    pub outcome: Buffer<u32>,
}

impl Job {
    /// Of neighbouring lanes.
    pub(super) fn new(device: &Device, count: u32) -> Result<Self, Error> {
        Ok(Self {
            count,
            apart: 0,
            timed: Timed::Whole,
            record: device.room("job", u64::from(JOB_WORDS))?,
            outcome: device.room("outcome", u64::from(OUTCOME_WORDS))?,
        })
    }

    /// Runs kernels, `option` telling what is asked, and fetches what is wanted. Says how long the kernels took, and
    /// how many rays or points were invalid.
    pub(super) fn run(
        &self,
        device: &Device,
        steps: &[Step<'_>],
        option: u32,
        wanted: Vec<Back<'_>>,
    ) -> Result<(Duration, u32), Error> {
        let record: [u32; JOB_WORDS as usize] = [self.count, self.apart, 0, option];
        device.write(&self.record, 0, &record)?;
        device.write(&self.outcome, 0, &[0; OUTCOME_WORDS as usize])?;
        let mut words = [0; OUTCOME_WORDS as usize];
        let mut back = vec![self.outcome.back(To::Room(&mut words))];
        back.extend(wanted);
        let time = device.dispatch_then(steps, self.timed, &mut back)?.total;
        drop(back);
        Ok((time, invalid(words)?))
    }
}

/// Buffers of one dispatch of rays.
#[derive(Debug)]
pub(super) struct Batch {
    pub job: Job,
    pub rays: Buffer<Vec4>,
    pub hits: Buffer<UVec4>,
    pub counts: Buffer<UVec4>,
}

impl Batch {
    pub(super) fn new(scene: &Scene, rays: &[impl AnyRay]) -> Result<Self, Error> {
        Self::with_room(scene, rays, 1)
    }

    /// With room for so many hits a ray. Rays come in the mesh's own coordinates; here they are moved.
    pub(super) fn with_room(scene: &Scene, rays: &[impl AnyRay], room: u32) -> Result<Self, Error> {
        let device = scene.device.for_rays(rays.len().saturating_mul(room.max(1) as usize));
        Self::of_local(&device, &AnyRay::local(rays, scene.translation), room)
    }

    /// Of rays as the mesh's positions are, in memory of `device`.
    pub(super) fn of_local(device: &Device, rays: &[Ray], room: u32) -> Result<Self, Error> {
        let count = u32::try_from(rays.len()).unwrap_or(u32::MAX);
        Ok(Self {
            job: Job { apart: apart(count, device.spare_lanes()), ..Job::new(device, count)? },
            rays: device.put("rays", rays)?.view(),
            hits: device.room("hits", rays.len() as u64 * u64::from(room))?,
            counts: device.room("steps", rays.len() as u64)?,
        })
    }

    /// How many lanes walk through the tree.
    pub(super) const fn lanes(&self) -> u32 {
        self.job.count << self.job.apart
    }

    /// What all queries of the tree bind.
    pub(super) fn query<'a>(&'a self, scene: &'a Scene) -> queries::Query<'a, OnDevice> {
        queries::Query {
            job: &self.job.record,
            header: &scene.header_buffer,
            pairs: &scene.nodes,
            corners: scene.leaf_triangles(),
            rays: &self.rays,
            hits: self.hits.out(),
            outcome: self.job.outcome.out(),
        }
    }

    /// What the scene's traversal binds.
    pub(super) fn walk<'a>(&'a self, scene: &'a Scene, traversal: Traversal) -> queries::Query<'a, OnDevice> {
        let (pairs, corners) = scene.way(traversal);
        queries::Query { pairs, corners, ..self.query(scene) }
    }

    pub(super) fn hits(&self, device: &Device) -> Result<Vec<Hit>, Error> {
        device.read(&self.hits.view(), 0, self.job.count as usize)
    }
}

/// How many rays were invalid, if the status that a kernel left is good.
pub(super) fn invalid(words: [u32; OUTCOME_WORDS as usize]) -> Result<u32, Error> {
    match words[OUTCOME_STATUS as usize] {
        0 => Ok(words[OUTCOME_INVALID as usize]),
        bits => Err(Error::of_status(bits)),
    }
}

/// How far apart the lanes are that take rays, as a logarithm: as far as there are `lanes` for, but one in 32 at least.
fn apart(rays: u32, lanes: u32) -> u32 {
    (lanes / rays.max(1)).checked_ilog2().unwrap_or(0).min(5)
}
