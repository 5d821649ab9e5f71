//! Tracing rays that are in buffers of a wgpu program, in its own command encoders.

use super::Scene;
use crate::{
    Error, Query, Traversal,
    exec::{Buffer, Device, Gpu, Size},
    intersector::{self, Bound, exact_hits},
};
use raykd_kernels::{
    Bindings as _, Host,
    glam::{UVec4, Vec4},
    trace::{
        job::OUTCOME_WORDS,
        prepare::workgroups::{self, WORKGROUPS},
        queries,
    },
};
use raykd_shared::{Crossings, Hit, Ray};

/// How many rays of a buffer are traced.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum RayCount<'a> {
    /// This number.
    Rays(u32),
    /// As many as a `u32` at the start of this part of a buffer says when the commands run, but no more than the
    /// buffers of rays and hits have room for.
    InBuffer(wgpu::BufferSlice<'a>),
}

impl From<u32> for RayCount<'_> {
    fn from(rays: u32) -> Self {
        Self::Rays(rays)
    }
}

impl<'a> From<wgpu::BufferSlice<'a>> for RayCount<'a> {
    fn from(slice: wgpu::BufferSlice<'a>) -> Self {
        Self::InBuffer(slice)
    }
}

/// The layouts of [`SceneBuffers`] in WGSL, and a walk through the tree for single rays, to put before a shader's own
/// text.
///
/// Its first lines say how to bind the buffers, and which digits of a hit may differ from raykd's. wgpu reads WGSL if
/// its feature `wgsl` is on, which raykd leaves off: name wgpu with it in your own `Cargo.toml`.
pub const WGSL: &str = include_str!("raykd.wgsl");

/// A scene's buffers on a GPU, for shaders of one's own, which must not write them.
///
/// They hold coordinates times [`TreeHeader::scale`](raykd_shared::TreeHeader::scale), a power of two. A buffer may be
/// longer than what it holds: the header says how many nodes and references there are.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct SceneBuffers<'a> {
    /// One [`TreeHeader`](raykd_shared::TreeHeader).
    pub header: &'a wgpu::Buffer,
    /// [`Node`](raykd_shared::Node)s, 8 bytes each; children are neighbours, the root is the first.
    pub nodes: &'a wgpu::Buffer,
    /// Triangle numbers that the leaves list, 4 bytes each.
    pub refs: &'a wgpu::Buffer,
    /// The same triangles' corners, 48 bytes each: see [`LeafTriangle`](crate::single::LeafTriangle).
    pub corners: &'a wgpu::Buffer,
    /// Three `f32` a vertex.
    pub positions: &'a wgpu::Buffer,
    /// Three vertex numbers a triangle.
    pub indices: &'a wgpu::Buffer,
}

/// What became of rays whose tracing was encoded: to ask once the commands were submitted.
#[derive(Debug)]
pub struct Encoded {
    device: Device,
    outcome: Buffer<u32>,
}

impl Encoded {
    /// Waits for the device, and says how many rays were invalid: see [`Traced::invalid`](crate::Traced::invalid).
    ///
    /// # Errors
    /// The kernel stopped, or the device failed.
    pub fn invalid(&self) -> Result<u64, Error> {
        let mut words = [0; OUTCOME_WORDS as usize];
        self.device.read_into(&self.outcome, 0, &mut words)?;
        super::batch::invalid(words).map(u64::from)
    }
}

/// Rays in buffers, once they are counted.
struct InBuffers {
    job: wgpu::Buffer,
    /// The workgroups that a kernel takes, if the device counts the rays.
    args: Option<wgpu::Buffer>,
    /// How many rays there are at most.
    most: u32,
    encoded: Encoded,
}

/// The error that something cannot be used with wgpu.
pub(super) fn refused(what: impl Into<String>) -> Error {
    Error::Wgpu(what.into())
}

/// How many elements of a type fit a part of a buffer that kernels can bind.
pub(super) fn room<T>(gpu: &Gpu, what: &str, part: wgpu::BufferSlice<'_>) -> Result<u32, Error> {
    if !part.buffer().usage().contains(wgpu::BufferUsages::STORAGE) {
        return Err(refused(format!("the buffer of {what} lacks BufferUsages::STORAGE")));
    }
    let (begin, bytes) = (part.offset(), part.size());
    let aligned = u64::from(gpu.parts().0.limits().min_storage_buffer_offset_alignment);
    if begin % aligned != 0 {
        return Err(refused(format!(
            "the part of the buffer of {what} begins at byte {begin}, which is no multiple of {aligned}"
        )));
    }
    if bytes % 4 != 0 {
        return Err(refused(format!(
            "the part of the buffer of {what} has {bytes} bytes, which is no multiple of 4"
        )));
    }
    Ok(u32::try_from(bytes / size_of::<T>() as u64).unwrap_or(u32::MAX))
}

