//! A mesh with its tree on a device, ready to trace.

use crate::{
    BuildOptions, BuildTimes, Builder, Error, Intersector, KdTree,
    build::{Built, MeshBuffers, build, upload},
    exec::{Buffer, Device, Step},
    mesh::Mesh,
    traversal::{Needs, Traversal},
};
use raykd_kernels::{
    Kernel,
    trace::{
        JOB_WORDS, OUTCOME_INVALID, OUTCOME_STATUS, OUTCOME_WORDS,
        all::ALL,
        corners::{CORNERS, transforms::TRANSFORMS},
        node_boxes::NODE_BOXES,
        parents::PARENTS,
        rope_links::ROPE_LINKS,
        stack::{any::ANY, closest::CLOSEST, except::EXCEPT, steps::STEPS},
    },
};
use raykd_shared::{Hit, Ray, TreeHeader, status};
use std::time::{Duration, Instant};

/// What is asked of each ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Query {
    /// The hit with the smallest `t`; of several, the one with the lowest triangle number.
    #[default]
    Closest,
    /// Some hit, if there is one: enough for shadows.
    Any,
}

/// What one ray cost: see [`Scene::steps`].
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

/// All hits of some rays: see [`Scene::all`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AllHits {
    /// The first hits of every ray, by rising (`t`, triangle): as many a ray as asked for, the rest misses.
    pub hits: Vec<Hit>,
    /// How many hits every ray has, written or not.
    pub totals: Vec<u32>,
    /// The kernel, on the device's clock.
    pub trace: Duration,
}

/// Hits and what they took.
#[derive(Clone, Debug, Default)]
pub struct Traced {
    /// One hit a ray.
    pub hits: Vec<Hit>,
    /// Rays to device.
    pub upload: Duration,
    /// The kernel, on the device's clock.
    pub trace: Duration,
    /// Hits to host.
    pub download: Duration,
    /// Rays that were none (NaN, infinite, zero direction, origin out of range); they hit nothing.
    pub invalid: u32,
}

/// Triangles per dispatch of the brute-force kernel.
const BRUTE_SLICE: u32 = 4096;

/// A mesh and its tree, resident on a device.
#[derive(Debug)]
pub struct Scene<'d> {
    device: &'d Device,
    header: TreeHeader,
    header_buffer: Buffer,
    nodes: Buffer,
    refs: Buffer,
    mesh: MeshBuffers,
    corners: Buffer,
    kept: Vec<u32>,
    times: BuildTimes,
    traversal: Traversal,
    intersector: Intersector,
    extras: Extras,
}

/// What some traversals and triangle tests need beside the tree.
#[derive(Debug, Default)]
struct Extras {
    transforms: Option<Buffer>,
    parents: Option<Buffer>,
    boxes: Option<Buffer>,
    /// As they are, and optimised.
    ropes: [Option<Buffer>; 2],
}

impl<'d> Scene<'d> {
    /// Builds the tree of a mesh on a device.
    ///
    /// # Errors
    /// The mesh does not fit the device, or the device failed.
    pub fn build(device: &'d Device, mesh: &Mesh, options: &BuildOptions) -> Result<Self, Error> {
        let triangles = mesh.kept().len() as f32;
        let most = options.budget.map_or(u32::MAX, |b| (b.max(1.0) * triangles) as u32);
        let mut options = options.clone();
        let (mut retries, mut before) = (0, u32::MAX);
        loop {
            let mut scene = Self::build_once(device, mesh, &options)?;
            // Planes that are not chosen by cost stay where they are; no other saves so much.
            let settled = scene.header.refs == before
                && options.long as f32 >= triangles
                && options.price >= triangles * triangles;
            if scene.header.refs <= most || settled || options.builder == Builder::Median {
                scene.times.retries += retries;
                return Ok(scene);
            }
            before = scene.header.refs;
            options.price = (2.0 * options.price).max(0.25);
            options.long = options.long.max(1).saturating_mul(2);
            retries += 1;
        }
    }

