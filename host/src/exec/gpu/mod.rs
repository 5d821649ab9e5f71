//! The GPU executor: kernels as SPIR-V on Vulkan devices, by wgpu.

mod adapter;
mod clock;
mod encode;
mod link;
mod module;
mod probe;
mod staging;

pub use adapter::{AdapterReport, adapters, required_features, required_limits};
pub(crate) use encode::Size;
pub use probe::AdapterVerdict;

use super::{AnyBuffer, Back, BufferLimit, Device, Groups, Machine, Memory, Step, Timed, Timing, checked};
use crate::{Error, lock::lock};
use clock::Clock;
use link::Link;
use raykd_kernels::{Access, BY_DOUBLES, KERNELS, Kernel, SPIRV, SPIRV_BY_DOUBLES};
use raykd_shared::limits::GROUPS_X;
use rayon::prelude::*;
use staging::{CHUNK, Slot};
use std::{
    collections::{HashMap, HashSet},
    sync::{
        Arc, Mutex, OnceLock,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::Instant,
};

/// Writes of at most this many bytes ride along with the next submission.
const RIDES_ALONG: usize = 1 << 20;

/// After how many steps commands are handed over early: about a level of a build first, so that the device soon begins,
/// and more each time, as the host encodes them while the device works.
const EARLY: [usize; 4] = [8, 24, 48, 96];

/// Ways across the bus.
const TO: usize = 0;
const BACK: usize = 1;

/// A Vulkan device.
#[derive(Debug)]
pub struct Gpu {
    link: Link,
    limit: BufferLimit,
    module: wgpu::ShaderModule,
    /// Names of the kernels in the module.
    entry_points: HashSet<String>,
    /// Whether kernels may count on a product and a sum rounded once.
    rounds_once: bool,
    /// The module of kernels by doubles, once it is wanted, if the device takes it.
    doubles: OnceLock<Option<wgpu::ShaderModule>>,
    /// Whether these are right, and quick, once that is asked.
    judged_doubles: OnceLock<(bool, bool)>,
    pipelines: Mutex<HashMap<&'static str, Pipeline>>,
    /// Staging buffers; taken while in use, and not put back after an error.
    uploads: Kept<[Slot; 2]>,
    downloads: Kept<[Slot; 2]>,
    /// Bytes that went to the device, and that came back.
    crossed: [AtomicU64; 2],
    /// How many buffers were allocated.
    allocated: AtomicU64,
    /// None where the device has no timestamps.
    clock: Option<Kept<Clock>>,
}

/// Tools that nobody uses now.
type Kept<T> = Mutex<Vec<T>>;

/// Tools of a kind that are kept at most: large batches take two, see `by_two`.
const KEPT: usize = 2;

// See the same of `Memory`.
const _: fn(&Gpu) = |gpu| {
    let Gpu {
        link,
        limit,
        module,
        entry_points,
        rounds_once,
        doubles,
        judged_doubles,
        pipelines,
        uploads,
        downloads,
        crossed,
        allocated,
        clock,
    } = gpu;
    checked(link);
    checked(limit);
    checked(module);
    checked(entry_points);
    checked(rounds_once);
    checked(doubles);
    checked(judged_doubles);
    checked(pipelines);
    checked(uploads);
    checked(downloads);
    checked(crossed);
    checked(allocated);
    checked(clock);
};
// SAFETY: what it holds is, as checked above.
unsafe impl Send for Gpu {}
// SAFETY: as above.
unsafe impl Sync for Gpu {}

/// A kernel made ready for the device.
#[derive(Clone, Debug)]
struct Pipeline {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

/// What the steps of one run bind: the levels of a build repeat the same buffers, told apart by where they are
/// while the run borrows them.
type Bindings = HashMap<(&'static str, Vec<*const AnyBuffer>), wgpu::BindGroup>;

impl Gpu {
    /// The best adapter, or the best whose name or driver contains `adapter` (any case).
    ///
    /// # Errors
    /// No such adapter; it cannot run our kernels; or it does not compute our float operations exactly and
    /// `RAYKD_ALLOW_INEXACT=1` is not set.
    pub fn open(adapter: Option<&str>) -> Result<Self, Error> {
        let allowed = std::env::var_os("RAYKD_ALLOW_INEXACT").is_some_and(|value| value == "1");
        Self::accepted(adapter::choose(adapter, false)?, allowed)
    }

    /// The best adapter that is not a CPU.
    ///
    /// # Errors
    /// As for [`Self::open`], except that an inexact device is never taken.
    pub fn open_hardware() -> Result<Self, Error> {
        Self::accepted(adapter::choose(None, true)?, false)
    }

    /// A device and its queue that somebody else opened.
    ///
    /// # Errors
    /// It lacks a feature or limit, or it does not compute our float operations exactly.
    pub fn given(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, Error> {
        let name = adapter::describe(&device.adapter_info());
        if let Some(what) = adapter::missing("the wgpu device", device.features(), device.limits()) {
            let what = format!("{what}; request it with raykd::required_features and raykd::required_limits");
            return Err(Error::Lacking { adapter: name, what });
        }
        Self::exact(Self::over(Link::given(device, queue, name))?, false)
    }

    /// The device and its queue.
    pub(crate) fn parts(&self) -> (&wgpu::Device, &wgpu::Queue) {
        (&self.link.device, &self.link.queue)
    }

    /// Compiles kernels for the device, several at a time, so that no later run has to.
    ///
    /// # Errors
    /// The device refused a kernel or was lost.
    pub fn prepare(&self, kernels: &[&'static Kernel]) -> Result<(), Error> {
        let missing: Vec<_> = {
            let ready = lock(&self.pipelines);
            let mut seen = HashSet::new();
            let new = |k: &&Kernel| !ready.contains_key(k.path) && seen.insert(k.path);
            kernels.iter().copied().filter(new).collect()
        };
        missing.into_par_iter().try_for_each(|kernel| {
            let pipeline = self.compile(kernel)?;
            lock(&self.pipelines).insert(kernel.path, pipeline);
            Ok(())
        })
    }

    /// Opens an adapter and refuses it if it is inexact, unless that is `allowed`.
    fn accepted(adapter: &wgpu::Adapter, allowed: bool) -> Result<Self, Error> {
        Self::exact(Self::on(adapter)?, allowed)
    }

    /// Refuses a device that is inexact, unless that is `allowed`.
    fn exact(self, allowed: bool) -> Result<Self, Error> {
        match self.probed()? {
            (gpu, AdapterVerdict::Inexact(reason)) if !allowed => {
                Err(Error::Inexact { adapter: gpu.link.name, reason })
            }
            (gpu, _) => Ok(gpu),
        }
    }

    /// Opens an adapter.
    fn on(adapter: &wgpu::Adapter) -> Result<Self, Error> {
        let name = adapter::describe(&adapter.get_info());
        if let Some(what) = adapter::lacks(adapter) {
            return Err(Error::Lacking { adapter: name, what });
        }
        Self::over(Link::open(adapter, name, adapter::WANTED)?)
    }

    /// Loads the kernels, as for a device that multiplies and adds with one rounding.
    fn over(link: Link) -> Result<Self, Error> {
        let words = module::words(SPIRV);
        let entry_points = module::entry_points(&words);
        if entry_points.is_empty() {
            return Err(link.failed("there are no compiled kernels: run `cargo xtask kernels`"));
        }
        let module = module::load(&link, module::rounding_once(words), KERNELS)?;
        let limits = link.device.limits();
        let binding = BufferLimit {
            bytes: limits.max_storage_buffer_binding_size,
            name: "the device's max_storage_buffer_binding_size",
        };
        let whole = BufferLimit { bytes: limits.max_buffer_size, name: "the device's max_buffer_size" };
        let timed = link.device.features().contains(Clock::FEATURES);
        Ok(Self {
            limit: if whole.bytes < binding.bytes { whole } else { binding },
            module,
            entry_points,
            rounds_once: true,
            doubles: OnceLock::new(),
            judged_doubles: OnceLock::new(),
            pipelines: Mutex::default(),
            uploads: Mutex::default(),
            downloads: Mutex::default(),
            crossed: Default::default(),
            allocated: AtomicU64::default(),
            clock: timed.then(Mutex::default),
            link,
        })
    }

    /// Runs the start-up probe, and again if kernels must do without a product and a sum rounded once.
    fn probed(self) -> Result<(Self, AdapterVerdict), Error> {
        let (mut gpu, verdict, rests) = self.judged()?;
        if rests {
            return Ok((gpu, verdict));
        }
        gpu.round_twice()?;
        let (gpu, verdict, _) = gpu.judged()?;
        Ok((gpu, verdict))
    }

    /// Loads the kernels as for a device that rounds a product, and then a sum.
    fn round_twice(&mut self) -> Result<(), Error> {
        self.module = module::load(&self.link, module::words(SPIRV), KERNELS)?;
        self.rounds_once = false;
        self.doubles = OnceLock::new();
        self.pipelines = Mutex::default();
        Ok(())
    }

    /// What the probe says of it.
    fn judged(self) -> Result<(Self, AdapterVerdict, bool), Error> {
        let device = Device::from(self);
        let (verdict, rests) = probe::check(&device)?;
        match Arc::into_inner(device.machine) {
            Some(Machine::Gpu(gpu)) => Ok((*gpu, verdict, rests)),
            _ => unreachable!("made above, and nobody keeps a device"),
        }
    }

    /// The kernels by doubles, if it has doubles and takes them.
    fn doubles(&self) -> Option<&wgpu::ShaderModule> {
        let load = || {
            if !self.link.device.features().contains(wgpu::Features::SHADER_F64) {
                return None;
            }
            let words = module::words(SPIRV_BY_DOUBLES);
            let words = if self.rounds_once { module::rounding_once(words) } else { words };
            module::load(&self.link, words, BY_DOUBLES).ok()
        };
        self.doubles.get_or_init(load).as_ref()
    }

    /// Whether it computes doubles right, and whether quickly, as far as its clock tells. Asked once of this `device`,
    /// which is it; a driver that fails at doubles does without them.
    pub(super) fn judge_doubles(&self, device: &Device) -> (bool, bool) {
        if let Some(&judged) = self.judged_doubles.get() {
            return judged;
        }
        // Not within the lock: other threads' work may run here meanwhile.
        let right = self.doubles().is_some() && probe::doubles_are_right(device).unwrap_or(false);
        let quick = right && self.clock.is_some() && probe::doubles_are_quick(device).unwrap_or(false);
        *self.judged_doubles.get_or_init(|| (right, quick))
    }

    /// Whether it is a rasteriser in software, with no GPU behind it.
    pub fn is_software(&self) -> bool {
        self.link.device.adapter_info().device_type == wgpu::DeviceType::Cpu
    }

    /// Bytes that went to the device until now, and bytes that came back: buffers, and timestamps.
    pub fn crossed(&self) -> [u64; 2] {
        [0, 1].map(|way| self.crossed[way].load(Relaxed))
    }

    /// How many buffers were allocated until now, but for those of [`Self::filled`] and for transfers.
    pub fn allocated(&self) -> u64 {
        self.allocated.load(Relaxed)
    }

    fn count(&self, way: usize, bytes: usize) {
        self.crossed[way].fetch_add(bytes as u64, Relaxed);
    }

    /// Loses the device, as a driver might, once it has done what it was given: wgpu tells of the loss no sooner.
    pub fn lose(&self) {
        self.link.device.poll(wgpu::PollType::wait_indefinitely()).expect("it can be waited for");
        self.link.device.destroy();
        self.link.device.poll(wgpu::PollType::Poll).expect("it can be asked");
    }

    pub(super) fn name(&self) -> &str {
        &self.link.name
    }

    pub(super) fn limit(&self) -> BufferLimit {
        self.limit.clone()
    }

    pub(super) fn alloc(&self, name: &'static str, bytes: u64) -> Result<wgpu::Buffer, Error> {
        use wgpu::BufferUsages as Use;
        self.allocated.fetch_add(1, Relaxed);
        self.link.buffer(name, bytes, Use::STORAGE | Use::COPY_SRC | Use::COPY_DST | Use::INDIRECT)
    }

    /// Writes: the data arrives before whatever is run or read next.
    pub(super) fn write(&self, buffer: &wgpu::Buffer, offset: u64, data: &[u8]) -> Result<(), Error> {
        self.link.check()?;
        self.count(TO, data.len());
        if data.len() <= RIDES_ALONG {
            return self.link.write(buffer, offset, data);
        }
        let create = || Slot::upload(&self.link, CHUNK as u64);
        let transfer = |slots: &mut _| staging::upload(&self.link, slots, buffer, offset, data);
        with(&self.uploads, || Ok([create()?, create()?]), transfer)
    }

    /// Reads what is wanted.
    pub(super) fn fetch(&self, back: &mut Back<'_>) -> Result<(), Error> {
        if back.bytes == 0 {
            return Ok(());
        }
        self.link.check()?;
        self.count(BACK, back.bytes);
        let create = || Slot::download(&self.link, CHUNK as u64);
        let transfer = |slots: &mut _| staging::download(&self.link, slots, back);
        with(&self.downloads, || Ok([create()?, create()?]), transfer)
    }

    /// Runs, and reads what is wanted back after that: for as much as one piece of a transfer holds the host waits but
    /// once. With `early` the first steps begin while the host still encodes the rest.
    pub(super) fn run(
        &self,
        steps: &[Step<'_>],
        timed: Timed,
        early: bool,
        back: &mut [Back<'_>],
    ) -> Result<Timing, Error> {
        self.link.check()?;
        self.prepare(&steps.iter().map(|step| step.kernel).collect::<Vec<_>>())?;
        let mut bytes = 0;
        let fit = back.iter().take_while(|back| {
            bytes += back.bytes;
            bytes <= CHUNK
        });
        let fit = fit.count();
        let (timing, later) = match &self.clock {
            _ if steps.is_empty() => (Timing::default(), back),
            Some(clock) => {
                let (beside, later) = back.split_at_mut(fit);
                (self.run_once(clock, steps, timed, early, beside)?, later)
            }
            None => (self.run_by_wall_clock(steps, timed == Timed::Steps)?, back),
        };
        later.iter_mut().try_for_each(|back| self.fetch(back)).map(|()| timing)
    }

    /// Runs, without waiting for the end.
    pub(super) fn begin(&self, steps: &[Step<'_>]) -> Result<(), Error> {
        self.link.check()?;
        self.begin_after(self.link.encoder(), steps)
    }

    /// Hands over commands, and steps behind them.
    pub(crate) fn begin_after(
        &self,
        mut commands: wgpu::CommandEncoder,
        steps: &[Step<'_>],
    ) -> Result<(), Error> {
        self.prepare(&steps.iter().map(|step| step.kernel).collect::<Vec<_>>())?;
        self.link.guard("encoding kernels", || {
            self.encode(&mut commands, &mut Bindings::new(), steps, None, None);
        })?;
        self.link.submit(commands).map(|_| ())
    }

    /// Runs in one submission, and in as many passes as there are timestamps for: one, unless very many steps are timed
    /// each.
    fn run_once(
        &self,
        clock: &Kept<Clock>,
        steps: &[Step<'_>],
        timed: Timed,
        early: bool,
        back: &mut [Back<'_>],
    ) -> Result<Timing, Error> {
        let profile = timed == Timed::Steps;
        let per_pass = if profile { clock::STEPS_PER_PASS } else { steps.len() };
        let passes = steps.len().div_ceil(per_pass);
        let create = || Clock::new(&self.link, passes);
        with(clock, create, |clock| {
            if clock.sets.len() < passes {
                *clock = create()?;
            }
            let bytes: usize = back.iter().map(|back| back.bytes).sum();
            if early && timed == Timed::Whole {
                let commands = self.start_early(steps, &clock.sets[0])?;
                self.count(BACK, 2 * wgpu::QUERY_SIZE as usize + bytes);
                return clock.finish(&self.link, commands, &[2], false, back);
            }
            let mut stamps = Vec::with_capacity(passes);
            let commands = self.link.guard("encoding kernels", || {
                let mut commands = self.link.encoder();
                let mut bindings = Bindings::new();
                for (steps, set) in steps.chunks(per_pass).zip(&clock.sets) {
                    if timed == Timed::Nothing {
                        self.encode(&mut commands, &mut bindings, steps, None, None);
                        continue;
                    }
                    let end = if profile { None } else { Some(1) };
                    let writes = wgpu::ComputePassTimestampWrites {
                        query_set: set,
                        beginning_of_pass_write_index: Some(0),
                        end_of_pass_write_index: end,
                    };
                    let after = profile.then_some(set);
                    self.encode(&mut commands, &mut bindings, steps, Some(writes), after);
                    stamps.push(end.unwrap_or(steps.len() as u32) + 1);
                }
                commands
            })?;
            self.count(BACK, stamps.iter().sum::<u32>() as usize * wgpu::QUERY_SIZE as usize + bytes);
            clock.finish(&self.link, commands, &stamps, profile, back)
        })
    }

    /// Encodes steps, of which the first are handed over as soon as they are, so that the device need not wait for the
    /// host to encode hundreds. Returns the commands that remain.
    fn start_early(&self, steps: &[Step<'_>], set: &wgpu::QuerySet) -> Result<wgpu::CommandEncoder, Error> {
        let (mut bindings, mut from) = (Bindings::new(), 0);
        loop {
            let end = EARLY.into_iter().find(|&end| end > from && end < steps.len()).unwrap_or(steps.len());
            let writes = wgpu::ComputePassTimestampWrites {
                query_set: set,
                beginning_of_pass_write_index: (from == 0).then_some(0),
                end_of_pass_write_index: (end == steps.len()).then_some(1),
            };
            let timed = from == 0 || end == steps.len();
            let commands = self.link.guard("encoding kernels", || {
                let mut commands = self.link.encoder();
                self.encode(&mut commands, &mut bindings, &steps[from..end], timed.then_some(writes), None);
                commands
            })?;
            if end == steps.len() {
                return Ok(commands);
            }
            self.link.submit(commands)?;
            from = end;
        }
    }

    /// Runs with the host's clock, which also sees submission and waiting.
    fn run_by_wall_clock(&self, steps: &[Step<'_>], profile: bool) -> Result<Timing, Error> {
        let at_a_time = if profile { 1 } else { steps.len() };
        let mut times = Vec::new();
        for steps in steps.chunks(at_a_time) {
            let start = Instant::now();
            let commands = self.link.guard("encoding kernels", || {
                let mut commands = self.link.encoder();
                self.encode(&mut commands, &mut Bindings::new(), steps, None, None);
                commands
            })?;
            self.link.wait(self.link.submit(commands)?)?;
            times.push(start.elapsed());
        }
        Ok(Timing {
            total: times.iter().sum(),
            steps: if profile { times } else { Vec::new() },
            moved: Vec::new(),
        })
    }

    /// Encodes one pass; wgpu puts barriers between dispatches that need them. With `after`, a timestamp
    /// follows each step.
    fn encode(
        &self,
        commands: &mut wgpu::CommandEncoder,
        bindings: &mut Bindings,
        steps: &[Step<'_>],
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
        after: Option<&wgpu::QuerySet>,
    ) {
        let pipelines = lock(&self.pipelines);
        let mut pass =
            commands.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
        for (step, stamp) in steps.iter().zip(1..) {
            if !matches!(step.groups, Groups::Fixed(0)) {
                let Pipeline { layout, pipeline } = &pipelines[step.kernel.path];
                let buffers = step.buffers.iter().map(|&buffer| std::ptr::from_ref(buffer)).collect();
                let binding = bindings.entry((step.kernel.path, buffers)).or_insert_with(|| {
                    let memory = step.buffers.iter().map(|buffer| buffer.as_wgpu().as_entire_binding());
                    self.bind(layout, memory)
                });
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &*binding, &[]);
                match step.groups {
                    Groups::Fixed(n) => dispatch(&mut pass, n),
                    Groups::Indirect(args, entry) => {
                        pass.dispatch_workgroups_indirect(args.as_wgpu(), u64::from(entry) * 12);
                    }
                }
            }
            if let Some(set) = after {
                pass.write_timestamp(set, stamp);
            }
        }
    }

    /// Binds resources in binding order.
    fn bind<'a>(
        &self,
        layout: &wgpu::BindGroupLayout,
        resources: impl IntoIterator<Item = wgpu::BindingResource<'a>>,
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries: &entries };
        self.link.device.create_bind_group(&descriptor)
    }

    fn compile(&self, kernel: &'static Kernel) -> Result<Pipeline, Error> {
        let (name, entry_point) = (kernel.name(), kernel.entry_point());
        let by_doubles = BY_DOUBLES.iter().any(|other| other.path == kernel.path);
        let module = if by_doubles { self.doubles() } else { Some(&self.module) };
        // With a name that is not there drivers may do anything.
        let there = by_doubles || self.entry_points.contains(entry_point);
        let Some(module) = module.filter(|_| there) else {
            let what = format!("no kernel '{entry_point}' in the compiled module: run `cargo xtask kernels`");
            return Err(self.link.failed(what));
        };
        let entries: Vec<_> = (0..)
            .zip(kernel.slots)
            .map(|(binding, slot)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: slot.access == Access::Read },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let device = &self.link.device;
        self.link.guard(format_args!("preparing kernel {name}"), || {
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(name),
                entries: &entries,
            });
            let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(name),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
            let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: Some(&pipeline_layout),
                module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            });
            Pipeline { layout, pipeline }
        })
    }
}

/// Dispatches so many workgroups, in rows of [`GROUPS_X`].
fn dispatch(pass: &mut wgpu::ComputePass<'_>, groups: u32) {
    pass.dispatch_workgroups(groups.min(GROUPS_X), groups.div_ceil(GROUPS_X), 1);
}

impl AnyBuffer {
    /// Its memory on a GPU.
    pub(crate) fn as_wgpu(&self) -> &wgpu::Buffer {
        match &self.memory {
            Memory::Gpu(memory) => memory,
            Memory::Cpu(_) => panic!("buffer {} belongs to another device", self.name),
        }
    }
}

/// Uses a tool of those that are kept, or a new one, and keeps it unless the use failed.
///
/// No lock is held meanwhile: a thread of rayon that waits for a copy may take up a task that asks here, too.
fn with<T, R>(
    kept: &Kept<T>,
    create: impl FnOnce() -> Result<T, Error>,
    act: impl FnOnce(&mut T) -> Result<R, Error>,
) -> Result<R, Error> {
    let free = lock(kept).pop();
    let mut tool = free.map_or_else(create, Ok)?;
    let result = act(&mut tool)?;
    let mut kept = lock(kept);
    if kept.len() < KEPT {
        kept.push(tool);
    }
    Ok(result)
}

#[cfg(test)]
mod tests {
    use super::{
        super::{Launch as _, To},
        *,
    };
    use raykd_kernels::probe::{self, PROBE};

    #[test]
    fn lost_device_gives_errors_ever_after() {
        let gpu = Gpu::open(None).unwrap();
        let small = gpu.alloc("small", 64).unwrap();
        let words = AnyBuffer::of("small", 64, Memory::Gpu(small.clone()));
        let large = gpu.alloc("large", 1 << 20).unwrap();
        gpu.write(&large, 0, &[1; 1 << 20]).unwrap();
        gpu.lose();
        for _ in 0..2 {
            let mut out = [0u8; 64];
            assert!(matches!(gpu.write(&small, 0, &[0; 64]), Err(Error::DeviceFailed { .. })));
            assert!(matches!(gpu.write(&large, 0, &[0; 1 << 20]), Err(Error::DeviceFailed { .. })));
            assert!(matches!(
                gpu.fetch(&mut words.back(To::Room(&mut out))),
                Err(Error::DeviceFailed { .. })
            ));
            assert!(matches!(gpu.alloc("more", 64), Err(Error::DeviceFailed { .. })));
            assert!(matches!(gpu.prepare(&[&PROBE]), Ok(()) | Err(Error::DeviceFailed { .. })));
        }
    }

    #[test]
    fn without_timestamps_the_host_takes_the_time() {
        let mut gpu = Gpu::open(None).unwrap();
        gpu.clock = None;
        let device = Device::from(gpu);
        let (inputs, count) = (device.alloc("inputs", 4).unwrap(), device.alloc("count", 4).unwrap());
        let results = device.alloc("results", 16).unwrap();
        let buffers = || probe::Buffers { inputs: &inputs, results: results.out(), count: &count };
        let steps = [1, 0, 1].map(|groups| buffers().groups(groups));
        for profile in [false, true] {
            let timing = device.dispatch(&steps, profile).unwrap();
            assert!(!timing.total.is_zero());
            assert_eq!(timing.steps.len(), if profile { 3 } else { 0 });
        }
    }

    #[test]
    fn kernels_find_the_rest_of_products_with_two_roundings_too() {
        let mut gpu = Gpu::open(None).unwrap();
        gpu.round_twice().unwrap();
        let (_, verdict, rests) = gpu.judged().unwrap();
        assert!(rests && matches!(verdict, AdapterVerdict::Exact { .. }), "{verdict:?}");
    }

    #[test]
    fn doubles_are_right_with_two_roundings_too() {
        for twice in [false, true] {
            let mut gpu = Gpu::open(None).unwrap();
            if twice {
                gpu.round_twice().unwrap();
            }
            assert!(Device::from(gpu).with_doubles(true).is_some());
        }
    }
}
