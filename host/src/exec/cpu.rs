//! The CPU executor: workgroups in parallel by rayon, the lanes of each in turn.

use super::{
    AnyBuffer, BufferLimit, Groups, Step, Timing,
    pages::{FileBytes, pages},
};
use crate::{Error, clock::Instant};
use bytemuck::allocation::try_zeroed_vec;
use raykd_kernels::{Access, Group, Order, RawBuf, Usual};
use rayon::prelude::*;
use std::{
    fmt,
    num::NonZero,
    sync::{
        Arc,
        atomic::{
            AtomicU32,
            Ordering::{Acquire, Relaxed, Release},
        },
        mpsc::channel,
    },
    thread,
};

/// Threads that any machine may be asked for. Each looks for work with every other one: to start tens of thousands
/// takes minutes, in which a machine does nothing else.
const MOST: usize = 1024;

/// The processor as a device.
#[derive(Debug)]
pub struct Cpu {
    pool: Option<rayon::ThreadPool>,
    order: Order,
    /// Workgroups of a row.
    row: u32,
    name: String,
}

impl Default for Cpu {
    fn default() -> Self {
        Self::on(None)
    }
}

impl Cpu {
    /// With `threads` threads of its own.
    ///
    /// # Errors
    /// They are too many, or could not be started.
    pub fn with_threads(threads: usize) -> Result<Self, Error> {
        let most = thread::available_parallelism().map_or(1, NonZero::get).max(MOST);
        if threads > most {
            let why = format!("{threads} are too many for this machine; ask for {most} at most");
            return Err(Error::Threads(why));
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build();
        pool.map(|p| Self::on(Some(p))).map_err(|e| Error::Threads(e.to_string()))
    }

    fn on(pool: Option<rayon::ThreadPool>) -> Self {
        let mut cpu = Self { pool, order: Order::Forward, row: u32::MAX, name: String::new() };
        let threads = cpu.threads();
        let model = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
            let line = text.lines().find(|l| l.starts_with("model name"))?;
            line.split_once(':').map(|(_, name)| name.trim().to_owned())
        });
        let model = model.unwrap_or_else(|| std::env::consts::ARCH.to_owned());
        let s = if threads == 1 { "" } else { "s" };
        cpu.name = format!("{model}, {threads} thread{s}");
        cpu
    }

    /// How many do the work.
    pub(super) fn threads(&self) -> usize {
        self.pool.as_ref().map_or_else(rayon::current_num_threads, rayon::ThreadPool::current_num_threads)
    }

    /// Visits lanes and workgroups in another order; results must not change. For tests.
    #[must_use]
    pub const fn in_order(mut self, order: Order) -> Self {
        self.order = order;
        self
    }

    /// Runs more workgroups than one row has in whole rows, as GPUs run those of large dispatches; results must not
    /// change. For tests.
    #[must_use]
    pub const fn in_rows_of(mut self, workgroups: u32) -> Self {
        self.row = workgroups;
        self
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) const fn limit(&self) -> BufferLimit {
        // Indices are u32, of elements down to 4 bytes.
        BufferLimit { bytes: (u32::MAX as u64) * 4, name: "32-bit indices" }
    }

    pub(super) fn alloc(&self, name: &'static str, bytes: u64) -> Result<Memory, Error> {
        Memory::zeroed(bytes).ok_or(Error::OutOfMemory { buffer: name, bytes })
    }

    pub(super) fn run(&self, steps: &[Step<'_>], profile: bool) -> Timing {
        if self.is_serial() {
            return self.run_here(steps, profile);
        }
        self.install(|| self.run_here(steps, profile))
    }

    /// Whether one thread does it all. Then the caller's does: nobody need be woken, nor waited for.
    fn is_serial(&self) -> bool {
        self.pool.as_ref().is_some_and(|pool| pool.current_num_threads() == 1)
    }

    pub(super) fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        // A page has none, and should not load what follows.
        let Some(pool) = self.pool.as_ref().filter(|_| !cfg!(target_arch = "wasm32")) else { return work() };
        let is_anothers = rayon::current_thread_index().is_some() && pool.current_thread_index().is_none();
        if !is_anothers {
            return pool.install(work);
        }
        // A thread of another pool would take up more and more of that pool's tasks while it waits for this one, each
        // on top of the other, until its stack is full. So it sleeps.
        let (done, told) = channel();
        let result = pool.in_place_scope(|scope| {
            scope.spawn(move |_| drop(done.send(work())));
            told.recv()
        });
        result.expect("a panic would have been passed on")
    }

    fn run_here(&self, steps: &[Step<'_>], profile: bool) -> Timing {
        let start = Instant::now();
        let (mut times, mut moved) = (Vec::new(), Vec::new());
        for step in steps {
            let begin = Instant::now();
            let groups = match step.groups {
                Groups::Fixed(n) => n,
                Groups::Indirect(args, entry) => {
                    args.place("arguments", size_of::<[u32; 3]>(), u64::from(entry), 1);
                    let kept = memory(args).keep(args.name, args.bytes);
                    kept.slice::<[u32; 3]>()[entry as usize].iter().product()
                }
            };
            let in_rows = if groups > self.row { groups.next_multiple_of(self.row) } else { groups };
            let bytes = self.dispatch(step, in_rows);
            if profile {
                times.push(begin.elapsed());
                if cfg!(feature = "traffic") {
                    moved.push(bytes);
                }
            }
        }
        Timing { total: start.elapsed(), steps: times, moved }
    }

    /// Returns how many bytes were moved, if they are counted.
    fn dispatch(&self, step: &Step<'_>, groups: u32) -> u64 {
        let slots = step.kernel.slots.iter().zip(&step.buffers);
        let uses: Vec<Use<'_>> =
            slots.map(|(slot, b)| memory(b).begin(b.name, slot.access == Access::Write)).collect();
        // Of memory that is used again perhaps but a part.
        let raw = |(used, b): (&Use<'_>, &&AnyBuffer)| Shared(RawBuf { len: b.bytes as usize, ..used.raw() });
        let raw: Vec<Shared> = uses.iter().zip(&step.buffers).map(raw).collect();
        let usual = if self.order == Order::Forward { usual() } else { Usual::NO };
        // Few wide ones are not shared out evenly among threads.
        let threads = self.threads() as u32;
        let most = if threads == 1 { groups } else { groups / (8 * threads) };
        let span = if usual.has() { most.clamp(1, step.kernel.span) } else { 1 };
        let (groups, width) = (groups.div_ceil(span), span * step.kernel.threads);
        let run = |id: u32| {
            let mut buffers = [RawBuf { ptr: std::ptr::null_mut(), len: 0 }; 16];
            for (slot, shared) in buffers.iter_mut().zip(&raw) {
                *slot = shared.0;
            }
            let group = Group { id, width, order: self.order, usual };
            // SAFETY: one live, aligned buffer per slot (`Device::dispatch` counts them), which `uses` keeps others
            // from writing; the groups of one dispatch have different ids, and kernels give every word one writer.
            unsafe { (step.kernel.run)(group, &buffers[..raw.len()]) }
        };
        if self.order == Order::Reverse {
            (0..groups).rev().map(run).sum()
        } else if groups == 1 || self.is_serial() {
            (0..groups).map(run).sum()
        } else {
            (0..groups).into_par_iter().map(run).sum()
        }
    }
}

/// Whether the processor can run the copies of kernels that are compiled for more than the least of its kind. Only
/// the instructions differ: what is fused finds the rounding error of a product, the same number.
pub(crate) fn usual() -> Usual {
    #[cfg(target_arch = "x86_64")]
    let has = is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt");
    #[cfg(not(target_arch = "x86_64"))]
    let has = true;
    // SAFETY: the processor was asked, or needs none.
    unsafe { Usual::said(has) }
}

/// A buffer's address may go to other threads: kernels keep its slots apart.
#[derive(Clone, Copy)]
struct Shared(RawBuf);
// SAFETY: only the address is shared; accesses follow the contract of `Kernel::run`.
unsafe impl Send for Shared {}
// SAFETY: as above.
unsafe impl Sync for Shared {}

pub(super) fn memory(buffer: &AnyBuffer) -> &Memory {
    match &buffer.memory {
        super::Memory::Cpu(memory) => memory,
        #[cfg(feature = "gpu")]
        super::Memory::Gpu(_) => panic!("buffer {} belongs to another device", buffer.name),
    }
}

/// Shared ownership of memory, aligned to [`Line`]s.
#[derive(Clone, Debug)]
pub(crate) struct Memory(Arc<Allocation>);

struct Allocation {
    /// Start of the memory; all accesses go through it, never through a reference.
    ptr: *mut u8,
    len: usize,
    _place: Place,
    /// How many read it now; [`WRITTEN`] if one writes it.
    users: AtomicU32,
}

/// Without the bytes: a scene has too many to print.
impl fmt::Debug for Allocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Allocation").field("len", &self.len).finish_non_exhaustive()
    }
}