    fn build_once(device: &'d Device, mesh: &Mesh, options: &BuildOptions) -> Result<Self, Error> {
        if options.builder == Builder::Exact || options.max_depth == 0 {
            let start = Instant::now();
            let tree = if options.max_depth == 0 {
                KdTree::leaf(mesh, options)
            } else {
                device.install(|| crate::exact::build(mesh, options))
            };
            let build = start.elapsed();
            let mut scene = Self::place(device, mesh, &tree)?;
            scene.times.build = build;
            return Ok(scene);
        }
        let (on_device, built) = build(device, mesh, options)?;
        Self::assemble(device, mesh, on_device, built)
    }

    /// Puts a mesh and a tree built earlier on a device.
    ///
    /// # Errors
    /// The tree is damaged or not this mesh's, or does not fit the device.
    pub fn with_tree(device: &'d Device, mesh: &Mesh, tree: &KdTree) -> Result<Self, Error> {
        tree.validate()?;
        let header = tree.header;
        if header.triangles as usize != mesh.triangles().len()
            || (header.lo, header.hi) != mesh.scaled_bounds()
            || header.scale.to_bits() != mesh.scale().to_bits()
        {
            return Err(Error::Tree(format!(
                "this tree belongs to another mesh (of {} triangles); build it again from this one",
                header.triangles
            )));
        }
        Self::place(device, mesh, tree)
    }

    /// The same without looking at the tree.
    fn place(device: &'d Device, mesh: &Mesh, tree: &KdTree) -> Result<Self, Error> {
        let header = tree.header;
        let start = Instant::now();
        let nodes = device.alloc("nodes", tree.nodes.len() as u64 * 8)?;
        let refs = device.alloc("refs", tree.refs.len() as u64 * 4)?;
        device.write(&nodes, 0, bytemuck::cast_slice(&tree.nodes))?;
        device.write(&refs, 0, bytemuck::cast_slice(&tree.refs))?;
        let on_device = upload(device, mesh)?;
        let times = BuildTimes { upload: start.elapsed(), ..BuildTimes::default() };
        Self::assemble(device, mesh, on_device, Built { header, nodes, refs, times })
    }

    fn assemble(
        device: &'d Device,
        mesh: &Mesh,
        on_device: MeshBuffers,
        mut built: Built,
    ) -> Result<Self, Error> {
        let header_buffer = device.alloc("header", size_of::<TreeHeader>() as u64)?;
        device.write(&header_buffer, 0, bytemuck::bytes_of(&built.header))?;
        let refs = &built.refs;
        let (corners, layout) = lay_out(device, &CORNERS, &built.header, &header_buffer, &on_device, refs)?;
        built.times.layout = layout;
        Ok(Self {
            device,
            header: built.header,
            header_buffer,
            nodes: built.nodes,
            refs: built.refs,
            mesh: on_device,
            corners,
            kept: mesh.kept().to_vec(),
            times: built.times,
            traversal: Traversal::default(),
            intersector: Intersector::default(),
            extras: Extras::default(),
        })
    }

