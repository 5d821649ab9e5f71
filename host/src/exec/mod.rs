//! Running kernels: buffers and dispatches on the CPU and on the GPU behind one surface.

pub(crate) mod cpu;
#[cfg(feature = "gpu")]
mod gpu;
pub(crate) mod pages;
mod pool;
#[doc(hidden)]
pub mod watch;

pub use cpu::Cpu;
#[cfg(feature = "gpu")]
pub(crate) use gpu::Size;
#[cfg(feature = "gpu")]
pub use gpu::{AdapterReport, AdapterVerdict, Gpu, adapters, required_features, required_limits};

use crate::Error;
use bytemuck::allocation::zeroed_vec;
use raykd_kernels::{Bindings, Host, Kernel};
#[cfg(feature = "gpu")]
use rayon::prelude::*;
#[cfg(feature = "gpu")]
use std::sync::{Mutex, PoisonError};
use std::{fmt, marker::PhantomData, ops::Deref, sync::Arc, time::Duration};

/// A machine that kernels run on: the processor, by rayon, or a Vulkan device, by wgpu. Clones are the same machine.
#[derive(Clone, Debug)]
pub struct Device {
    machine: Arc<Machine>,
    /// What the last build noted, if the next one is to expect a mesh like it.
    #[cfg(feature = "gpu")]
    notes: Option<Arc<Mutex<Option<Past>>>>,
    /// Where the memory of scenes goes and comes from, if it is used again.
    pool: Option<Arc<pool::Pool>>,
}

#[derive(Debug)]
enum Machine {
    Cpu(Cpu),
    #[cfg(feature = "gpu")]
    Gpu(Box<Gpu>),
}

#[doc(hidden)]
impl From<Cpu> for Device {
    fn from(cpu: Cpu) -> Self {
        Self::on(Machine::Cpu(cpu))
    }
}

#[cfg(feature = "gpu")]
#[doc(hidden)]
impl From<Gpu> for Device {
    fn from(gpu: Gpu) -> Self {
        Self::on(Machine::Gpu(Box::new(gpu)))
    }
}

/// What runs the kernels: see [`Device::kind`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum DeviceKind {
    /// The processor.
    Cpu,
    /// A Vulkan device.
    Gpu,
}

impl DeviceKind {
    /// `cpu` or `gpu`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Memory on a [`Device`]. Clones share it.
#[derive(Clone, Debug)]
pub struct AnyBuffer {
    name: &'static str,
    bytes: u64,
    memory: Memory,
    /// Counted: a pool that has the only one may give the memory to somebody else.
    users: Arc<()>,
}

#[derive(Clone, Debug)]
enum Memory {
    Cpu(cpu::Memory),
    #[cfg(feature = "gpu")]
    Gpu(wgpu::Buffer),
}

// Left to itself, the compiler finds `Send` and `Sync` out by going through all types of wgpu, and does so again in
// each function with bounds: a quarter of the time that this crate takes, and some in every crate that uses it. So what
// holds them says it, and all that it holds is checked once.
const fn checked<T: Send + Sync>(_: &T) {}
const _: fn(&Memory) = |memory| match memory {
    Memory::Cpu(memory) => checked(memory),
    #[cfg(feature = "gpu")]
    Memory::Gpu(buffer) => checked(buffer),
};
// SAFETY: what it holds is, as checked above.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

impl AnyBuffer {
    fn of(name: &'static str, bytes: u64, memory: Memory) -> Self {
        Self { name, bytes, memory, users: Arc::default() }
    }

    /// The name it was allocated under.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// Its size in bytes.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whether nobody else has it, or reads what it holds.
    fn is_free(&self) -> bool {
        let is_read = match &self.memory {
            Memory::Cpu(memory) => memory.is_shared(),
            #[cfg(feature = "gpu")]
            Memory::Gpu(_) => false,
        };
        Arc::strong_count(&self.users) == 1 && !is_read
    }

