//! Tracing rays that are in buffers of a wgpu program, in its own command encoders.

use super::Scene;
use crate::{
    Error, Query, Traversal,
    exec::{Buffer, Device, Gpu, Size},
};
use raykd_kernels::{
    Bindings as _, Host,
    trace::{
        job::OUTCOME_WORDS,
        prepare::workgroups::{self, WORKGROUPS},
        queries,
    },
};
use raykd_shared::{Hit, Ray};

/// How many rays of a buffer are traced.
#[derive(Clone, Copy, Debug)]
pub enum RayCount<'a> {
    /// So many.
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

/// The layouts of [`SceneBuffers`] in WGSL, and a walk through the tree for single rays, to put before a shader's own text.
///
/// Its first lines say how to bind the buffers, and which digits of a hit may differ from raykd's.
pub const WGSL: &str = include_str!("raykd.wgsl");

/// A scene's buffers on a GPU, for shaders of one's own, which must not write them.
///
/// They hold coordinates times [`TreeHeader::scale`](raykd_shared::TreeHeader::scale), a power of two. A buffer may be
/// longer than what it holds: the header says how many nodes and references there are.
#[derive(Clone, Copy, Debug)]
pub struct SceneBuffers<'a> {
    /// One [`TreeHeader`](raykd_shared::TreeHeader).
    pub header: &'a wgpu::Buffer,
    /// [`Node`](raykd_shared::Node)s, 8 bytes each; children are neighbours, the root is the first.
    pub nodes: &'a wgpu::Buffer,
    /// Triangle numbers that the leaves list, 4 bytes each.
    pub refs: &'a wgpu::Buffer,
    /// The same triangles' corners, 48 bytes each: see [`LeafTriangle`](crate::kernels::trace::single::LeafTriangle).
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
    /// Waits for the device, and says how many rays were none: see [`Traced::invalid`](crate::Traced::invalid).
    ///
    /// # Errors
    /// The kernel stopped, or the device failed.
    pub fn invalid(&self) -> Result<u32, Error> {
        super::batch::outcome(&self.device, &self.outcome)
    }
}

/// The error that something cannot be used with wgpu.
pub(super) fn refused(what: impl Into<String>) -> Error {
    Error::Wgpu(what.into())
}

/// How many elements of a type fit a part of a buffer.
pub(super) fn room<T>(what: &str, part: wgpu::BufferSlice<'_>) -> Result<u32, Error> {
    if !part.buffer().usage().contains(wgpu::BufferUsages::STORAGE) {
        return Err(refused(format!("the buffer of {what} lacks BufferUsages::STORAGE")));
    }
    Ok(u32::try_from(part.size() / size_of::<T>() as u64).unwrap_or(u32::MAX))
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
    /// Encodes the tracing of rays, which runs when the encoder's commands are submitted to the queue of the scene's device.
    ///
    /// `rays` holds [`Ray`]s, 32 bytes each, less the [translation](crate::Mesh::translation) of the mesh; `hits` gets as many
    /// [`Hit`]s, 16 bytes each, the same bytes as [`Scene::trace`] gives. Both are parts of buffers with
    /// `BufferUsages::STORAGE`, as is the number of rays, if that is in a buffer. Nothing is waited for, and no ray or hit
    /// is copied.
    ///
    /// # Errors
    /// The scene is not on a GPU, its traversal is not the usual one, a buffer is too small or lacks a usage, or the device
    /// failed.
    pub fn encode<'a>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        query: Query,
        rays: wgpu::BufferSlice<'_>,
        hits: wgpu::BufferSlice<'_>,
        count: impl Into<RayCount<'a>>,
    ) -> Result<Encoded, Error> {
        let gpu = self.gpu()?;
        if self.traversal != Traversal::Stack {
            let (asked, usual) = (self.traversal, Traversal::Stack);
            return Err(refused(format!(
                "rays in buffers are traced by {usual}, the scene's traversal is {asked}"
            )));
        }
        if rays.buffer() == hits.buffer() {
            return Err(refused("rays and hits are parts of one buffer; give each its own"));
        }
        let room = room::<Ray>("rays", rays)?.min(room::<Hit>("hits", hits)?);
        let count = count.into();
        let job_rays = match count {
            RayCount::Rays(rays) if rays > room => {
                return Err(refused(format!("there are {rays} rays, and the buffers have room for {room}")));
            }
            RayCount::Rays(rays) => rays,
            RayCount::InBuffer(_) => room,
        };
        let any = u32::from(query == Query::Any);
        let job = gpu.filled("job", &[job_rays, 0, 0, any])?;
        let outcome = self.device.alloc("outcome", u64::from(OUTCOME_WORDS))?;
        let encoded = Encoded { device: self.device.clone(), outcome };
        let (kernel, resources) = self.intersector.stack::<InEncoder>(
            queries::Query {
                job: job.as_entire_binding(),
                header: self.header_buffer.as_wgpu().as_entire_binding(),
                pairs: self.nodes.as_wgpu().as_entire_binding(),
                corners: self.leaf_triangles().as_wgpu().as_entire_binding(),
                rays: bind(rays),
                hits: bind(hits),
                outcome: encoded.outcome.as_wgpu().as_entire_binding(),
            },
            query,
        );
        match count {
            RayCount::Rays(0) => {}
            RayCount::Rays(rays) => gpu.encode_one(encoder, kernel, &resources, Size::Lanes(rays))?,
            RayCount::InBuffer(number) => {
                if self::room::<u32>("the number of rays", number)? == 0 {
                    return Err(refused("the number of rays takes four bytes"));
                }
                let args = gpu.filled("workgroups", &[0; 3])?;
                let counted = workgroups::Buffers::<InEncoder> {
                    count: bind(number),
                    job: job.as_entire_binding(),
                    args: args.as_entire_binding(),
                };
                let counted: Vec<_> = counted.list().collect();
                gpu.encode_one(encoder, &WORKGROUPS, &counted, Size::Lanes(1))?;
                gpu.encode_one(encoder, kernel, &resources, Size::Words(&args))?;
            }
        }
        Ok(encoded)
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