    /// The device the scene lives on.
    pub const fn device(&self) -> &'d Device {
        self.device
    }

    /// How long the build took and what it needed.
    pub const fn times(&self) -> &BuildTimes {
        &self.times
    }

    /// The tree's header.
    pub const fn header(&self) -> &TreeHeader {
        &self.header
    }

    /// Downloads the tree.
    ///
    /// # Errors
    /// The device failed.
    pub fn tree(&self) -> Result<KdTree, Error> {
        Ok(KdTree {
            header: self.header,
            nodes: self.device.read(&self.nodes, 0, self.header.nodes as usize)?,
            refs: self.device.read(&self.refs, 0, self.header.refs as usize)?,
        })
    }

    /// How rays find their way through the tree.
    pub const fn traversal(&self) -> Traversal {
        self.traversal
    }

    /// Chooses how rays find their way through the tree from now on, except for [`Scene::all`]; the hits stay the
    /// same. Makes what the traversal needs beside the tree, once.
    ///
    /// # Errors
    /// It does not go with the scene's triangle test, see [`Intersector::check`]; what it needs does not fit the device, or
    /// the device failed.
    pub fn traverse_by(&mut self, traversal: Traversal) -> Result<(), Error> {
        self.intersector.check(traversal)?;
        let (device, header, nodes, count) =
            (self.device, &self.header_buffer, &self.nodes, self.header.nodes);
        let needs = traversal.needs();
        if needs != Needs::Nothing {
            let extras = &mut self.extras;
            let parents = match extras.parents.take() {
                Some(parents) => parents,
                None => {
                    let parents = device.alloc("parents", u64::from(count / 2) * 4)?;
                    device.run(&[Step::over(&PARENTS, count, vec![header, nodes, &parents])], false)?;
                    parents
                }
            };
            if needs == Needs::Boxes && extras.boxes.is_none() {
                let boxes = device.alloc("node boxes", u64::from(count) * 32)?;
                let buffers = vec![header, nodes, &parents, &boxes];
                device.run(&[Step::over(&NODE_BOXES, count, buffers)], false)?;
                extras.boxes = Some(boxes);
            }
            if let Needs::Ropes { optimised } = needs
                && extras.ropes[usize::from(optimised)].is_none()
            {
                let job = device.alloc("job", 16)?;
                device.write(&job, 0, bytemuck::cast_slice(&[u32::from(optimised), 0, 0, 0]))?;
                let ropes = device.alloc("ropes", u64::from(count) * 48)?;
                let buffers = vec![&job, header, nodes, &parents, &ropes];
                device.run(&[Step::over(&ROPE_LINKS, count, buffers)], false)?;
                extras.ropes[usize::from(optimised)] = Some(ropes);
            }
            extras.parents = Some(parents);
        }
        self.traversal = traversal;
        Ok(())
    }

    /// How it is told whether a ray hits a triangle.
    pub const fn intersector(&self) -> Intersector {
        self.intersector
    }

    /// Chooses how it is told from now on whether a ray hits a triangle, by the closest and any hits of `stack` and `brute`.
    /// Makes what the test needs beside the tree, once. Only the default keeps what [`Scene::closest`] promises.
    ///
    /// # Errors
    /// It does not go with the scene's traversal, see [`Intersector::check`]; what it needs does not fit the device, or
    /// the device failed.
    pub fn intersect_by(&mut self, intersector: Intersector) -> Result<(), Error> {
        intersector.check(self.traversal)?;
        if intersector == Intersector::Baldwin && self.extras.transforms.is_none() {
            let (header, buffer, mesh) = (&self.header, &self.header_buffer, &self.mesh);
            let (transforms, _) = lay_out(self.device, &TRANSFORMS, header, buffer, mesh, &self.refs)?;
            self.extras.transforms = Some(transforms);
        }
        self.intersector = intersector;
        Ok(())
    }

    /// Refuses what only the default triangle test does.
    fn needs_exact(&self, asked: &str) -> Result<(), Error> {
        match self.intersector {
            Intersector::Exact => Ok(()),
            other => Err(Error::Intersector { name: other.name(), asked: asked.to_owned() }),
        }
    }

    /// Bytes of the tree on the device as its traversal uses it: nodes, references, and parents, boxes or ropes.
    pub fn tree_bytes(&self) -> u64 {
        let more: u64 = self.more().iter().map(|buffer| buffer.bytes()).sum();
        u64::from(self.header.nodes) * 8 + u64::from(self.header.refs) * 4 + more
    }

    /// The closest hit of every ray.
    ///
    /// # Errors
    /// The device failed.
    pub fn closest(&self, rays: &[Ray]) -> Result<Vec<Hit>, Error> {
        Ok(self.trace(Query::Closest, rays)?.hits)
    }

    /// Some hit of every ray that has one.
    ///
    /// # Errors
    /// The device failed.
    pub fn any(&self, rays: &[Ray]) -> Result<Vec<Hit>, Error> {
        Ok(self.trace(Query::Any, rays)?.hits)
    }

    /// Traces rays and reports times; rays are moved in batches as large as the device's buffers allow.
    ///
    /// # Errors
    /// The device failed.
    pub fn trace(&self, query: Query, rays: &[Ray]) -> Result<Traced, Error> {
        let mut traced = Traced::default();
        for part in rays.chunks(self.batch_limit()) {
            let start = Instant::now();
            let batch = Batch::new(self.device, part)?;
            traced.upload += start.elapsed();
            traced.trace += self.run(&batch, self.traversal, query)?;
            batch.finish(self.device, &mut traced)?;
        }
        Ok(traced)
    }

    /// The closest or any hit of every ray among the triangles other than the one given with it, for rays that leave a
    /// surface: `excluded` is the triangle that the ray starts on, [`MISS`](raykd_shared::MISS) for none. Uses the full stack.
    /// What is left are neighbours of that triangle, see `docs/accuracy.md`.
    ///
    /// # Errors
    /// There are not as many excluded triangles as rays, the scene's triangle test is not the default, or the device failed.
    pub fn trace_except(&self, query: Query, rays: &[Ray], excluded: &[u32]) -> Result<Traced, Error> {
        self.needs_exact("leaving out a triangle")?;
        if rays.len() != excluded.len() {
            return Err(Error::Excluded { rays: rays.len(), excluded: excluded.len() });
        }
        let mut traced = Traced::default();
        let limit = self.batch_limit();
        for (part, excluded) in rays.chunks(limit).zip(excluded.chunks(limit)) {
            let start = Instant::now();
            let batch = Batch::new(self.device, part)?;
            let but = self.device.alloc("excluded", size_of_val(excluded) as u64)?;
            self.device.write(&but, 0, bytemuck::cast_slice(excluded))?;
            traced.upload += start.elapsed();
            let mut buffers = batch.buffers(self);
            buffers.push(&but);
            batch.begin(self.device, u32::from(query == Query::Any))?;
            traced.trace += self.device.run(&[Step::over(&EXCEPT, batch.count, buffers)], false)?.total;
            batch.finish(self.device, &mut traced)?;
        }
        Ok(traced)
    }

    /// The closest hit of every ray without the tree, by testing every triangle: the oracle of the scene's triangle test.
    ///
    /// # Errors
    /// The device failed.
    pub fn brute(&self, rays: &[Ray]) -> Result<Vec<Hit>, Error> {
        let mut hits = Vec::with_capacity(rays.len());
        for part in rays.chunks(self.batch_limit()) {
            let batch = Batch::new(self.device, part)?;
            self.run(&batch, Traversal::Brute, Query::Closest)?;
            batch.outcome(self.device)?;
            hits.extend(batch.hits(self.device)?);
        }
        Ok(hits)
    }

    /// All hits of every ray, each triangle once: the first `limit` of them, and how many there are. With a limit
    /// of 0 hits are only counted. Uses the full stack, once more than the ray has hits.
    ///
    /// # Errors
    /// The device failed, the hits of one ray do not fit it, or the scene's triangle test is not the default.
    pub fn all(&self, rays: &[Ray], limit: u32) -> Result<AllHits, Error> {
        self.needs_exact("a query for all hits")?;
        let mut all = AllHits::default();
        let room = (self.device.limit().bytes / 16 / u64::from(limit.max(1))) as usize;
        for part in rays.chunks(self.batch_limit().min(room).max(1)) {
            let batch = Batch::with_room(self.device, part, limit)?;
            let totals = self.device.alloc("totals", part.len() as u64 * 4)?;
            let mut buffers = batch.buffers(self);
            buffers.push(&totals);
            batch.begin(self.device, limit)?;
            all.trace += self.device.run(&[Step::over(&ALL, batch.count, buffers)], false)?.total;
            batch.outcome(self.device)?;
            all.hits.extend(self.device.read::<Hit>(&batch.hits, 0, part.len() * limit as usize)?);
            all.totals.extend(self.device.read::<u32>(&totals, 0, part.len())?);
        }
        Ok(all)
    }

    /// The closest hit of every ray, and what finding it cost.
    ///
    /// # Errors
    /// The device failed, or the scene's triangle test is not the default and the traversal not `brute`.
    pub fn steps(&self, rays: &[Ray]) -> Result<(Vec<Hit>, Vec<RaySteps>), Error> {
        if self.traversal == Traversal::Brute {
            let tests = RaySteps { tests: self.kept.len() as u32, ..RaySteps::default() };
            return Ok((self.brute(rays)?, vec![tests; rays.len()]));
        }
        self.needs_exact("counting steps")?;
        let (mut hits, mut steps) = (Vec::new(), Vec::new());
        for part in rays.chunks(self.batch_limit()) {
            let batch = Batch::new(self.device, part)?;
            let mut buffers = batch.buffers(self);
            buffers.push(&batch.counts);
            buffers.extend(self.more());
            let kernel = self.traversal.kernel().unwrap_or(&STEPS);
            batch.begin(self.device, 0)?;
            self.device.run(&[Step::over(kernel, batch.count, buffers)], false)?;
            batch.outcome(self.device)?;
            hits.extend(batch.hits(self.device)?);
            steps.extend(self.device.read::<RaySteps>(&batch.counts, 0, part.len())?);
        }
        Ok((hits, steps))
    }

    /// Traces a batch once and says how long the kernels took.
    fn run(&self, batch: &Batch, traversal: Traversal, query: Query) -> Result<Duration, Error> {
        if traversal == Traversal::Brute {
            return self.run_brute(batch);
        }
        let mut buffers = batch.buffers(self);
        let kernel = match (traversal.kernel(), self.intersector.stack(), query) {
            (Some(kernel), ..) => {
                buffers.push(&batch.counts);
                buffers.extend(self.more());
                kernel
            }
            (None, Some(kernel), _) => kernel,
            (None, None, Query::Closest) => &CLOSEST,
            (None, None, Query::Any) => &ANY,
        };
        batch.begin(self.device, u32::from(query == Query::Any))?;
        Ok(self.device.run(&[Step::over(kernel, batch.count, buffers)], false)?.total)
    }

    /// The triangles of the leaves as the scene's test wants them.
    fn leaf_triangles(&self) -> &Buffer {
        let transforms = self.extras.transforms.as_ref().filter(|_| self.intersector == Intersector::Baldwin);
        transforms.unwrap_or(&self.corners)
    }

    /// Buffers that only the scene's traversal binds.
    fn more(&self) -> Vec<&Buffer> {
        let extras = &self.extras;
        let [first, second] = match self.traversal.needs() {
            Needs::Nothing => [None, None],
            Needs::Boxes => [extras.boxes.as_ref(), None],
            Needs::Ropes { optimised } => {
                [extras.parents.as_ref(), extras.ropes[usize::from(optimised)].as_ref()]
            }
        };
        first.into_iter().chain(second).collect()
    }

    /// Finds the closest hits of a batch by testing every triangle.
    fn run_brute(&self, batch: &Batch) -> Result<Duration, Error> {
        let kept = self.device.alloc("kept", self.kept.len() as u64 * 4)?;
        self.device.write(&kept, 0, bytemuck::cast_slice(&self.kept))?;
        let bests = self.device.alloc("best hits", u64::from(batch.count) * 32)?;
        let count = self.kept.len() as u32;
        let slices = (0..count.div_ceil(BRUTE_SLICE)).map(|slice| {
            let job = self.device.alloc("job", u64::from(JOB_WORDS) * 4)?;
            let from = slice * BRUTE_SLICE;
            let words = [batch.count, from, count.min(from + BRUTE_SLICE), 0];
            self.device.write(&job, 0, bytemuck::cast_slice(&words))?;
            Ok(job)
        });
        let slices: Vec<Buffer> = slices.collect::<Result<_, Error>>()?;
        let step = |job| {
            let (mesh, header) = (&self.mesh, &self.header_buffer);
            let buffers = vec![
                job,
                header,
                &kept,
                &mesh.positions,
                &mesh.indices,
                &batch.rays,
                &batch.hits,
                &batch.outcome,
                &bests,
            ];
            Step::over(self.intersector.brute(), batch.count, buffers)
        };
        // Without triangles one empty slice still writes the misses.
        let steps: Vec<Step<'_>> =
            if slices.is_empty() { vec![step(&batch.job)] } else { slices.iter().map(step).collect() };
        batch.begin(self.device, 0)?;
        Ok(self.device.run(&steps, false)?.total)
    }

    /// Puts rays on the device, to trace them as often as one likes.
    ///
    /// # Errors
    /// They do not fit the device, or it failed.
    pub fn resident(&self, rays: &[Ray]) -> Result<Resident<'_>, Error> {
        Ok(Resident { scene: self, batch: Batch::new(self.device, rays)? })
    }

    /// Most rays in one batch.
    fn batch_limit(&self) -> usize {
        ((self.device.limit().bytes / size_of::<Ray>() as u64) as usize).min(1 << 24)
    }
}