    /// Bytes of its memory, of which it may use a part.
    fn room(&self) -> u64 {
        match &self.memory {
            Memory::Cpu(memory) => memory.len(),
            #[cfg(feature = "gpu")]
            Memory::Gpu(memory) => memory.size(),
        }
    }

    /// The same memory as elements of some type.
    pub fn view<T>(&self) -> Buffer<T> {
        Buffer { any: self.clone(), of: PhantomData }
    }

    /// What is to be read from its start once kernels have run.
    pub(crate) fn back<'a, T: bytemuck::Pod + Send + Sync>(&'a self, to: To<'a, T>) -> Back<'a> {
        match to {
            To::Room(room) => self.back_from(0, room),
            To::End(list, count) => {
                const { assert!(size_of::<T>().is_power_of_two() && align_of::<T>() <= 4, "parts hold them") };
                let offset = self.place("read", size_of::<T>(), 0, count);
                list.reserve(count);
                let take = move |part: &[u8]| {
                    let elements: &[T] = bytemuck::cast_slice(part);
                    #[cfg(feature = "gpu")]
                    if part.len() > PIECE {
                        return list.par_extend(elements.par_iter().with_min_len(PIECE / size_of::<T>()));
                    }
                    list.extend_from_slice(elements);
                };
                Back { buffer: self, offset, bytes: count * size_of::<T>(), take: Box::new(take) }
            }
        }
    }

    /// What is to be read from the element numbered `from` on, as much as there is room for.
    pub(crate) fn back_from<'a, T: bytemuck::Pod>(&'a self, from: u64, room: &'a mut [T]) -> Back<'a> {
        let offset = self.place("read", size_of::<T>(), from, room.len());
        let bytes = size_of_val(room);
        let mut rest: &mut [u8] = bytemuck::cast_slice_mut(room);
        let take = move |part: &[u8]| {
            let (now, later) = std::mem::take(&mut rest).split_at_mut(part.len());
            rest = later;
            #[cfg(feature = "gpu")]
            if part.len() > PIECE {
                let pieces = now.par_chunks_mut(PIECE).zip(part.par_chunks(PIECE));
                return pieces.for_each(|(now, part)| now.copy_from_slice(part));
            }
            now.copy_from_slice(part);
        };
        Back { buffer: self, offset, bytes, take: Box::new(take) }
    }

    /// Where `count` elements of `size` bytes begin from the one numbered `from` on. Panics if they do not lie inside.
    fn place(&self, act: &str, size: usize, from: u64, count: usize) -> u64 {
        let begin = from.checked_mul(size as u64);
        let bytes = count.checked_mul(size).map(|bytes| bytes as u64);
        let end = begin.zip(bytes).and_then(|(begin, bytes)| begin.checked_add(bytes));
        let inside = begin.filter(|_| end.is_some_and(|end| end <= self.bytes));
        inside.unwrap_or_else(|| panic!("{act} past the end of {}", self.name))
    }
}

/// A buffer of elements of type `T`. Clones share the memory.
#[derive(Debug)]
pub struct Buffer<T> {
    any: AnyBuffer,
    of: PhantomData<fn() -> T>,
}

impl<T> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        self.any.view()
    }
}

impl<T> Deref for Buffer<T> {
    type Target = AnyBuffer;
    fn deref(&self) -> &AnyBuffer {
        &self.any
    }
}

impl<T> Buffer<T> {
    /// How many elements it holds.
    pub const fn elements(&self) -> usize {
        self.any.bytes as usize / size_of::<T>()
    }

    /// The buffer with all the memory that is there: where that was used before, it may be more than was asked for.
    pub(crate) fn whole(self) -> Self {
        let bytes = match &self.any.memory {
            Memory::Cpu(_) => self.any.bytes,
            #[cfg(feature = "gpu")]
            Memory::Gpu(memory) => memory.size(),
        };
        Self { any: AnyBuffer { bytes, ..self.any }, of: PhantomData }
    }

