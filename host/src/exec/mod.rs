//! Running kernels: buffers and dispatches on the CPU and on the GPU behind one surface.

pub(crate) mod cpu;
#[cfg(feature = "gpu")]
mod gpu;
#[doc(hidden)]
pub mod watch;

pub use cpu::Cpu;
#[cfg(feature = "gpu")]
pub(crate) use gpu::Size;
#[cfg(feature = "gpu")]
pub use gpu::{AdapterReport, Gpu, Verdict, adapters, required_features, required_limits};

use crate::Error;
use raykd_kernels::Kernel;
use std::{sync::Arc, time::Duration};

/// A machine that kernels run on: the processor, by rayon, or a Vulkan device, by wgpu. Clones are the same machine.
#[derive(Clone, Debug)]
pub struct Device(Arc<Machine>);

#[derive(Debug)]
enum Machine {
    Cpu(Cpu),
    #[cfg(feature = "gpu")]
    Gpu(Box<Gpu>),
}

impl From<Cpu> for Device {
    fn from(cpu: Cpu) -> Self {
        Self(Arc::new(Machine::Cpu(cpu)))
    }
}

#[cfg(feature = "gpu")]
impl From<Gpu> for Device {
    fn from(gpu: Gpu) -> Self {
        Self(Arc::new(Machine::Gpu(Box::new(gpu))))
    }
}

/// A buffer on a [`Device`]. Clones share the memory.
#[derive(Clone, Debug)]
pub struct Buffer {
    name: &'static str,
    bytes: u64,
    memory: Memory,
}

#[derive(Clone, Debug)]
enum Memory {
    Cpu(cpu::Memory),
    #[cfg(feature = "gpu")]
    Gpu(wgpu::Buffer),
}

impl Buffer {
    /// The name it was allocated under.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// Its size in bytes.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Panics if a range does not lie inside; `bytes` is None if its length is beyond all numbers.
    fn check(&self, act: &str, offset: u64, bytes: Option<usize>) {
        let end = bytes.and_then(|bytes| offset.checked_add(bytes as u64));
        assert!(end.is_some_and(|end| end <= self.bytes), "{act} past the end of {}", self.name);
    }
}

/// How many workgroups a step runs.
#[derive(Clone, Debug)]
pub enum Groups<'a> {
    /// This many.
    Fixed(u32),
    /// As many as an earlier kernel wrote: three words `[x, y, z]` at word `3 * entry` of the buffer, for a
    /// dispatch of `x * y * z` workgroups. The step itself must not write that buffer.
    Indirect(&'a Buffer, u32),
}

/// One dispatch: a kernel, its buffers in binding order, and how many workgroups.
#[derive(Clone, Debug)]
pub struct Step<'a> {
    /// What runs.
    pub kernel: &'static Kernel,
    /// On which buffers; as many as the kernel has slots.
    pub buffers: Vec<&'a Buffer>,
    /// How often.
    pub groups: Groups<'a>,
}

impl<'a> Step<'a> {
    /// A step of as many workgroups as cover `items` lanes.
    pub fn over(kernel: &'static Kernel, items: u32, buffers: Vec<&'a Buffer>) -> Self {
        Self { kernel, buffers, groups: Groups::Fixed(items.div_ceil(kernel.threads)) }
    }

    /// A step of exactly `groups` workgroups.
    pub fn groups(kernel: &'static Kernel, groups: u32, buffers: Vec<&'a Buffer>) -> Self {
        Self { kernel, buffers, groups: Groups::Fixed(groups) }
    }

    /// A step whose size an earlier kernel wrote.
    pub fn indirect(kernel: &'static Kernel, args: &'a Buffer, entry: u32, buffers: Vec<&'a Buffer>) -> Self {
        Self { kernel, buffers, groups: Groups::Indirect(args, entry) }
    }
}

/// How long a run took, measured on the device where it has timestamps.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// From the first kernel's start to the last one's end, transfers excluded.
    pub total: Duration,
    /// Time of each step, in order; empty unless profiling was asked for.
    pub steps: Vec<Duration>,
    /// Bytes that each step read and wrote in buffers: on the CPU, with the feature `traffic`, if profiling was asked for.
    pub moved: Vec<u64>,
}

/// The most that one buffer may hold, and why.
#[derive(Clone, Debug)]
pub struct Limit {
    /// Bytes.
    pub bytes: u64,
    /// Name of the limit, for messages.
    pub name: &'static str,
}

impl Device {
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

    /// The best Vulkan adapter, or the best whose name contains `adapter` (any case).
    ///
    /// # Errors
    /// No adapter, or one that does not compute our float operations exactly.
    #[cfg(feature = "gpu")]
    pub fn gpu(adapter: Option<&str>) -> Result<Self, Error> {
        Gpu::open(adapter).map(Into::into)
    }

