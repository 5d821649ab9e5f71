//! What makes one function body a kernel on both machines: the workgroup, `lanes!` and `kernel!`.

#[cfg(not(target_arch = "spirv"))]
pub(crate) use crate::heap::vec::Vec;
use crate::mem::Slots;
use raykd_shared::limits::GROUPS_X;

/// The workgroup a group kernel runs for.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// Number of this workgroup in its dispatch.
    pub id: u32,
    /// This invocation's lane.
    #[cfg(target_arch = "spirv")]
    pub lane: u32,
    /// Lanes in the group.
    pub width: u32,
    /// The order in which the CPU visits them.
    #[cfg(not(target_arch = "spirv"))]
    pub order: Order,
    /// Whether that is [`Order::Forward`], and the processor has the usual instructions.
    pub usual: Usual,
}

/// Whether a CPU has the usual instructions: AVX2, FMA, BMI1, BMI2, LZCNT and POPCNT if it is an x86. Nobody can say so
/// by mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Usual(bool);

impl Usual {
    /// It is not known.
    pub const NO: Self = Self(false);

    /// It has them, or that is not known.
    ///
    /// # Safety
    /// If it `has` them, this processor does.
    pub const unsafe fn said(has: bool) -> Self {
        Self(has)
    }

    /// Whether it has them.
    #[inline(always)]
    pub const fn has(self) -> bool {
        self.0
    }
}

impl Group {
    /// How many lanes share out a loop: they start at their numbers and take steps of this. On a CPU one lane does all,
    /// from element to element.
    #[inline(always)]
    pub fn sharers(&self) -> u32 {
        #[cfg(not(target_arch = "spirv"))]
        if self.order == Order::Forward {
            return 1;
        }
        self.width
    }

    /// Waits for all lanes; what they wrote to buffers is then seen by all.
    #[inline(always)]
    pub fn meet_at_buffers(&self) {
        #[cfg(target_arch = "spirv")]
        {
            use spirv_std::memory::{Scope, Semantics};
            const GROUP: u32 = Scope::Workgroup as u32;
            const BUFFERS: u32 = Semantics::UNIFORM_MEMORY.bits() | Semantics::ACQUIRE_RELEASE.bits();
            spirv_std::arch::control_barrier::<GROUP, GROUP, BUFFERS>();
        }
    }
}

#[cfg(target_arch = "spirv")]
impl Group {
    /// Waits for all lanes; what they wrote to workgroup memory is then seen by all.
    #[inline(always)]
    pub fn barrier(&self) {
        spirv_std::arch::workgroup_memory_barrier_with_group_sync()
    }
}

/// The order in which the CPU runs the lanes between two barriers. Kernels must not depend on it, and tests
/// run them in several orders to show that.
#[cfg(not(target_arch = "spirv"))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// 0, 1, 2, …
    #[default]
    Forward,
    /// …, 2, 1, 0
    Reverse,
    /// A permutation drawn from this seed.
    Shuffled(u32),
}

#[cfg(not(target_arch = "spirv"))]
impl Group {
    /// The lanes of the group in the group's order.
    #[inline(always)]
    pub fn lanes(&self) -> impl Iterator<Item = u32> + use<> {
        self.first(self.width)
    }

    /// The first `count` lanes in the group's order.
    #[inline(always)]
    pub fn first(&self, count: u32) -> impl Iterator<Item = u32> + use<> {
        // An odd multiplier permutes the residues of a power of two.
        let all = count.next_power_of_two();
        let (number, mul, add, mask) = match self.order {
            Order::Forward => (count, 1, 0, u32::MAX),
            Order::Reverse => (all, u32::MAX, u32::MAX, all - 1),
            Order::Shuffled(seed) => {
                (all, seed | 1, (seed ^ self.id).wrapping_mul(0x9E37_79B9) >> 7, all - 1)
            }
        };
        (0..number).map(move |i| i.wrapping_mul(mul).wrapping_add(add) & mask).filter(move |&i| i < count)
    }
}