    /// The buffer for its first `count` elements.
    pub(crate) fn first(mut self, count: u32) -> Self {
        self.any.bytes = whole_bytes::<T>(count.into()).min(self.any.bytes);
        self
    }

    /// The buffer, to be written by a kernel.
    pub const fn out(&self) -> Out<'_, T> {
        Out(self)
    }
}

/// Where elements go that are read.
#[derive(Debug)]
pub(crate) enum To<'a, T> {
    /// Into memory that is there, which they fill.
    Room(&'a mut [T]),
    /// So many to the end of a list: new memory need not be zeroed first, which takes as long as to fill it.
    End(&'a mut Vec<T>, usize),
}

/// What is given bytes that were read.
type Take<'a> = Box<dyn FnMut(&[u8]) + Send + 'a>;

/// What is to be read of a buffer.
pub(crate) struct Back<'a> {
    buffer: &'a AnyBuffer,
    offset: u64,
    bytes: usize,
    /// Is given the bytes, in one part or several.
    take: Take<'a>,
}

/// Bytes that one thread copies at least. One alone moves much less than a bus, the more so into memory that the
/// process has never touched. So many, or fewer, are copied by the thread that asks.
const PIECE: usize = 256 << 10;

/// What a build notes for the next one: words that only builds understand.
pub(crate) type Past = [u32; 10];

/// Bytes of a buffer of so many elements: some, and a multiple of 16.
const fn whole_bytes<T>(count: u64) -> u64 {
    match count.saturating_mul(size_of::<T>() as u64) {
        0 => 16,
        bytes => bytes.div_ceil(16).saturating_mul(16),
    }
}

/// A buffer that a kernel writes.
#[derive(Debug)]
pub struct Out<'a, T>(&'a Buffer<T>);

/// How [`Device`]s refer to the buffers of a kernel.
#[derive(Debug)]
pub enum OnDevice {}

impl Host for OnDevice {
    type Read<'a, T: 'static> = &'a Buffer<T>;
    type Write<'a, T: 'static> = Out<'a, T>;
    type Any<'a> = &'a AnyBuffer;

    fn read<'a, T: 'static>(buffer: Self::Read<'a, T>) -> Self::Any<'a> {
        &buffer.any
    }

    fn write<'a, T: 'static>(buffer: Self::Write<'a, T>) -> Self::Any<'a> {
        &buffer.0.any
    }
}

/// How many workgroups a step runs.
#[derive(Clone, Debug)]
pub enum Groups<'a> {
    /// This many.
    Fixed(u32),
    /// As many as an earlier kernel wrote: three words `[x, y, z]` at word `3 * entry` of the buffer, for a
    /// dispatch of `x * y * z` workgroups. The step itself must not write that buffer.
    Indirect(&'a Buffer<u32>, u32),
}

/// One dispatch: a kernel, its buffers in binding order, and how many workgroups. [`Launch`] makes them.
#[derive(Clone, Debug)]
pub struct Step<'a> {
    /// What runs.
    pub kernel: &'static Kernel,
    /// On which buffers; as many as the kernel has slots.
    pub buffers: Vec<&'a AnyBuffer>,
    /// How often.
    pub groups: Groups<'a>,
}

/// Makes a dispatch of a kernel's buffers.
///
/// ```
/// # use raykd::{Device, internals::{Launch, kernels::probe::Buffers}};
/// # let device = Device::cpu();
/// # let (inputs, results) = (device.alloc("inputs", 1)?, device.alloc("results", 8)?);
/// let count = device.alloc("count", 1)?;
/// let step = Buffers { inputs: &inputs, results: results.out(), count: &count }.over(1);
/// # Ok::<_, raykd::Error>(())
/// ```
///
/// A buffer of another type does not compile, nor does one that is missing, or written without saying so:
///
/// ```compile_fail,E0271
/// # use raykd::{Device, internals::{Launch, kernels::probe::Buffers}};
/// # let device = Device::cpu();
/// # let (inputs, results) = (device.alloc("inputs", 1)?, device.alloc("results", 8)?);
/// let count = device.alloc::<f32>("count", 1)?;
/// let step = Buffers { inputs: &inputs, results: results.out(), count: &count }.over(1);
/// # Ok::<_, raykd::Error>(())
/// ```
pub trait Launch<'a>: Bindings<'a, OnDevice> + Sized {
    /// Of so many workgroups.
    fn run(self, groups: Groups<'a>) -> Step<'a> {
        Step { kernel: Self::KERNEL, buffers: self.list().collect(), groups }
    }

    /// Of as many workgroups as cover `items` lanes.
    fn over(self, items: u32) -> Step<'a> {
        self.run(Groups::Fixed(items.div_ceil(Self::KERNEL.threads)))
    }

