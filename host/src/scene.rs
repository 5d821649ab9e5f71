//! A mesh with its tree on a device, ready to trace.

use crate::{
    BuildOptions, BuildTimes, Builder, Error, KdTree,
    build::{Built, MeshBuffers, build, upload},
    exact::ExactOptions,
    exec::{Buffer, Device, Step, Timing},
    mesh::Mesh,
};
use raykd_kernels::{
    Kernel,
    trace::{
        JOB_WORDS, OUTCOME_INVALID, OUTCOME_STATUS, OUTCOME_WORDS, any::ANY, brute::BRUTE, closest::CLOSEST,
        corners::CORNERS, steps::STEPS,
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
    reserved: u32,
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
}

impl<'d> Scene<'d> {
    /// Builds the tree of a mesh on a device.
    ///
    /// # Errors
    /// The mesh does not fit the device, or the device failed.
    pub fn build(device: &'d Device, mesh: &Mesh, options: &BuildOptions) -> Result<Self, Error> {
        if options.builder == Builder::Exact {
            let start = Instant::now();
            let tree = device.install(|| crate::exact::build(mesh, options, &ExactOptions::of(options)));
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
        let corners = device.alloc("corners", u64::from(built.header.refs) * 48)?;
        let buffers = vec![&header_buffer, &on_device.positions, &on_device.indices, &built.refs, &corners];
        built.times.layout = device.run(&[Step::over(&CORNERS, built.header.refs, buffers)], false)?.total;
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
        let kernel = match query {
            Query::Closest => &CLOSEST,
            Query::Any => &ANY,
        };
        let mut traced = Traced::default();
        for part in rays.chunks(self.batch_limit()) {
            let start = Instant::now();
            let batch = Batch::new(self.device, part)?;
            traced.upload += start.elapsed();
            traced.trace += batch.run(self, kernel)?.total;
            let start = Instant::now();
            traced.invalid += batch.outcome(self.device)?;
            traced.hits.extend(batch.hits(self.device)?);
            traced.download += start.elapsed();
        }
        Ok(traced)
    }

    /// The closest hit of every ray without the tree, by testing every triangle: the oracle.
    ///
    /// # Errors
    /// The device failed.
    pub fn brute(&self, rays: &[Ray]) -> Result<Vec<Hit>, Error> {
        let kept = self.device.alloc("kept", self.kept.len() as u64 * 4)?;
        self.device.write(&kept, 0, bytemuck::cast_slice(&self.kept))?;
        let mut hits = Vec::with_capacity(rays.len());
        for part in rays.chunks(self.batch_limit() / 4) {
            let batch = Batch::new(self.device, part)?;
            let bests = self.device.alloc("best hits", part.len() as u64 * 32)?;
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
                Step::over(&BRUTE, batch.count, buffers)
            };
            // Without triangles one empty slice still writes the misses.
            let steps: Vec<Step<'_>> =
                if slices.is_empty() { vec![step(&batch.job)] } else { slices.iter().map(step).collect() };
            batch.clear(self.device)?;
            self.device.run(&steps, false)?;
            batch.outcome(self.device)?;
            hits.extend(batch.hits(self.device)?);
        }
        Ok(hits)
    }

    /// The closest hit of every ray, and what finding it cost.
    ///
    /// # Errors
    /// The device failed.
    pub fn steps(&self, rays: &[Ray]) -> Result<(Vec<Hit>, Vec<RaySteps>), Error> {
        let (mut hits, mut steps) = (Vec::new(), Vec::new());
        for part in rays.chunks(self.batch_limit()) {
            let batch = Batch::new(self.device, part)?;
            let counts = self.device.alloc("steps", part.len() as u64 * 16)?;
            let mut buffers = batch.buffers(self);
            buffers.push(&counts);
            batch.clear(self.device)?;
            self.device.run(&[Step::over(&STEPS, batch.count, buffers)], false)?;
            batch.outcome(self.device)?;
            hits.extend(batch.hits(self.device)?);
            steps.extend(self.device.read::<RaySteps>(&counts, 0, part.len())?);
        }
        Ok((hits, steps))
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
        let kernel = match query {
            Query::Closest => &CLOSEST,
            Query::Any => &ANY,
        };
        Ok(self.batch.run(self.scene, kernel)?.total)
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
}

impl Batch {
    fn new(device: &Device, rays: &[Ray]) -> Result<Self, Error> {
        let count = u32::try_from(rays.len()).unwrap_or(u32::MAX);
        let batch = Self {
            count,
            job: device.alloc("job", u64::from(JOB_WORDS) * 4)?,
            rays: device.alloc("rays", size_of_val(rays) as u64)?,
            hits: device.alloc("hits", rays.len() as u64 * 16)?,
            outcome: device.alloc("outcome", u64::from(OUTCOME_WORDS) * 4)?,
        };
        device.write(&batch.rays, 0, bytemuck::cast_slice(rays))?;
        device.write(&batch.job, 0, bytemuck::cast_slice(&[count, 0, 0, 0]))?;
        Ok(batch)
    }

    fn buffers<'a>(&'a self, scene: &'a Scene<'_>) -> Vec<&'a Buffer> {
        vec![
            &self.job,
            &scene.header_buffer,
            &scene.nodes,
            &scene.corners,
            &self.rays,
            &self.hits,
            &self.outcome,
        ]
    }

    fn run(&self, scene: &Scene<'_>, kernel: &'static Kernel) -> Result<Timing, Error> {
        self.clear(scene.device)?;
        scene.device.run(&[Step::over(kernel, self.count, self.buffers(scene))], false)
    }

    /// Forgets what earlier kernels reported.
    fn clear(&self, device: &Device) -> Result<(), Error> {
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
}