/// Lays out the triangles of the leaves by a kernel, and says how long that took.
fn lay_out(
    device: &Device,
    kernel: &'static Kernel,
    header: &TreeHeader,
    header_buffer: &Buffer,
    mesh: &MeshBuffers,
    refs: &Buffer,
) -> Result<(Buffer, Duration), Error> {
    let laid = device.alloc("corners", u64::from(header.refs) * 48)?;
    let buffers = vec![header_buffer, &mesh.positions, &mesh.indices, refs, &laid];
    let time = device.run(&[Step::over(kernel, header.refs, buffers)], false)?.total;
    Ok((laid, time))
}

/// Rays that stay on the device, with room for their hits.
#[derive(Debug)]
pub struct Resident<'s> {
    scene: &'s Scene<'s>,
    batch: Batch,
}

impl Resident<'_> {
    /// Traces all rays once and says how long the kernel took.
    ///
    /// # Errors
    /// The device failed.
    pub fn trace(&self, query: Query) -> Result<Duration, Error> {
        self.scene.run(&self.batch, self.scene.traversal, query)
    }

    /// The hits of the last trace.
    ///
    /// # Errors
    /// The device failed.
    pub fn hits(&self) -> Result<Vec<Hit>, Error> {
        self.batch.outcome(self.scene.device)?;
        self.batch.hits(self.scene.device)
    }

    /// How many rays of the last trace were none, see [`Traced::invalid`].
    ///
    /// # Errors
    /// The device failed.
    pub fn invalid(&self) -> Result<u32, Error> {
        self.batch.outcome(self.scene.device)
    }
}