    /// Of exactly `groups` workgroups.
    fn groups(self, groups: u32) -> Step<'a> {
        self.run(Groups::Fixed(groups))
    }

    /// Of as many workgroups as an earlier kernel wrote.
    fn indirect(self, args: &'a Buffer<u32>, entry: u32) -> Step<'a> {
        self.run(Groups::Indirect(args, entry))
    }
}

impl<'a, B: Bindings<'a, OnDevice>> Launch<'a> for B {}

/// How long a run took, measured on the device where it has timestamps.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// From the first kernel's start to the last one's end, transfers excluded.
    pub total: Duration,
    /// Time of each step, in order; empty unless profiling was asked for.
    pub steps: Vec<Duration>,
    /// Bytes that each step read and wrote in buffers: on the CPU, with the feature `traffic`, if profiling
    /// was asked for.
    pub moved: Vec<u64>,
}

/// The most that one buffer may hold, and why.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BufferLimit {
    /// Bytes.
    pub bytes: u64,
    /// Name of the limit, for messages.
    pub name: &'static str,
}

impl Device {
    fn on(machine: Machine) -> Self {
        Self {
            machine: Arc::new(machine),
            #[cfg(feature = "gpu")]
            notes: None,
            pool: None,
        }
    }

    /// The same device, which keeps the memory of scenes built with it for the next ones: for meshes that change, and
    /// are built again and again. [`Scene::rebuild`](crate::Scene::rebuild) does this by itself.
    ///
    /// What a build needs only while it runs is free for the next one, and so is what a scene takes as soon as its last
    /// clone is dropped. Keep the old scene until the new one is built, and tracing goes on: from the third build on
    /// nothing is allocated, as long as the mesh does not grow by more than an eighth. Commands that
    /// [`Scene::encode`](crate::Scene::encode) made are to be submitted before their scene is dropped.
    ///
    /// A mesh of as many triangles as the one before is expected to be much like it. If it lies on the device, the host
    /// waits once for the whole build. A mesh that turns out otherwise takes a little longer; its scene is the same.
    ///
    /// All that is kept is given back with the last clone of what this returns, and the last scene that was built with
    /// it.
    #[must_use]
    pub fn recycling(&self) -> Self {
        let pool = Some(Arc::default());
        match &*self.machine {
            Machine::Cpu(_) => Self { pool, ..self.clone() },
            #[cfg(feature = "gpu")]
            Machine::Gpu(_) => Self { pool, ..self.expecting() },
        }
    }

    /// The same device, which keeps no memory: for rays, as batches are of any size.
    pub(crate) fn keeping_nothing(&self) -> Self {
        Self { pool: None, ..self.clone() }
    }

    /// For tests: the same device, on which builds expect a mesh like the one before, as those of [`Self::recycling`]
    /// do, but no memory is kept.
    #[cfg(feature = "gpu")]
    #[doc(hidden)]
    #[must_use]
    pub fn expecting(&self) -> Self {
        Self { notes: Some(Arc::default()), ..self.clone() }
    }