/// Indirect arguments for a dispatch of `groups` workgroups.
#[inline(always)]
pub fn put_groups(args: &mut (impl Slots<u32> + ?Sized), entry: u32, groups: u32) {
    let wide = groups > GROUPS_X;
    args.put(3 * entry, if wide { GROUPS_X } else { groups });
    args.put(3 * entry + 1, if wide { groups.div_ceil(GROUPS_X) } else { 1 });
    args.put(3 * entry + 2, 1);
}

/// The numbers of the bits that are set, from the lowest up. Of references that may go either way a CPU takes those
/// that go one way first, and then the others: asked of each in turn, it guesses every second answer wrong.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bits(pub(crate) u32);

impl Iterator for Bits {
    type Item = u32;
    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        let Self(rest) = self;
        let next = (*rest != 0).then(|| rest.trailing_zeros());
        *rest &= rest.wrapping_sub(1);
        next
    }
}

/// Runs a block once per lane and then lets all lanes meet: on the GPU this lane's turn and a barrier, on the
/// CPU a loop. Within a block no lane may read what another lane writes; nothing a lane computes in a private
/// variable survives the block, so everything that must goes to workgroup memory, or a
/// [`PerLane`](crate::mem::PerLane). Code between blocks is run by every lane and must compute the same for
/// all.
///
/// With `..count` only the first lanes take a turn.
#[macro_export]
macro_rules! lanes {
    ($group:expr, ..$count:expr, |$lane:ident| $body:block) => {
        #[cfg(target_arch = "spirv")]
        {
            let $lane = $group.lane;
            if $lane < $count $body
            $group.barrier();
        }
        #[cfg(not(target_arch = "spirv"))]
        for $lane in $group.first($count) $body
    };
    ($group:expr, |$lane:ident| $body:block) => {
        #[cfg(target_arch = "spirv")]
        {
            let $lane = $group.lane;
            $body
            $group.barrier();
        }
        #[cfg(not(target_arch = "spirv"))]
        for $lane in $group.lanes() $body
    };
}

/// How a kernel uses a buffer.
#[cfg(not(target_arch = "spirv"))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Only read; on the GPU declared `NonWritable`.
    Read,
    /// Written, perhaps read too.
    Write,
}

/// One buffer a kernel binds; its binding number is its place in [`Kernel::slots`].
#[cfg(not(target_arch = "spirv"))]
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    /// The kernel's name for it.
    pub name: &'static str,
    /// How it is used.
    pub access: Access,
    /// Bytes per element.
    pub stride: usize,
}

/// A buffer handed to a kernel on the CPU.
#[cfg(not(target_arch = "spirv"))]
#[derive(Clone, Copy, Debug)]
pub struct RawBuf {
    /// Start, aligned to 16 bytes.
    pub ptr: *mut u8,
    /// Bytes.
    pub len: usize,
}

/// A kernel as the host dispatches it.
#[cfg(not(target_arch = "spirv"))]
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Path of the entry point, crate name first.
    pub path: &'static str,
    /// Lanes per workgroup.
    pub threads: u32,
    /// Neighbouring workgroups that a CPU with the usual instructions may run as one, which is as much wider.
    pub span: u32,
    /// Map kernels run one invocation per index, group kernels one workgroup per group.
    pub slots: &'static [Slot],
    /// Runs one workgroup on the CPU. Returns the bytes it read and wrote in buffers, if compiled with the feature
    /// `traffic` (of an atomic operation once), else 0.
    ///
    /// # Safety
    /// One [`RawBuf`] per slot, aligned to 16 bytes, valid while the call runs, writable where the slot says
    /// so; concurrent calls must be workgroups of the same dispatch, with different ids.
    pub run: unsafe fn(Group, &[RawBuf]) -> u64,
}

#[cfg(not(target_arch = "spirv"))]
impl Kernel {
    /// Name of the SPIR-V entry point: the path without the crate, as rust-gpu names it.
    pub fn entry_point(&self) -> &'static str {
        self.path.split_once("::").map_or(self.path, |(_, rest)| rest)
    }

    /// Short name: the file the kernel lives in.
    pub fn name(&self) -> &'static str {
        self.path.rsplit("::").nth(1).unwrap_or(self.path)
    }
}