pub(super) fn bind(part: wgpu::BufferSlice<'_>) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer: part.buffer(),
        offset: part.offset(),
        size: wgpu::BufferSize::new(part.size()),
    })
}

/// How a command encoder refers to the buffers of a kernel.
pub(super) enum InEncoder {}

impl Host for InEncoder {
    type Read<'a, T: 'static> = wgpu::BindingResource<'a>;
    type Write<'a, T: 'static> = wgpu::BindingResource<'a>;
    type Any<'a> = wgpu::BindingResource<'a>;

    fn read<'a, T: 'static>(buffer: Self::Read<'a, T>) -> Self::Any<'a> {
        buffer
    }

    fn write<'a, T: 'static>(buffer: Self::Write<'a, T>) -> Self::Any<'a> {
        buffer
    }
}

impl Scene {
    /// Encodes the tracing of rays, which runs when the encoder's commands are submitted to the queue of the scene's
    /// device.
    ///
    /// `rays` holds [`Ray`]s, 32 bytes each, less the [translation](crate::Mesh::translation) of the mesh; `hits`
    /// gets as many [`Hit`]s, 16 bytes each, the same bytes as [`Scene::trace`] gives. Both are parts of buffers with
    /// `BufferUsages::STORAGE`, which begin at a multiple of the device's `min_storage_buffer_offset_alignment`, as
    /// does the number of rays, if that is in a buffer. Nothing is waited for, and no ray or hit is copied. Hits by
    /// [`Intersector::Exact`](crate::Intersector::Exact) take 16 more bytes a ray for as long as the commands need
    /// them. The example [own_wgpu] is a whole program.
    ///
    /// [own_wgpu]: https://docs.rs/crate/raykd/latest/source/examples/own_wgpu.rs
    ///
    /// # Errors
    /// The scene is not on a GPU, its traversal is neither the usual one nor `wide`, rays and hits are parts of one
    /// buffer, a buffer is too small, lacks a usage or begins elsewhere, or the device failed. The encoder may still be
    /// used.
    pub fn encode<'a>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        query: Query,
        rays: wgpu::BufferSlice<'_>,
        hits: wgpu::BufferSlice<'_>,
        count: impl Into<RayCount<'a>>,
    ) -> Result<Encoded, Error> {
        if !matches!(self.traversal, Traversal::Stack | Traversal::Wide) {
            let (stack, wide, asked) = (Traversal::Stack, Traversal::Wide, self.traversal);
            return Err(refused(format!(
                "rays in buffers are traced by {stack} or {wide}, the scene's traversal is {asked}"
            )));
        }
        let any = u32::from(query == Query::Any);
        let job = self.job_in::<Hit>(encoder, ("hits", hits), rays, count.into(), any)?;
        let bound = || self.bound(&job, self.way(self.traversal), rays, bind(hits));
        let mut more = None;
        let own = self.traversal.uncounted(bound(), query);
        let kernels: Vec<Bound<'_, InEncoder>> = if let Some(kernel) = own {
            vec![kernel]
        } else if self.intersector.narrows() {
            let more = more.insert(self.device.alloc::<[u32; 4]>("triangles", job.most.into())?).as_wgpu();
            let more = (more.as_entire_binding(), more.as_entire_binding());
            exact_hits(bound, query, self.device.by_doubles(), more).into()
        } else {
            vec![self.intersector.stack(bound(), query)]
        };
        self.encode_over(encoder, &job, kernels)?;
        Ok(job.encoded)
    }