    /// The processor, with all its threads.
    pub fn cpu() -> Self {
        Cpu::default().into()
    }

    /// The processor, with threads of this device's own.
    ///
    /// # Errors
    /// They could not be started.
    pub fn cpu_with_threads(threads: usize) -> Result<Self, Error> {
        Cpu::with_threads(threads).map(Into::into)
    }

    /// The best Vulkan adapter, or the best whose name contains `adapter` (any case). `gpu:1` takes one by its number
    /// in [`adapters`](crate::adapters), which tells those of one name apart. It may be a software driver, which
    /// [`Device::best`] never takes. With `RAYKD_ALLOW_INEXACT=1` in the environment an adapter that is named is taken
    /// though it rounds differently: then bytes may differ from the CPU's.
    ///
    /// # Errors
    /// No adapter, or one that does not compute our float operations exactly.
    #[cfg(feature = "gpu")]
    pub fn gpu(adapter: Option<&str>) -> Result<Self, Error> {
        Gpu::open(adapter).map(Into::into)
    }

    /// A device of a wgpu program, by which scenes use the program's own device and queue.
    ///
    /// The device must have [`required_features`] and [`required_limits`]. Its callbacks are left as they are, so a
    /// device that is lost shows when something is read back.
    ///
    /// ```no_run
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let adapter: raykd::wgpu::Adapter = todo!();
    /// use raykd::wgpu;
    ///
    /// let request = adapter.request_device(&wgpu::DeviceDescriptor {
    ///     required_features: raykd::required_features(),
    ///     required_limits: raykd::required_limits(adapter.limits()),
    ///     // SAFETY: raykd's kernels keep to their buffers.
    ///     experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
    ///     ..Default::default()
    /// });
    /// let (device, queue) = pollster::block_on(request)?;
    /// let device = raykd::Device::from_wgpu(&device, &queue)?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// It lacks a feature or limit ([`Error::Lacking`] says which), or does not compute our float operations exactly.
    #[cfg(feature = "gpu")]
    pub fn from_wgpu(device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Self, Error> {
        Gpu::given(device.clone(), queue.clone()).map(Into::into)
    }

    /// The device and queue of wgpu that a GPU is used by.
    #[cfg(feature = "gpu")]
    pub fn wgpu(&self) -> Option<(&wgpu::Device, &wgpu::Queue)> {
        self.as_gpu().map(Gpu::parts)
    }

    /// A real GPU if there is one that computes exactly, else the CPU.
    pub fn best() -> Self {
        #[cfg(feature = "gpu")]
        if let Ok(gpu) = Gpu::open_hardware() {
            return gpu.into();
        }
        Self::cpu()
    }

    /// The GPU, if it is one.
    #[cfg(feature = "gpu")]
    #[doc(hidden)]
    pub fn as_gpu(&self) -> Option<&Gpu> {
        match &*self.machine {
            Machine::Cpu(_) => None,
            Machine::Gpu(gpu) => Some(gpu),
        }
    }

    /// Whether this is the processor.
    pub(crate) fn is_cpu(&self) -> bool {
        matches!(&*self.machine, Machine::Cpu(_))
    }

    /// Whether this is a graphics card, and not the CPU, or a GPU that the CPU plays.
    #[doc(hidden)]
    pub fn is_card(&self) -> bool {
        match &*self.machine {
            Machine::Cpu(_) => false,
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => !gpu.is_software(),
        }
    }

    /// How many lanes few rays may be spread over: what a small card holds at once. Lanes that the CPU plays cost as
    /// much when idle: as many as tests need, of a CPU only where it is watched.
    pub(crate) fn spare_lanes(&self) -> u32 {
        if self.is_card() {
            1 << 15
        } else if !self.is_cpu() || watch::is_on() {
            128
        } else {
            0
        }
    }

    /// Runs work of the host with the device's threads; a GPU has those of the machine.
    pub(crate) fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &*self.machine {
            Machine::Cpu(cpu) => cpu.install(work),
            #[cfg(feature = "gpu")]
            Machine::Gpu(_) => work(),
        }
    }