/// Where memory comes from: to map pages takes longer than to clear a few.
enum Place {
    Heap(#[expect(dead_code, reason = "owns the memory")] Vec<Line>),
    Pages(#[allow(dead_code, reason = "owns the memory, where there are any")] memmap2::MmapMut),
    File(#[expect(dead_code, reason = "owns the memory")] FileBytes),
}

/// As much as a processor fetches at once.
#[derive(Clone, Copy, bytemuck::Zeroable)]
#[repr(align(64))]
struct Line(#[expect(dead_code, reason = "read by kernels")] [u8; 64]);

/// Bytes from which memory is mapped. WebAssembly has nothing to map.
const LARGE: usize = if cfg!(target_arch = "wasm32") { usize::MAX } else { 1 << 18 };

/// What [`Allocation::users`] is while one writes.
const WRITTEN: u32 = u32::MAX;

// SAFETY: plain memory; every access is within a `Use`, which keeps writers apart from all others.
unsafe impl Send for Allocation {}
// SAFETY: as above.
unsafe impl Sync for Allocation {}

/// The use of a buffer by one dispatch or transfer: by one that writes, or by any number that read.
struct Use<'a> {
    allocation: &'a Allocation,
    writes: bool,
}

impl Drop for Use<'_> {
    fn drop(&mut self) {
        let users = &self.allocation.users;
        if self.writes {
            users.store(0, Release);
        } else {
            users.fetch_sub(1, Release);
        }
    }
}

impl Use<'_> {
    fn raw(&self) -> RawBuf {
        RawBuf { ptr: self.allocation.ptr, len: self.allocation.len }
    }
}

/// A buffer that is only read while this lives, by any number of threads.
#[derive(Debug)]
pub(crate) struct Kept {
    memory: Memory,
    bytes: usize,
}

impl Kept {
    /// Its elements.
    pub(crate) fn slice<T: bytemuck::Pod>(&self) -> &[T] {
        let (ptr, len) = (self.memory.0.ptr, self.bytes);
        // SAFETY: `keep` counted a reader, which stays until the drop below, so nobody writes; the memory is as long at
        // least, aligned to a line and holds bytes that were once zeroed, or a file's, which any `T` may be. Who mapped
        // a file promised that it does not change.
        unsafe { std::slice::from_raw_parts(ptr.cast(), len / size_of::<T>()) }
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        drop(Use { allocation: &self.memory.0, writes: false });
    }
}

impl Memory {
    /// Whether others have it, too: a [`Kept`], which is no buffer, or buffers.
    pub(super) fn is_shared(&self) -> bool {
        Arc::strong_count(&self.0) > 1
    }