    /// A device of a wgpu program, by which scenes use the program's own device and queue.
    ///
    /// The device must have [`required_features`] and [`required_limits`]. Its callbacks are left as they are, so a device
    /// that is lost shows when something is read back.
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
    /// It lacks a feature or limit, or does not compute our float operations exactly.
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
        match &*self.0 {
            Machine::Cpu(_) => None,
            Machine::Gpu(gpu) => Some(gpu),
        }
    }

    /// Whether this is the processor.
    pub(crate) fn is_cpu(&self) -> bool {
        matches!(&*self.0, Machine::Cpu(_))
    }

    /// Whether this is a graphics card, and not the CPU, or a GPU that the CPU plays.
    #[doc(hidden)]
    pub fn is_card(&self) -> bool {
        match &*self.0 {
            Machine::Cpu(_) => false,
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => !gpu.is_software(),
        }
    }

    /// Runs work of the host with the device's threads; a GPU has those of the machine.
    pub(crate) fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &*self.0 {
            Machine::Cpu(cpu) => cpu.install(work),
            #[cfg(feature = "gpu")]
            Machine::Gpu(_) => work(),
        }
    }

    /// `cpu` or `gpu`.
    pub fn kind(&self) -> &'static str {
        match &*self.0 {
            Machine::Cpu(_) => "cpu",
            #[cfg(feature = "gpu")]
            Machine::Gpu(_) => "gpu",
        }
    }

    /// Name of the adapter or the processor, with its driver or thread count.
    pub fn name(&self) -> &str {
        match &*self.0 {
            Machine::Cpu(cpu) => cpu.name(),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.name(),
        }
    }

    /// The most one buffer may hold.
    pub fn limit(&self) -> Limit {
        match &*self.0 {
            Machine::Cpu(cpu) => cpu.limit(),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.limit(),
        }
    }

    /// A zeroed buffer of at least `bytes` bytes (at least 16, rounded up to a multiple of 16).
    ///
    /// # Errors
    /// The size is past the device's limit, or memory ran out.
    #[doc(hidden)]
    pub fn alloc(&self, name: &'static str, bytes: u64) -> Result<Buffer, Error> {
        let limit = self.limit();
        let rounded = bytes.max(16).checked_next_multiple_of(16).filter(|&rounded| rounded <= limit.bytes);
        let Some(bytes) = rounded else {
            return Err(Error::TooLarge { buffer: name, bytes, limit: limit.bytes, limit_name: limit.name });
        };
        let memory = match &*self.0 {
            Machine::Cpu(cpu) => Memory::Cpu(cpu.alloc(name, bytes)?),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => Memory::Gpu(gpu.alloc(name, bytes)?),
        };
        let buffer = Buffer { name, bytes, memory };
        watch::poison(self, &buffer)?;
        Ok(buffer)
    }

    /// Writes `data` (length a multiple of 4) at byte `offset` (a multiple of 4).
    ///
    /// # Errors
    /// The device was lost, or ran out of memory.
    ///
    /// # Panics
    /// The range lies outside the buffer, the buffer is another device's, or it is in use by another thread.
    #[doc(hidden)]
    pub fn write(&self, buffer: &Buffer, offset: u64, data: &[u8]) -> Result<(), Error> {
        buffer.check("write", offset, Some(data.len()));
        match (&*self.0, &buffer.memory) {
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

    /// Reads `bytes` bytes (a multiple of 4) from byte `offset` (a multiple of 4) into a vector of words.
    ///
    /// # Errors
    /// The device was lost, or ran out of memory.
    ///
    /// # Panics
    /// The range lies outside the buffer, the buffer is another device's, or another thread writes it.
    #[doc(hidden)]
    pub fn read<T: bytemuck::Pod>(
        &self,
        buffer: &Buffer,
        offset: u64,
        count: usize,
    ) -> Result<Vec<T>, Error> {
        buffer.check("read", offset, count.checked_mul(size_of::<T>()));
        let mut out = vec![T::zeroed(); count];
        if count > 0 {
            let target: &mut [u8] = bytemuck::cast_slice_mut(&mut out);
            match (&*self.0, &buffer.memory) {
                (Machine::Cpu(_), Memory::Cpu(memory)) => memory.read(buffer.name, offset, target),
                #[cfg(feature = "gpu")]
                (Machine::Gpu(gpu), Memory::Gpu(memory)) => gpu.read(memory, offset, target)?,
                #[cfg(feature = "gpu")]
                _ => panic!("buffer {} belongs to another device", buffer.name),
            }
        }
        Ok(out)
    }

    /// A buffer's elements on the CPU, as they are from now on: where the device is the CPU they are not copied, and who
    /// writes the buffer panics.
    pub(crate) fn kept(&self, buffer: &Buffer) -> Result<cpu::Kept, Error> {
        match &buffer.memory {
            Memory::Cpu(memory) => Ok(memory.keep(buffer.name)),
            #[cfg(feature = "gpu")]
            Memory::Gpu(_) => {
                let words: Vec<u32> = self.read(buffer, 0, (buffer.bytes / 4) as usize)?;
                let (cpu, bytes) = (Self::cpu(), bytemuck::cast_slice(&words));
                let copy = cpu.alloc(buffer.name, buffer.bytes)?;
                cpu.write(&copy, 0, bytes)?;
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
    /// Each buffer holds what the kernel expects there, as the steps of this crate leave it. A kernel trusts its input to
    /// keep its workgroups apart: offsets that overlap would have two of them write one word.
    #[doc(hidden)]
    pub unsafe fn run(&self, steps: &[Step<'_>], profile: bool) -> Result<Timing, Error> {
        self.dispatch(steps, profile)
    }

    /// [`Self::run`], for the steps of this crate.
    pub(crate) fn dispatch(&self, steps: &[Step<'_>], profile: bool) -> Result<Timing, Error> {
        for step in steps {
            assert_eq!(step.buffers.len(), step.kernel.slots.len(), "buffers of {}", step.kernel.name());
        }
        if steps.len() > 1 && watch::is_on() {
            return watch::one_by_one(self, steps);
        }
        let timing = match &*self.0 {
            Machine::Cpu(cpu) => Ok(cpu.run(steps, profile)),
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => gpu.run(steps, profile),
        };
        watch::tell(self, steps);
        timing
    }
}