    /// What runs the kernels. A GPU may be a software driver.
    pub fn kind(&self) -> DeviceKind {
        match &*self.machine {
            Machine::Cpu(_) => DeviceKind::Cpu,
            #[cfg(feature = "gpu")]
            Machine::Gpu(_) => DeviceKind::Gpu,
        }
    }

    /// Name of the adapter or the processor, with its driver or thread count.
    pub fn name(&self) -> &str {
        match &*self.machine {
            Machine::Cpu(cpu) => cpu.name(),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.name(),
        }
    }

    /// The most one buffer may hold.
    pub fn limit(&self) -> BufferLimit {
        match &*self.machine {
            Machine::Cpu(cpu) => cpu.limit(),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.limit(),
        }
    }

    /// A zeroed buffer of `count` elements at least: its size is a multiple of 16 bytes, and not 0.
    ///
    /// # Errors
    /// The size is past the device's limit, or memory ran out.
    #[doc(hidden)]
    pub fn alloc<T>(&self, name: &'static str, count: u64) -> Result<Buffer<T>, Error> {
        let bytes = self.rounded::<T>(name, count)?;
        let memory = match &*self.machine {
            Machine::Cpu(cpu) => Memory::Cpu(cpu.alloc(name, bytes)?),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => Memory::Gpu(gpu.alloc(name, bytes)?),
        };
        let buffer = AnyBuffer::of(name, bytes, memory).view();
        watch::poison(self, &buffer)?;
        Ok(buffer)
    }

    /// Bytes of a buffer of `count` elements.
    fn rounded<T>(&self, name: &'static str, count: u64) -> Result<u64, Error> {
        let limit = self.limit();
        let bytes = count.saturating_mul(size_of::<T>() as u64);
        match whole_bytes::<T>(count) {
            rounded if rounded <= limit.bytes => Ok(rounded),
            _ => Err(Error::TooLarge { buffer: name, bytes, limit: limit.bytes, limit_name: limit.name }),
        }
    }

    /// A buffer of `count` elements of a file, from the byte `begin` on. On the CPU it is that part of the file, and
    /// who writes it panics.
    pub(crate) fn share<T: bytemuck::Pod>(
        &self,
        name: &'static str,
        file: &pages::FileBytes,
        begin: usize,
        count: usize,
    ) -> Result<Buffer<T>, Error> {
        let bytes = self.rounded::<T>(name, count as u64)?;
        let part = cpu::Memory::part_of(file, begin, bytes as usize);
        match &*self.machine {
            Machine::Cpu(_) => Ok(AnyBuffer::of(name, bytes, Memory::Cpu(part)).view()),
            #[cfg(feature = "gpu")]
            Machine::Gpu(_) => self.put(name, &part.keep(name, bytes).slice()[..count]),
        }
    }

    /// A buffer of `count` elements at least, for work that writes them before it reads them: their values may be
    /// anything.
    pub(crate) fn room<T>(&self, name: &'static str, count: u64) -> Result<Buffer<T>, Error> {
        if let Some(pool) = &self.pool {
            let bytes = whole_bytes::<T>(count);
            if let Some(found) = pool.take(name, bytes) {
                watch::poison(self, &found)?;
                return Ok(found.view());
            }
            let more = pool::with_room_to_grow(bytes).min(self.limit().bytes / 16 * 16).max(bytes);
            let mut buffer = self.alloc::<u8>(name, more)?.any;
            pool.keep(buffer.clone());
            buffer.bytes = bytes;
            return Ok(buffer.view());
        }
        self.alloc(name, count)
    }