    /// How many bytes it has.
    pub(super) fn len(&self) -> u64 {
        self.0.len as u64
    }

    /// Keeps others from writing it; so many bytes are to be read.
    pub(crate) fn keep(&self, name: &str, bytes: u64) -> Kept {
        assert!(bytes <= self.len(), "{bytes} bytes of buffer {name}, which has {}", self.len());
        std::mem::forget(self.begin(name, false));
        Kept { memory: self.clone(), bytes: bytes as usize }
    }

    fn zeroed(bytes: u64) -> Option<Self> {
        let len = usize::try_from(bytes).ok()?;
        let (ptr, place) = if len < LARGE {
            let mut lines: Vec<Line> = try_zeroed_vec(len.div_ceil(size_of::<Line>())).ok()?;
            (lines.as_mut_ptr().cast(), Place::Heap(lines))
        } else {
            let mut map = pages(len).ok()?;
            (map.as_mut_ptr(), Place::Pages(map))
        };
        Some(Self(Arc::new(Allocation { ptr, len, _place: place, users: AtomicU32::new(0) })))
    }

    /// Part of a file, from a line's first byte on. It counts as read for ever, so nobody can write it.
    pub(crate) fn part_of(file: &FileBytes, begin: usize, len: usize) -> Self {
        let inside = begin.checked_add(len).is_some_and(|end| end <= file.len());
        assert!(inside && begin.is_multiple_of(size_of::<Line>()), "a part of a file lies in it");
        let ptr = file.start().wrapping_add(begin);
        Self(Arc::new(Allocation { ptr, len, _place: Place::File(file.clone()), users: AtomicU32::new(1) }))
    }

    /// Begins to use it. Waiting could take for ever, as a thread that waits may be given other work.
    fn begin(&self, name: &str, writes: bool) -> Use<'_> {
        let allocation = &*self.0;
        let next = |users| match users {
            0 if writes => Some(WRITTEN),
            _ if writes => None,
            _ => (users < WRITTEN - 1).then(|| users + 1),
        };
        let free = allocation.users.fetch_update(Acquire, Relaxed, next).is_ok();
        assert!(free, "buffer {name} is in use elsewhere: one call writes it while another uses it");
        Use { allocation, writes }
    }

    /// Writes at an offset; the range lies inside.
    pub(super) fn write(&self, name: &str, offset: u64, data: &[u8]) {
        let target = self.begin(name, true);
        // SAFETY: the caller checked the range, and nobody else uses the memory now.
        unsafe { target.raw().ptr.add(offset as usize).copy_from(data.as_ptr(), data.len()) }
    }
}
