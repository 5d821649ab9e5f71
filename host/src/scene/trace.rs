//! Asking a scene for the hits of rays.

use super::{Scene, batch::Batch, order::Order};
use crate::{
    Error, Query,
    clock::Instant,
    exec::{Buffer, Launch as _, OnDevice, Step, Timed, To, reserve},
    intersector::Bound,
    lock::lock,
    rays::AnyRay,
    traversal::Traversal,
};
#[cfg(feature = "gpu")]
use crate::{exec::watch, intersector::exact_hits};
use bytemuck::allocation::zeroed_vec;
use raykd_kernels::trace::{all, queries};
use raykd_shared::{Hit, Ray};
use std::{
    borrow::Cow,
    iter,
    ops::{AddAssign, Range},
    panic::resume_unwind,
    sync::Mutex,
    thread,
    time::Duration,
};

/// What one ray cost: see [`Scene::steps`]. Four words, in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct RaySteps {
    /// Inner nodes passed.
    pub inner: u32,
    /// Leaves visited.
    pub leaves: u32,
    /// Triangles tested.
    pub tests: u32,
    /// Restarts, climbs or ropes followed; 0 with a full stack.
    pub turns: u32,
}

/// What a batch of rays took. On a GPU the host moves some rays while others are traced, so the sum may be more than
/// the time that passed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct TraceTimes {
    /// Until the rays were submitted to the device, by the host's clock.
    pub upload: Duration,
    /// The kernels, by the device's clock.
    pub trace: Duration,
    /// From there until the answers were on the host, less `trace`. A driver may compile a kernel before its first run,
    /// which may take seconds and counts here.
    pub download: Duration,
}

impl AddAssign for TraceTimes {
    fn add_assign(&mut self, other: Self) {
        self.upload += other.upload;
        self.trace += other.trace;
        self.download += other.download;
    }
}

/// Hits and what they cost, ray by ray: see [`Scene::steps`].
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Stepped {
    /// One hit a ray, in the order of the rays.
    pub hits: Vec<Hit>,
    /// What each ray cost.
    pub steps: Vec<RaySteps>,
    /// What it took. Counting takes time too.
    pub times: TraceTimes,
    /// Invalid rays, see [`Traced::invalid`].
    pub invalid: u64,
}

/// All hits of some rays: see [`Scene::all`].
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct AllHits {
    /// The hits of one ray after those of the other, each ray's by rising (`t`, triangle).
    pub hits: Vec<Hit>,
    /// Where in `hits` those of each ray begin; one more number says where the last end.
    pub begins: Vec<usize>,
    /// How many hits every ray has, also beyond the limit.
    pub totals: Vec<u32>,
    /// What it took.
    pub times: TraceTimes,
    /// Invalid rays, see [`Traced::invalid`].
    pub invalid: u64,
}

impl AllHits {
    /// The hits of one ray.
    ///
    /// # Panics
    /// There is no ray of this number.
    pub fn of(&self, ray: usize) -> &[Hit] {
        &self.hits[self.begins[ray]..self.begins[ray + 1]]
    }
}

/// Hits and what they took: see [`Scene::trace`].
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Traced {
    /// One hit a ray, in the order of the rays.
    pub hits: Vec<Hit>,
    /// What it took.
    pub times: TraceTimes,
    /// Invalid rays: with NaN, an infinite origin or direction, a zero direction, or an origin out of range. They hit
    /// nothing.
    pub invalid: u64,
}

impl Traced {
    /// The times and numbers of both.
    fn and(mut self, other: &Self) -> Self {
        self.times += other.times;
        self.invalid += other.invalid;
        self
    }
}

/// Rays that a device gets at once where there are more. Fewer would not keep a GPU busy; of more it would wait for the
/// first, and a CPU would need the memory.
const OVERLAPPED: usize = 1 << 20;

/// Traces parts one after the other.
fn alone<P>(
    parts: impl Iterator<Item = P>,
    mut trace: impl FnMut(P) -> Result<Traced, Error>,
) -> Result<Traced, Error> {
    let mut all = Traced::default();
    for part in parts {
        all = all.and(&trace(part)?);
    }
    Ok(all)
}