/// How a host refers to the buffers that it binds.
#[cfg(not(target_arch = "spirv"))]
pub trait Host {
    /// A buffer of `T` that a kernel reads.
    type Read<'a, T: 'static>;
    /// A buffer of `T` that a kernel writes, and perhaps reads too.
    type Write<'a, T: 'static>;
    /// Either, of any type.
    type Any<'a>;
    /// Forgets the type.
    fn read<'a, T: 'static>(buffer: Self::Read<'a, T>) -> Self::Any<'a>;
    /// Forgets the type, and that it is written.
    fn write<'a, T: 'static>(buffer: Self::Write<'a, T>) -> Self::Any<'a>;
}

/// All buffers of a dispatch, by name: `kernel!` makes such a struct `Buffers` beside each kernel.
#[cfg(not(target_arch = "spirv"))]
pub trait Bindings<'a, H: Host> {
    /// The kernel that binds them.
    const KERNEL: &'static Kernel;
    /// The buffers in binding order.
    fn list(self) -> Vec<H::Any<'a>>;
}

#[cfg(all(target_arch = "spirv", any(feature = "entry-points", feature = "doubles")))]
macro_rules! slot {
    (read $t:ty) => { &$crate::mem::Buf<$t> };
    (write $t:ty) => { &mut $crate::mem::Buf<$t> };
}

#[cfg(not(target_arch = "spirv"))]
macro_rules! slot {
    (access read) => {
        $crate::Access::Read
    };
    (access write) => {
        $crate::Access::Write
    };
    (pass read $b:ident) => {
        &$b
    };
    (pass write $b:ident) => {
        &mut $b
    };
    (bound read $l:lifetime $h:ident $t:ty) => {
        $h::Read<$l, $t>
    };
    (bound write $l:lifetime $h:ident $t:ty) => {
        $h::Write<$l, $t>
    };
    (forget read $h:ident $b:expr) => {
        $h::read($b)
    };
    (forget write $h:ident $b:expr) => {
        $h::write($b)
    };
}

/// What a processor answers that has the instructions for the numbers `Eight`, which `$usual` says, and what others do.
macro_rules! by_eight {
    ($usual:expr, $eight:expr, else $other:expr) => {{
        let usual: $crate::Usual = $usual;
        #[cfg(target_arch = "x86_64")]
        let answer = if usual.has() {
            #[allow(unused_imports, reason = "what is asked may be of `Eight` or not")]
            use $crate::eight::Eight;
            $eight
        } else {
            $other
        };
        #[cfg(not(target_arch = "x86_64"))]
        let answer = {
            let _ = usual;
            $other
        };
        answer
    }};
}

/// Lists kernels, as `KERNELS` of a module.
macro_rules! kernels {
    ($(#[$doc:meta])* $($kernel:path),+ $(,)?) => {
        $(#[$doc])*
        #[cfg(not(target_arch = "spirv"))]
        pub const KERNELS: &[&$crate::Kernel] = &[$(&$kernel),+];
    };
}

/// Declares a struct of buffers that several kernels begin with.
macro_rules! bindings {
    ($(#[$doc:meta])* $name:ident { $($b:tt $arg:ident: $mode:ident $t:ty),+ $(,)? }) => {
        $(#[$doc])*
        #[cfg(not(target_arch = "spirv"))]
        #[allow(missing_docs, missing_debug_implementations, reason = "the kernels say what these are")]
        pub struct $name<'a, H: $crate::Host> {
            $(pub $arg: slot!(bound $mode 'a H $t)),+
        }

        #[cfg(not(target_arch = "spirv"))]
        impl<'a, H: $crate::Host> $name<'a, H> {
            pub(crate) fn list(self) -> $crate::kernel::Vec<H::Any<'a>> {
                $crate::kernel::Vec::from([$(slot!(forget $mode H self.$arg)),+])
            }
        }
    };
}

/// Whether there is but the copy for the usual order: a page loads every byte, and no test runs there that turns the
/// order round.
#[cfg(not(target_arch = "spirv"))]
pub(crate) const ONE_COPY: bool = cfg!(target_arch = "wasm32");

/// Runs a workgroup, by one of two copies of the same code.
#[cfg(not(target_arch = "spirv"))]
macro_rules! run_twice {
    ($n:tt, $span:tt, |$group:ident, $buffers:ident| $run:block) => {{
        #[inline(always)]
        unsafe fn run($group: $crate::Group, $buffers: &[$crate::RawBuf]) -> u64 $run
        // A copy for the usual order, in which lanes are counted as in any loop. Each copy knows which it is.
        #[cfg_attr(target_arch = "x86_64", target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt"))]
        unsafe fn usual(group: $crate::Group, buffers: &[$crate::RawBuf]) -> u64 {
            // SAFETY: as for the caller, who says that the processor has these instructions.
            unsafe {
                let usual = $crate::Usual::said(true);
                let order = $crate::Order::Forward;
                let width = if $span == 1 { $n } else { group.width };
                run($crate::Group { width, order, usual, ..group }, buffers)
            }
        }
        // No closure: each crate that names the kernel would compile it again.
        unsafe fn either(group: $crate::Group, buffers: &[$crate::RawBuf]) -> u64 {
            // SAFETY: as for the caller; a group knows whether the processor has these instructions, and there is one
            // copy only for processors that need none.
            unsafe {
                if group.usual.has() || $crate::kernel::ONE_COPY {
                    usual(group, buffers)
                } else {
                    run($crate::Group { usual: $crate::Usual::NO, ..group }, buffers)
                }
            }
        }
        either
    }};
}

/// Declares a kernel: a SPIR-V entry point on the GPU; on the CPU a [`Kernel`] constant, and `Buffers`, by
/// which a host binds its buffers. A kernel may begin with those of a struct that [`bindings!`] made, of `'a` and `H`.
///
/// A kernel `map_by_doubles` stands in the module for devices that have doubles.
macro_rules! kernel {
    ($(#[$doc:meta])* map $($rest:tt)*) => {
        kernel! { @map "entry-points" $(#[$doc])* $($rest)* }
    };
    ($(#[$doc:meta])* map_by_doubles $($rest:tt)*) => {
        kernel! { @map "doubles" $(#[$doc])* $($rest)* }
    };
    (@map $feature:literal $(#[$doc:meta])* $name:ident = $body:path, threads $n:tt,
     $($head:ident: $shared:ty { $($hb:tt $harg:ident: $hmode:ident $ht:ty),+ $(,)? },)?
     { $($b:tt $arg:ident: $mode:ident $t:ty),* $(,)? }) => {
        $(#[$doc])*
        #[cfg(all(target_arch = "spirv", feature = $feature))]
        #[spirv_std::spirv(compute(threads($n), signed_zero_inf_nan_preserve = 32, rounding_mode_rte = 32))]
        pub fn entry(
            #[spirv(workgroup_id)] group: $crate::glam::UVec3,
            #[spirv(num_workgroups)] groups: $crate::glam::UVec3,
            #[spirv(local_invocation_index)] lane: u32,
            $($(#[spirv(storage_buffer, descriptor_set = 0, binding = $hb)] $harg: slot!($hmode $ht),)+)?
            $(#[spirv(storage_buffer, descriptor_set = 0, binding = $b)] $arg: slot!($mode $t)),*
        ) {
            $body((group.y * groups.x + group.x) * $n + lane, $($($harg,)+)? $($arg),*);
        }

        kernel! {
            @host $(#[$doc])* $name, threads $n, span 1,
            |group, { $($($hb $harg: $hmode $ht,)+)? $($b $arg: $mode $t,)* }| {
                for lane in group.lanes() {
                    $body(group.id * $n + lane, $($(slot!(pass $hmode $harg),)+)? $(slot!(pass $mode $arg)),*);
                }
            }
        }
        kernel!(@buffers $name, { $($head: $shared)? }, { $($arg: $mode $t,)* });
    };
    ($(#[$doc:meta])* group $name:ident = $body:path, threads $n:tt, $(span $span:tt,)?
     shared [$($sh:ident: $len:expr),*],
     $($head:ident: $shared:ty { $($hb:tt $harg:ident: $hmode:ident $ht:ty),+ $(,)? },)?
     { $($b:tt $arg:ident: $mode:ident $t:ty),* $(,)? }) => {
        $(#[$doc])*
        #[cfg(all(target_arch = "spirv", feature = "entry-points"))]
        #[spirv_std::spirv(compute(threads($n), signed_zero_inf_nan_preserve = 32, rounding_mode_rte = 32))]
        pub fn entry(
            #[spirv(workgroup_id)] group: $crate::glam::UVec3,
            #[spirv(num_workgroups)] groups: $crate::glam::UVec3,
            #[spirv(local_invocation_index)] lane: u32,
            $(#[spirv(workgroup)] $sh: &mut [u32; $len],)*
            $($(#[spirv(storage_buffer, descriptor_set = 0, binding = $hb)] $harg: slot!($hmode $ht),)+)?
            $(#[spirv(storage_buffer, descriptor_set = 0, binding = $b)] $arg: slot!($mode $t)),*
        ) {
            let id = group.y * groups.x + group.x;
            let group = $crate::Group { id, lane, width: $n, usual: $crate::Usual::NO };
            $body(group, $($sh,)* $($($harg,)+)? $($arg),*);
        }

        kernel! {
            @host $(#[$doc])* $name, threads $n, span (kernel!(@span $($span)?)),
            |group, { $($($hb $harg: $hmode $ht,)+)? $($b $arg: $mode $t,)* }| {
                // Workgroup memory starts as garbage on a GPU, so it does here.
                $(let mut $sh = [0xDEAD_BEEFu32; $len];)*
                $body(group, $(&mut $sh,)* $($(slot!(pass $hmode $harg),)+)? $(slot!(pass $mode $arg)),*);
            }
        }
        kernel!(@buffers $name, { $($head: $shared)? }, { $($arg: $mode $t,)* });
    };
    (@span) => { 1 };
    (@span $span:tt) => { $span };
    // The kernel as the host dispatches it, and what runs a workgroup.
    (@host $(#[$doc:meta])* $name:ident, threads $n:tt, span $span:tt,
     |$group:ident, { $($b:tt $arg:ident: $mode:ident $t:ty,)+ }| $run:block) => {
        $(#[$doc])*
        #[cfg(not(target_arch = "spirv"))]
        pub const $name: $crate::Kernel = $crate::Kernel {
            path: concat!(module_path!(), "::entry"),
            threads: $n,
            span: $span,
            slots: &[$($crate::Slot {
                name: stringify!($arg), access: slot!(access $mode), stride: size_of::<$t>(),
            }),+],
            run: run_twice!($n, $span, |$group, buffers| {
                $(
                    let raw = buffers[$b];
                    // SAFETY: the contract of `Kernel::run` is that of `Buf::new`.
                    #[allow(unused_mut, reason = "buffers that are only read are passed by & below")]
                    let mut $arg = unsafe {
                        $crate::mem::Buf::<$t>::new(raw.ptr.cast(), raw.len / size_of::<$t>())
                    };
                )+
                $run
                0 $(+ $arg.moved())+
            }),
        };
    };
    // What the host binds.
    (@buffers $name:ident, { $($head:ident: $shared:ty)? }, { $($arg:ident: $mode:ident $t:ty,)* }) => {
        #[doc = concat!("The buffers of [`", stringify!($name), "`].")]
        #[cfg(not(target_arch = "spirv"))]
        #[allow(missing_docs, missing_debug_implementations, reason = "the kernel says what these are")]
        pub struct Buffers<'a, H: $crate::Host> {
            $(pub $head: $shared,)?
            $(pub $arg: slot!(bound $mode 'a H $t)),*
        }

        #[cfg(not(target_arch = "spirv"))]
        impl<'a, H: $crate::Host> $crate::Bindings<'a, H> for Buffers<'a, H> {
            const KERNEL: &'static $crate::Kernel = &$name;
            fn list(self) -> $crate::kernel::Vec<H::Any<'a>> {
                kernel!(@list self, { $($head)? }, [$(slot!(forget $mode H self.$arg)),*])
            }
        }
    };
    (@list $own:ident, { }, [$($buffer:expr),*]) => {
        $crate::kernel::Vec::from([$($buffer),*])
    };
    (@list $own:ident, { $head:ident }, [$($buffer:expr),*]) => {{
        let mut all = $own.$head.list();
        all.extend([$($buffer),*]);
        all
    }};
}