/// Buffers of one dispatch of rays.
#[derive(Debug)]
struct Batch {
    count: u32,
    job: Buffer,
    rays: Buffer,
    hits: Buffer,
    outcome: Buffer,
    counts: Buffer,
}

impl Batch {
    fn new(device: &Device, rays: &[Ray]) -> Result<Self, Error> {
        Self::with_room(device, rays, 1)
    }

    /// With room for so many hits a ray.
    fn with_room(device: &Device, rays: &[Ray], room: u32) -> Result<Self, Error> {
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

    fn buffers<'a>(&'a self, scene: &'a Scene<'_>) -> Vec<&'a Buffer> {
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

    /// Forgets what earlier kernels reported, and sets the word of the job that some read.
    fn begin(&self, device: &Device, option: u32) -> Result<(), Error> {
        device.write(&self.job, 0, bytemuck::cast_slice(&[self.count, 0, 0, option]))?;
        device.write(&self.outcome, 0, &[0; OUTCOME_WORDS as usize * 4])
    }

    /// Checks the status the kernel left and returns how many rays were none.
    fn outcome(&self, device: &Device) -> Result<u32, Error> {
        let words: Vec<u32> = device.read(&self.outcome, 0, OUTCOME_WORDS as usize)?;
        match words[OUTCOME_STATUS as usize] {
            0 => Ok(words[OUTCOME_INVALID as usize]),
            bits => Err(Error::Kernel(status::describe(bits))),
        }
    }

    fn hits(&self, device: &Device) -> Result<Vec<Hit>, Error> {
        device.read(&self.hits, 0, self.count as usize)
    }

    /// Adds hits and how many rays were none, and the time to fetch them.
    fn finish(&self, device: &Device, traced: &mut Traced) -> Result<(), Error> {
        let start = Instant::now();
        traced.invalid += self.outcome(device)?;
        traced.hits.extend(self.hits(device)?);
        traced.download += start.elapsed();
        Ok(())
    }
}
