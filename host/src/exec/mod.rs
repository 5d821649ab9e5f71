//! Running kernels: the CPU and the GPU behind one surface.

mod buffer;
pub(crate) mod cpu;
#[cfg(feature = "gpu")]
mod gpu;
pub(crate) mod pages;
mod pool;
mod step;
#[doc(hidden)]
pub mod watch;

pub use buffer::{AnyBuffer, Buffer, OnDevice, Out, reserve};
pub(crate) use buffer::{Back, To};
pub use cpu::Cpu;
#[cfg(feature = "gpu")]
pub(crate) use gpu::Size;
#[cfg(feature = "gpu")]
pub use gpu::{AdapterReport, AdapterVerdict, Gpu, adapters, required_features, required_limits};
pub(crate) use step::Timed;
pub use step::{Groups, Launch, Step, Timing};

use crate::Error;
use buffer::{PIECE, whole_bytes};
use bytemuck::allocation::zeroed_vec;
use std::{fmt, sync::Arc};
#[cfg(feature = "gpu")]
use {crate::lock::lock, std::sync::Mutex};

/// A machine that kernels run on: the processor, by rayon, or a Vulkan device, by wgpu. Clones are the same machine.
///
/// It keeps the memory of small batches of rays for the next ones: 2 MiB, and as much for each thread that traces at
/// the same time. One that moves more to or from a GPU leaves up to 64 MiB of the host's memory there, for the next.
#[derive(Clone, Debug)]
pub struct Device {
    machine: Arc<Machine>,
    /// What the last build noted, if the next one is to expect a mesh like it.
    #[cfg(feature = "gpu")]
    notes: Option<Arc<Mutex<Option<Past>>>>,
    /// Whether the exact test computes with doubles, if that is asked for.
    #[cfg(feature = "gpu")]
    doubles: Option<bool>,
    /// Where the memory of scenes goes and comes from, if it is used again.
    pool: Option<Arc<pool::Pool>>,
    /// The same for small batches of rays.
    few_rays: Arc<pool::Pool>,
}

/// Hits of a batch whose memory is kept, at most: with their rays 2 MiB.
const FEW_RAYS: usize = 1 << 15;

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

/// What a buffer has of a machine.
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