    /// Encodes the counting of crossings as [`Scene::encode`] encodes tracing, for any traversal of the scene:
    /// `crossings` gets [`Crossings`], 8 bytes a ray, the same bytes as [`Scene::crossings`] gives. Besides, 32 bytes a
    /// ray are allocated for as long as the commands need them.
    ///
    /// ```no_run
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let (scene, mut encoder): (raykd::Scene, raykd::wgpu::CommandEncoder) = todo!();
    /// # let (rays, crossings, queue): (raykd::wgpu::Buffer, raykd::wgpu::Buffer, raykd::wgpu::Queue) = todo!();
    /// let encoded = scene.encode_crossings(&mut encoder, rays.slice(..), crossings.slice(..), 1000)?;
    /// queue.submit([encoder.finish()]);
    /// println!("{} rays are invalid", encoded.invalid()?);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The scene is not on a GPU, rays and crossings are parts of one buffer, a buffer is too small, lacks a usage or
    /// begins elsewhere, or the device failed. The encoder may still be used.
    pub fn encode_crossings<'a>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        rays: wgpu::BufferSlice<'_>,
        crossings: wgpu::BufferSlice<'_>,
        count: impl Into<RayCount<'a>>,
    ) -> Result<Encoded, Error> {
        let job = self.job_in::<Crossings>(encoder, ("crossings", crossings), rays, count.into(), 0)?;
        let undecided = self.device.alloc::<[u32; 4]>("undecided triangles", job.most.into())?;
        let query =
            || self.bound(&job, (&self.nodes, &self.corners), rays, undecided.as_wgpu().as_entire_binding());
        let more = self.device.alloc::<[u32; 4]>("more undecided triangles", job.most.into())?;
        let more = || more.as_wgpu().as_entire_binding();
        let kernels = intersector::crossings(query, || bind(crossings), (more(), more()));
        self.encode_over(encoder, &job, kernels.into())?;
        Ok(job.encoded)
    }

    /// Checks what rays are traced from and to, and makes the job of that many.
    fn job_in<Answer>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (what, answers): (&str, wgpu::BufferSlice<'_>),
        rays: wgpu::BufferSlice<'_>,
        count: RayCount<'_>,
        option: u32,
    ) -> Result<InBuffers, Error> {
        let gpu = self.gpu()?;
        if rays.buffer() == answers.buffer() {
            return Err(refused(format!("rays and {what} are parts of one buffer; give each its own")));
        }
        let room = room::<Ray>(gpu, "rays", rays)?.min(room::<Answer>(gpu, what, answers)?);
        let most = match count {
            RayCount::Rays(rays) if rays > room => {
                return Err(refused(format!("there are {rays} rays, and the buffers have room for {room}")));
            }
            RayCount::Rays(rays) => rays,
            RayCount::InBuffer(_) => room,
        };
        let job = gpu.filled("job", &[most, 0, 0, option])?;
        let mut args = None;
        if let RayCount::InBuffer(number) = count {
            if self::room::<u32>(gpu, "the number of rays", number)? == 0 {
                return Err(refused("the number of rays takes four bytes"));
            }
            let args = args.insert(gpu.filled("workgroups", &[0; 3])?);
            let counted = workgroups::Buffers::<InEncoder> {
                count: bind(number),
                job: job.as_entire_binding(),
                args: args.as_entire_binding(),
            };
            let counted = counted.list();
            gpu.encode_one(encoder, &WORKGROUPS, &counted, Size::Lanes(1))?;
        }
        let outcome = self.device.alloc("outcome", u64::from(OUTCOME_WORDS))?;
        Ok(InBuffers { job, args, most, encoded: Encoded { device: self.device.clone(), outcome } })
    }

    /// What a query of rays in a buffer binds.
    fn bound<'a>(
        &'a self,
        job: &'a InBuffers,
        (nodes, corners): (&'a Buffer<UVec4>, &'a Buffer<Vec4>),
        rays: wgpu::BufferSlice<'a>,
        hits: wgpu::BindingResource<'a>,
    ) -> queries::Query<'a, InEncoder> {
        queries::Query {
            job: job.job.as_entire_binding(),
            header: self.header_buffer.as_wgpu().as_entire_binding(),
            pairs: nodes.as_wgpu().as_entire_binding(),
            corners: corners.as_wgpu().as_entire_binding(),
            rays: bind(rays),
            hits,
            outcome: job.encoded.outcome.as_wgpu().as_entire_binding(),
        }
    }

    /// Encodes kernels over all rays of a job.
    fn encode_over(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        job: &InBuffers,
        kernels: Vec<Bound<'_, InEncoder>>,
    ) -> Result<(), Error> {
        let gpu = self.gpu()?;
        for Bound { kernel, buffers, rays } in kernels {
            match &job.args {
                // The device has counted a workgroup for 64 rays; where a kernel takes more, some have nothing to do.
                Some(args) => gpu.encode_one(encoder, kernel, &buffers, Size::Words(args))?,
                None if job.most == 0 => {}
                None => {
                    let lanes = job.most.div_ceil(rays) * kernel.threads;
                    gpu.encode_one(encoder, kernel, &buffers, Size::Lanes(lanes))?;
                }
            }
        }
        Ok(())
    }

    /// The scene's buffers, for shaders of one's own.
    ///
    /// # Errors
    /// The scene is not on a GPU.
    pub fn buffers(&self) -> Result<SceneBuffers<'_>, Error> {
        self.gpu()?;
        Ok(SceneBuffers {
            header: self.header_buffer.as_wgpu(),
            nodes: self.nodes.as_wgpu(),
            refs: self.refs.as_wgpu(),
            corners: self.corners.as_wgpu(),
            positions: self.mesh.positions.as_wgpu(),
            indices: self.mesh.indices.as_wgpu(),
        })
    }

    fn gpu(&self) -> Result<&Gpu, Error> {
        self.device.as_gpu().ok_or_else(|| refused("the scene is on the CPU; build it on a GPU"))
    }
}