    /// A buffer of these elements, in [`Self::room`].
    pub(crate) fn put<T: bytemuck::Pod>(&self, name: &'static str, data: &[T]) -> Result<Buffer<T>, Error> {
        let buffer = self.room(name, data.len() as u64)?;
        self.write(&buffer, 0, data)?;
        Ok(buffer)
    }

    /// A buffer of these elements.
    ///
    /// # Errors
    /// As for [`Self::alloc`] and [`Self::write`].
    #[doc(hidden)]
    pub fn upload<T: bytemuck::Pod>(&self, name: &'static str, data: &[T]) -> Result<Buffer<T>, Error> {
        let buffer = self.alloc(name, data.len() as u64)?;
        self.write(&buffer, 0, data)?;
        Ok(buffer)
    }

    /// Writes elements from the one numbered `from` on. Where they begin and how long they are is a multiple
    /// of 4 bytes.
    ///
    /// # Errors
    /// The device was lost, or ran out of memory.
    ///
    /// # Panics
    /// The range lies outside the buffer, the buffer is another device's, or it is in use by another thread.
    #[doc(hidden)]
    pub fn write<T: bytemuck::Pod>(&self, buffer: &Buffer<T>, from: u64, data: &[T]) -> Result<(), Error> {
        let offset = buffer.place("write", size_of::<T>(), from, data.len());
        let data: &[u8] = bytemuck::cast_slice(data);
        match (&*self.machine, &buffer.memory) {
            (Machine::Cpu(_), Memory::Cpu(memory)) => {
                memory.write(buffer.name, offset, data);
                Ok(())
            }
            #[cfg(feature = "gpu")]
            (Machine::Gpu(gpu), Memory::Gpu(memory)) => gpu.write(memory, offset, data),
            #[cfg(feature = "gpu")]
            _ => panic!("buffer {} belongs to another device", buffer.name),
        }
    }

    /// Reads `count` elements from the one numbered `from` on. Where they begin and how long they are is a
    /// multiple of 4 bytes.
    ///
    /// # Errors
    /// The device was lost, or ran out of memory.
    ///
    /// # Panics
    /// The range lies outside the buffer, the buffer is another device's, or another thread writes it.
    #[doc(hidden)]
    pub fn read<T: bytemuck::Pod>(
        &self,
        buffer: &Buffer<T>,
        from: u64,
        count: usize,
    ) -> Result<Vec<T>, Error> {
        buffer.place("read", size_of::<T>(), from, count);
        let mut out = zeroed_vec(count);
        self.read_into(buffer, from, &mut out)?;
        Ok(out)
    }

    /// Reads as many elements as there is room for, from element `from` on.
    ///
    /// # Errors
    /// The device failed.
    ///
    /// # Panics
    /// As [`Self::read`].
    #[doc(hidden)]
    pub fn read_into<T: bytemuck::Pod>(
        &self,
        buffer: &Buffer<T>,
        from: u64,
        out: &mut [T],
    ) -> Result<(), Error> {
        self.fetch(&mut buffer.back_from(from, out))
    }

    fn fetch(&self, back: &mut Back<'_>) -> Result<(), Error> {
        match &*self.machine {
            Machine::Cpu(_) => {
                let Back { buffer, offset, bytes, take } = back;
                let kept = cpu::memory(buffer).keep(buffer.name, buffer.bytes);
                // By the thread that asks: the device's threads need not be rayon's.
                kept.slice()[*offset as usize..][..*bytes].chunks(PIECE).for_each(take);
                Ok(())
            }
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.fetch(back),
        }
    }

    /// A buffer's elements on the CPU, as they are from now on: where the device is the CPU they are not copied, and
    /// who writes the buffer panics.
    pub(crate) fn kept(&self, buffer: &AnyBuffer) -> Result<cpu::Kept, Error> {
        match &buffer.memory {
            Memory::Cpu(memory) => Ok(memory.keep(buffer.name, buffer.bytes)),
            #[cfg(feature = "gpu")]
            Memory::Gpu(_) => {
                let words: Buffer<u32> = buffer.view();
                let cpu = Self::cpu();
                let copy = cpu.upload(buffer.name, &self.read(&words, 0, words.elements())?)?;
                cpu.kept(&copy)
            }
        }
    }