/// What a build notes for the next one: words that only builds understand.
pub(crate) type Past = [u32; 10];

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
            #[cfg(feature = "gpu")]
            doubles: None,
            pool: None,
            few_rays: Arc::default(),
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

    /// The same device, which keeps no memory: for what may be of any size.
    pub(crate) fn keeping_nothing(&self) -> Self {
        Self { pool: None, ..self.clone() }
    }

    /// The same device for a batch of rays with so many hits: it keeps the memory of small ones, for the next small
    /// batch of whatever scene.
    pub(crate) fn for_rays(&self, hits: usize) -> Self {
        Self { pool: (hits <= FEW_RAYS).then(|| self.few_rays.clone()), ..self.clone() }
    }

    /// For tests: the same device, on which builds expect a mesh like the one before, as those of [`Self::recycling`]
    /// do, but no memory is kept.
    #[cfg(feature = "gpu")]
    #[doc(hidden)]
    #[must_use]
    pub fn expecting(&self) -> Self {
        Self { notes: Some(Arc::default()), ..self.clone() }
    }

    /// For tests: the same device, on which the exact test computes with doubles, or does not. None if it has none, or
    /// computes them otherwise than a CPU.
    #[cfg(feature = "gpu")]
    #[doc(hidden)]
    #[must_use]
    pub fn with_doubles(&self, doubles: bool) -> Option<Self> {
        let there = |gpu: &Gpu| gpu.judge_doubles(&self.keeping_nothing()).0;
        (!doubles || self.as_gpu().is_none_or(there)).then(|| Self { doubles: Some(doubles), ..self.clone() })
    }

    /// Whether the exact test computes with doubles on a GPU, or where the CPU does what a GPU does. Asked first, a GPU
    /// is probed.
    #[cfg(feature = "gpu")]
    #[doc(hidden)]
    pub fn by_doubles(&self) -> bool {
        let quick = |gpu: &Gpu| gpu.judge_doubles(&self.keeping_nothing()).1;
        self.doubles.unwrap_or_else(|| self.as_gpu().is_some_and(quick))
    }

    /// The processor, with all its threads.
    pub fn cpu() -> Self {
        Cpu::default().into()
    }

    /// The processor, with so many threads of this device's own, at least one.
    ///
    /// # Errors
    /// They are more than 1024 and more than the machine runs at once, or could not be started.
    pub fn cpu_with_threads(threads: usize) -> Result<Self, Error> {
        Cpu::with_threads(threads).map(Into::into)
    }

    /// The best Vulkan adapter, or the best whose name contains `adapter` (any case). `gpu:1` takes one by its number
    /// in [`adapters`](crate::adapters), which tells those of one name apart. It may be a software driver, which
    /// [`Device::best`] never takes. With `RAYKD_ALLOW_INEXACT=1` in the environment an adapter that is named is taken
    /// though it rounds differently: then bytes may differ from the CPU's.
    ///
    /// # Errors
    /// There is no such adapter ([`Error::NoAdapter`]), it lacks a feature or limit ([`Error::Lacking`]), or it does
    /// not compute float operations as the CPU does ([`Error::Inexact`]).
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
    /// It lacks a feature or limit ([`Error::Lacking`]), or does not compute float operations as the CPU does
    /// ([`Error::Inexact`]).
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

    /// How many threads trace rays side by side, if any do.
    pub(crate) fn side_by_side(&self) -> Option<usize> {
        match &*self.machine {
            Machine::Cpu(cpu) if cfg!(target_arch = "x86_64") && cpu::usual().has() => Some(cpu.threads()),
            _ => None,
        }
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
        self.alloc_of(name, count, size_of::<T>()).map(AnyBuffer::into_typed)
    }

    /// [`Self::alloc`] of elements of so many bytes, compiled once.
    fn alloc_of(&self, name: &'static str, count: u64, element: usize) -> Result<AnyBuffer, Error> {
        let bytes = self.rounded(name, count, element)?;
        let memory = match &*self.machine {
            Machine::Cpu(cpu) => Memory::Cpu(cpu.alloc(name, bytes)?),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => Memory::Gpu(gpu.alloc(name, bytes)?),
        };
        let buffer = AnyBuffer::of(name, bytes, memory);
        watch::poison(self, &buffer)?;
        Ok(buffer)
    }

    /// Bytes of a buffer of `count` elements of so many bytes.
    fn rounded(&self, name: &'static str, count: u64, element: usize) -> Result<u64, Error> {
        let limit = self.limit();
        let bytes = count.saturating_mul(element as u64);
        match whole_bytes(count, element) {
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
        let bytes = self.rounded(name, count as u64, size_of::<T>())?;
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
        self.room_of(name, count, size_of::<T>()).map(AnyBuffer::into_typed)
    }

    /// [`Self::room`] for elements of so many bytes, compiled once.
    fn room_of(&self, name: &'static str, count: u64, element: usize) -> Result<AnyBuffer, Error> {
        let Some(pool) = &self.pool else { return self.alloc_of(name, count, element) };
        let bytes = whole_bytes(count, element);
        if let Some(found) = pool.take(name, bytes) {
            watch::poison(self, &found)?;
            return Ok(found);
        }
        let more = pool::with_room_to_grow(bytes).min(self.limit().bytes / 16 * 16).max(bytes);
        let mut buffer = self.alloc_of(name, more, 1)?;
        pool.keep(buffer.clone());
        buffer.bytes = bytes;
        Ok(buffer)
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
        self.dispatch_then(steps, Timed::profiled(profile), &mut [])
    }

    /// What the last build noted, if notes are kept.
    pub(crate) fn past(&self) -> Option<Past> {
        #[cfg(feature = "gpu")]
        return *lock(self.notes.as_ref()?);
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// Notes something for the next build, or nothing, if notes are kept.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "without a GPU none are"))]
    pub(crate) fn note(&self, past: Option<Past>) {
        #[cfg(feature = "gpu")]
        if let Some(notes) = &self.notes {
            *lock(notes) = past;
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
        let timed = Timed::profiled(profile);
        let timing = self.dispatch_then(steps, timed, &mut [buffer.back_from(0, &mut out)])?;
        Ok((timing, out[0]))
    }

    /// [`Self::dispatch`], then [`Self::read`] from the starts of some buffers, for which the host waits once if it is
    /// not too much.
    pub(crate) fn dispatch_then(
        &self,
        steps: &[Step<'_>],
        timed: Timed,
        back: &mut [Back<'_>],
    ) -> Result<Timing, Error> {
        for step in steps {
            assert_eq!(step.buffers.len(), step.kernel.slots.len(), "buffers of {}", step.kernel.name());
        }
        if steps.len() > 1 && watch::is_on() {
            let timing = watch::one_by_one(self, steps)?;
            return self.dispatch_then(&[], timed, back).map(|_| timing);
        }
        let timing = match &*self.machine {
            Machine::Cpu(cpu) => {
                let timing = cpu.run(steps, timed == Timed::Steps);
                back.iter_mut().try_for_each(|back| self.fetch(back)).map(|()| timing)
            }
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.run(steps, timed, self.pool.is_some(), back),
        };
        watch::tell(self, steps)?;
        timing
    }
}