/// Traces parts two at a time: while one is on the device, which takes one at a time, the other is moved.
fn by_two<P>(
    parts: impl Iterator<Item = P> + Send,
    trace: impl Fn(P) -> Result<Traced, Error> + Sync,
) -> Result<Traced, Error> {
    let parts = Mutex::new(parts);
    let next = || lock(&parts).next();
    let work = || alone(iter::from_fn(next), &trace);
    thread::scope(|scope| {
        // Where there are no more threads, this one does it all.
        let other = thread::Builder::new().spawn_scoped(scope, work);
        let one = work();
        let other = other.map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)));
        Ok(one?.and(&other.unwrap_or_else(|_| Ok(Traced::default()))?))
    })
}

/// The word of the job that tells what is asked.
fn asked(query: Query) -> u32 {
    u32::from(query == Query::Any)
}

/// What tracing brought and took, by what runs the kernels and fetches the hits.
pub(super) fn traced(
    upload: Duration,
    run: impl FnOnce() -> Result<(Duration, u32), Error>,
) -> Result<Traced, Error> {
    let start = Instant::now();
    let (trace, invalid) = run()?;
    let download = start.elapsed().saturating_sub(trace);
    let times = TraceTimes { upload, trace, download };
    Ok(Traced { hits: Vec::new(), times, invalid: invalid.into() })
}

/// Triangles per dispatch of the brute-force kernel.
const BRUTE_SLICE: u32 = 4096;

/// Rays are given in the mesh's own coordinates, in `f32` or `f64`; `t`, `u` and `v` are the same wherever a mesh is.
impl Scene {
    /// The closest hit of every ray.
    ///
    /// # Errors
    /// The device failed.
    pub fn closest(&self, rays: &[impl AnyRay]) -> Result<Vec<Hit>, Error> {
        self.hits(Query::Closest, rays)
    }

    /// Some hit of every ray that has one.
    ///
    /// # Errors
    /// The device failed.
    pub fn any(&self, rays: &[impl AnyRay]) -> Result<Vec<Hit>, Error> {
        self.hits(Query::Any, rays)
    }

    /// Hits alone, without times.
    fn hits(&self, query: Query, rays: &[impl AnyRay]) -> Result<Vec<Hit>, Error> {
        Ok(self.made(query, Timed::Nothing, rays.len(), |range| rays[range].into())?.hits)
    }

    /// Traces rays and reports times; rays are moved in batches as large as the device's buffers allow, at most. On a
    /// GPU the host moves some while others are traced, so that times overlap, unless a thread of rayon asks. An H200
    /// takes 12 µs to tell the time: who does not need it asks for [`Scene::closest`] or [`Scene::any`].
    ///
    /// # Errors
    /// The device failed.
    pub fn trace(&self, query: Query, rays: &[impl AnyRay]) -> Result<Traced, Error> {
        self.made(query, Timed::Whole, rays.len(), |range| rays[range].into())
    }

    /// Traces rays that are made when it is their turn: so many, those of a range by `make`. Of times it says nothing.
    ///
    /// # Errors
    /// The device failed.
    #[doc(hidden)]
    pub fn trace_made<'a, R: AnyRay + 'a>(
        &self,
        query: Query,
        count: usize,
        make: impl Fn(Range<usize>) -> Cow<'a, [R]> + Sync,
    ) -> Result<(Vec<Hit>, u64), Error> {
        self.made(query, Timed::Nothing, count, make).map(|traced| (traced.hits, traced.invalid))
    }

    fn made<'a, R: AnyRay + 'a>(
        &self,
        query: Query,
        timed: Timed,
        count: usize,
        make: impl Fn(Range<usize>) -> Cow<'a, [R]> + Sync,
    ) -> Result<Traced, Error> {
        self.in_parts(count, |range, hits, turn| {
            let start = Instant::now();
            let uploading = lock(turn);
            let (mut batch, order) = self.ordered(&make(range))?;
            drop(uploading);
            batch.job.timed = timed;
            let upload = start.elapsed();
            let run = |hits: To<'_, Hit>| self.run(&batch, self.traversal, query, hits);
            traced(upload, || order.trace(self, &batch, hits, run))
        })
    }

    /// Rays on the device, in the order that is best there.
    fn ordered(&self, rays: &[impl AnyRay]) -> Result<(Batch, Order), Error> {
        let rays = AnyRay::local(rays, self.translation);
        let order = Order::of(self, &rays);
        let device = self.device.for_rays(rays.len());
        Ok((Batch::of_local(&device, &order.apply(self, &rays), 1)?, order))
    }