    /// Runs the steps in order, each seeing all that the ones before it wrote, and waits for the end.
    /// With `profile`, times every step too.
    ///
    /// # Errors
    /// The device refused a kernel, was lost, or ran out of memory.
    ///
    /// # Safety
    /// Each buffer holds what the kernel expects there, as the steps of this crate leave it. A kernel trusts
    /// its input to keep its workgroups apart: offsets that overlap would have two of them write one word.
    #[doc(hidden)]
    pub unsafe fn run(&self, steps: &[Step<'_>], profile: bool) -> Result<Timing, Error> {
        self.dispatch(steps, profile)
    }

    /// [`Self::dispatch`], but the end is not waited for: what is run or read next sees it.
    pub(crate) fn begin(&self, steps: &[Step<'_>]) -> Result<(), Error> {
        #[cfg(feature = "gpu")]
        if let (Machine::Gpu(gpu), false) = (&*self.machine, watch::is_on()) {
            return gpu.begin(steps);
        }
        self.dispatch(steps, false).map(|_| ())
    }

    /// [`Self::run`], for the steps of this crate.
    pub(crate) fn dispatch(&self, steps: &[Step<'_>], profile: bool) -> Result<Timing, Error> {
        self.dispatch_then(steps, profile, &mut [])
    }

    /// What the last build noted, if notes are kept.
    pub(crate) fn past(&self) -> Option<Past> {
        #[cfg(feature = "gpu")]
        return *self.notes.as_ref()?.lock().unwrap_or_else(PoisonError::into_inner);
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// Notes something for the next build, or nothing, if notes are kept.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "without a GPU none are"))]
    pub(crate) fn note(&self, past: Option<Past>) {
        #[cfg(feature = "gpu")]
        if let Some(notes) = &self.notes {
            *notes.lock().unwrap_or_else(PoisonError::into_inner) = past;
        }
    }

    /// Whether memory is kept for what is built next.
    pub(crate) fn recycles(&self) -> bool {
        self.pool.is_some()
    }

    /// [`Self::dispatch`], then [`Self::read`] of one element from the start of a buffer, for which the host waits
    /// once.
    pub(crate) fn dispatch_and_read<T: bytemuck::Pod>(
        &self,
        steps: &[Step<'_>],
        profile: bool,
        buffer: &Buffer<T>,
    ) -> Result<(Timing, T), Error> {
        let mut out = [T::zeroed()];
        let timing = self.dispatch_then(steps, profile, &mut [buffer.back_from(0, &mut out)])?;
        Ok((timing, out[0]))
    }

    /// [`Self::dispatch`], then [`Self::read`] from the starts of some buffers, for which the host waits once if it is
    /// not too much.
    pub(crate) fn dispatch_then(
        &self,
        steps: &[Step<'_>],
        profile: bool,
        back: &mut [Back<'_>],
    ) -> Result<Timing, Error> {
        for step in steps {
            assert_eq!(step.buffers.len(), step.kernel.slots.len(), "buffers of {}", step.kernel.name());
        }
        if steps.len() > 1 && watch::is_on() {
            let timing = watch::one_by_one(self, steps)?;
            return self.dispatch_then(&[], profile, back).map(|_| timing);
        }
        let timing = match &*self.machine {
            Machine::Cpu(cpu) => {
                let timing = cpu.run(steps, profile);
                back.iter_mut().try_for_each(|back| self.fetch(back)).map(|()| timing)
            }
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.run(steps, profile, self.pool.is_some(), back),
        };
        watch::tell(self, steps)?;
        timing
    }
}