    /// Traces so many rays in parts, by a function of which rays they are, where their hits go, and a lock to hold
    /// while rays are moved to the device, so that those of one part are there early.
    fn in_parts(
        &self,
        count: usize,
        trace: impl Fn(Range<usize>, To<'_, Hit>, &Mutex<()>) -> Result<Traced, Error> + Sync,
    ) -> Result<Traced, Error> {
        let (most, turn) = (self.batch_limit().min(OVERLAPPED), Mutex::new(()));
        if count == 0 {
            return Ok(Traced::default());
        }
        if count <= most {
            let mut hits = Vec::new();
            let traced = trace(0..count, To::End(&mut hits, count), &turn)?;
            return Ok(Traced { hits, ..traced });
        }
        let mut hits: Vec<Hit> = zeroed_vec(count);
        let parts = hits.chunks_mut(most).enumerate();
        let part =
            |(i, hits): (usize, &mut [Hit])| trace(i * most..i * most + hits.len(), To::Room(hits), &turn);
        // A thread of rayon must not wait for another one that may itself wait for rayon.
        let is_alone = self.device.is_cpu() || rayon::current_thread_index().is_some();
        let all = if is_alone { alone(parts, part) } else { by_two(parts, part) }?;
        Ok(Traced { hits, ..all })
    }

    /// The closest or any hit of every ray among the triangles other than the one given with it, for rays that leave a
    /// surface: `excluded` is the triangle that the ray starts on, [`MISS`](raykd_shared::MISS) for none. Uses the full
    /// stack. At an edge the rounded origin may lie behind a neighbour of that triangle, which is then hit.
    ///
    /// # Errors
    /// There are not as many excluded triangles as rays, the scene's triangle test is neither the default nor `exact`,
    /// or the device failed.
    pub fn trace_except(
        &self,
        query: Query,
        rays: &[impl AnyRay],
        excluded: &[u32],
    ) -> Result<Traced, Error> {
        if rays.len() != excluded.len() {
            return Err(Error::Excluded { rays: rays.len(), excluded: excluded.len() });
        }
        self.in_parts(rays.len(), |range, hits, turn| {
            let start = Instant::now();
            let uploading = lock(turn);
            let (batch, order) = self.ordered(&rays[range.clone()])?;
            let excluded = &self.device.upload("excluded", &order.apply(self, &excluded[range]))?;
            drop(uploading);
            let upload = start.elapsed();
            let except = self.intersector.except(batch.query(self), excluded, batch.lanes())?;
            traced(upload, || {
                order.trace(self, &batch, hits, |hits| {
                    batch.job.run(&self.device, &[except], asked(query), vec![batch.hits.back(hits)])
                })
            })
        })
    }

    /// The closest hit of every ray without the tree, by testing every triangle: what a scene of
    /// [`Traversal::Brute`] answers, whatever this one's traversal is. To check others by.
    ///
    /// # Errors
    /// The device failed.
    pub fn brute(&self, rays: &[impl AnyRay]) -> Result<Vec<Hit>, Error> {
        Ok(self.brute_traced(rays)?.hits)
    }

    fn brute_traced(&self, rays: &[impl AnyRay]) -> Result<Traced, Error> {
        let mut hits = Vec::with_capacity(rays.len());
        let all = self.in_batches(rays, |batch, count| {
            self.run(batch, Traversal::Brute, Query::Closest, To::End(&mut hits, count))
        })?;
        Ok(Traced { hits, ..all })
    }

    /// Asks something of all rays, batch by batch.
    fn in_batches(
        &self,
        rays: &[impl AnyRay],
        mut ask: impl FnMut(&Batch, usize) -> Result<(Duration, u32), Error>,
    ) -> Result<Traced, Error> {
        alone(rays.chunks(self.batch_limit()), |part| {
            let start = Instant::now();
            let batch = Batch::new(self, part)?;
            let upload = start.elapsed();
            traced(upload, || ask(&batch, part.len()))
        })
    }

    /// All hits of every ray, each triangle once: `limit` of a ray at most, and how many there are. With a limit of 0
    /// hits are only counted. Uses the full stack; a walk finds up to eight hits. If a ray hits many triangles in one
    /// place, which lie on one another, its time grows with the square of their number.
    ///
    /// ```
    /// use raykd::{BuildOptions, Device, Mesh, Ray, Scene};
    ///
    /// let scene = Scene::build(&Device::cpu(), &Mesh::teapot(4), &BuildOptions::default())?;
    /// let rays = [Ray::new([0.1, 0.2, 9.0], [0.0, 0.0, -1.0]), Ray::new([9.0, 9.0, 9.0], [0.0, 0.0, 1.0])];
    /// let all = scene.all(&rays, u32::MAX)?;
    /// assert_eq!(all.of(0)[0], scene.closest(&rays)?[0]);
    /// assert_eq!((all.of(0).len(), all.of(1).len()), (all.totals[0] as usize, 0));
    /// # Ok::<(), raykd::Error>(())
    /// ```
    ///
    /// # Errors
    /// The device failed, the hits of one ray do not fit it, there is no memory for those of all, or the scene's
    /// triangle test is neither the default nor `exact`.
    pub fn all(&self, rays: &[impl AnyRay], limit: u32) -> Result<AllHits, Error> {
        let mut all = AllHits { begins: vec![0], ..AllHits::default() };
        let room = (self.device.limit().bytes / 16).min(u32::MAX.into());
        let most = (room / u64::from(limit.clamp(1, all::KEPT))) as usize;
        for part in rays.chunks(self.batch_limit().min(most).clamp(1, OVERLAPPED)) {
            self.all_of(part, limit, room, &mut all)?;
        }
        Ok(all)
    }

    /// Adds the hits of some rays, where there is `room` for so many at once.
    pub(super) fn all_of(
        &self,
        rays: &[impl AnyRay],
        limit: u32,
        room: u64,
        all: &mut AllHits,
    ) -> Result<(), Error> {
        let kept = limit.min(all::KEPT);
        let start = Instant::now();
        let batch = Batch::with_room(self, rays, kept)?;
        let totals = self.device.for_rays(rays.len()).room("totals", rays.len() as u64)?;
        all.times.upload += start.elapsed();
        // Where hits begin is not known yet.
        let nowhere = &batch.job.record;
        let count = self.intersector.count(batch.query(self), totals.out(), nowhere, batch.lanes())?;
        let counted = all.totals.len();
        let counting = traced(Duration::ZERO, || {
            let totals = totals.back(To::End(&mut all.totals, rays.len()));
            batch.job.run(&self.device, &[count], kept, vec![totals])
        })?;
        all.times += counting.times;

        let start = Instant::now();
        let (mut begins, mut end, mut most) = (Vec::with_capacity(rays.len() + 1), 0u64, 0);
        begins.push(0);
        for &total in &all.totals[counted..] {
            let wanted = total.min(limit);
            most = most.max(wanted);
            end += u64::from(wanted);
            begins.push(end as u32);
        }
        if end > room && rays.len() > 1 {
            all.totals.truncate(counted);
            let (some, others) = rays.split_at(rays.len() / 2);
            self.all_of(some, limit, room, all)?;
            return self.all_of(others, limit, room, all);
        }
        all.invalid += counting.invalid;
        let begun = all.hits.len();
        all.begins.extend(begins[1..].iter().map(|&begin| begun + begin as usize));
        if end == 0 {
            return Ok(());
        }
        reserve(&mut all.hits, "hits", end)?;
        let device = self.device.for_rays(rays.len().max(end as usize));
        let (begins, hits) = (device.put("begins", &begins)?, device.room("all hits", end)?);
        all.times.upload += start.elapsed();
        let (job, kept_hits) = (&batch.job.record, &batch.hits);
        let gather = all::Buffers { job, begins: &begins, kept_hits, hits: hits.out() };
        let mut steps = vec![gather.over(rays.len() as u32)];
        if most > kept {
            let query = queries::Query { hits: hits.out(), ..batch.query(self) };
            steps.push(self.intersector.count(query, totals.out(), &begins, batch.lanes())?);
        }
        let gathering = traced(Duration::ZERO, || {
            let hits = hits.back(To::End(&mut all.hits, end as usize));
            batch.job.run(&self.device, &steps, kept | all::AGAIN, vec![hits])
        })?;
        all.times += gathering.times;
        Ok(())
    }

    /// The closest hit of every ray, and what finding it cost.
    ///
    /// # Errors
    /// The device failed, or the scene's triangle test is neither the default nor `exact` and the traversal not
    /// `brute`.
    pub fn steps(&self, rays: &[impl AnyRay]) -> Result<Stepped, Error> {
        if self.traversal == Traversal::Brute {
            let tests = RaySteps { tests: self.kept.count(), ..RaySteps::default() };
            let Traced { hits, times, invalid } = self.brute_traced(rays)?;
            return Ok(Stepped { hits, steps: vec![tests; rays.len()], times, invalid });
        }
        let (mut hits, mut steps) = (Vec::new(), Vec::new());
        let Traced { times, invalid, .. } = self.in_batches(rays, |batch, count| {
            let step = match self.walk(batch, self.traversal) {
                Some(step) => step,
                None => self.intersector.steps(batch.query(self), batch.counts.out(), batch.lanes())?,
            };
            let hits = batch.hits.back(To::End(&mut hits, count));
            let counts = batch.counts.back(To::End::<RaySteps>(&mut steps, count));
            batch.job.run(&self.device, &[step], asked(Query::Closest), vec![hits, counts])
        })?;
        Ok(Stepped { hits, steps, times, invalid })
    }

    /// Traces a batch once, and fetches hits: how long the kernels took, and how many rays were invalid.
    pub(super) fn run(
        &self,
        batch: &Batch,
        traversal: Traversal,
        query: Query,
        hits: To<'_, Hit>,
    ) -> Result<(Duration, u32), Error> {
        if traversal == Traversal::Brute {
            return self.run_brute(batch, hits);
        }
        let uncounted = traversal.uncounted(batch.walk(self, traversal), query);
        let one = uncounted.map(|bound| bound.step(batch.lanes())).or_else(|| self.walk(batch, traversal));
        let steps = match one {
            Some(step) => vec![step],
            None => self.bound_to(batch, query).into_iter().map(|bound| bound.step(batch.lanes())).collect(),
        };
        batch.job.run(&self.device, &steps, asked(query), vec![batch.hits.back(hits)])
    }

    /// With a full stack: kernels in order.
    fn bound_to<'a>(&'a self, batch: &'a Batch, query: Query) -> Vec<Bound<'a, OnDevice>> {
        // A CPU that is watched does what a GPU does.
        #[cfg(feature = "gpu")]
        if self.intersector.narrows() && (!self.device.is_cpu() || watch::is_on()) {
            let more = (batch.counts.out(), &batch.counts);
            return exact_hits(|| batch.query(self), query, self.device.by_doubles(), more).into();
        }
        vec![self.intersector.stack(batch.query(self), query)]
    }

    /// By a traversal that also counts its steps.
    fn walk<'a>(&'a self, batch: &'a Batch, traversal: Traversal) -> Option<Step<'a>> {
        traversal.step(batch.walk(self, traversal), batch.counts.out(), batch.lanes(), &self.extras)
    }

    /// Finds the closest hits of a batch by testing every triangle.
    fn run_brute(&self, batch: &Batch, hits: To<'_, Hit>) -> Result<(Duration, u32), Error> {
        let kept = self.kept.on(&self.device)?;
        let bests = self.device.alloc("best hits", 2 * u64::from(batch.job.count))?;
        let count = self.kept.count();
        // Without triangles one empty slice still writes the misses.
        let slices = (0..count.div_ceil(BRUTE_SLICE).max(1)).map(|slice| {
            let from = slice * BRUTE_SLICE;
            self.device.upload("job", &[batch.job.count, from, count.min(from + BRUTE_SLICE), 0])
        });
        let slices: Vec<Buffer<u32>> = slices.collect::<Result<_, Error>>()?;
        let step = |job| {
            let brute = queries::Brute {
                job,
                header: &self.header_buffer,
                kept: &kept,
                positions: &self.mesh.positions,
                indices: &self.mesh.indices,
                rays: &batch.rays,
                hits: batch.hits.out(),
                outcome: batch.job.outcome.out(),
                bests: bests.out(),
            };
            self.intersector.brute(brute, batch.job.count)
        };
        let steps: Vec<Step<'_>> = slices.iter().map(step).collect();
        batch.job.run(&self.device, &steps, 0, vec![batch.hits.back(hits)])
    }

    /// Most rays in one batch.
    #[doc(hidden)]
    pub fn batch_limit(&self) -> usize {
        ((self.device.limit().bytes / size_of::<Ray>() as u64) as usize).min(1 << 24)
    }
}
