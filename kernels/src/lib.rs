//! The kernels of raykd: one body each, for CPU and GPU.
//!
//! The crate `raykd` dispatches them. Use this crate alone to run the compiled module with another Vulkan
//! library, or to look into a kernel:
//!
//! ```
//! use raykd_kernels::{KERNELS, SPIRV};
//!
//! assert_eq!(SPIRV[..4], 0x0723_0203u32.to_le_bytes(), "a SPIR-V module");
//! for kernel in KERNELS {
//!     println!("{}: {} lanes a workgroup", kernel.entry_point(), kernel.threads);
//!     for slot in kernel.slots {
//!         println!("    {}: {:?}, {} bytes an element", slot.name, slot.access, slot.stride);
//!     }
//! }
//! ```
//!
//! # Bodies
//! A kernel body is an ordinary function over buffers ([`mem::Buf`]). Two forms cover everything:
//!
//! * a **map** kernel is a function of one index: one invocation, one slot;
//! * a **group** kernel is a function of one workgroup whose steps are written in [`lanes!`](crate::lanes)
//!   blocks: on the GPU a block is one lane's work followed by a barrier, on the CPU a loop over all lanes.
//!
//! `kernel!` turns a body into a SPIR-V entry point (by rust-gpu) and, on the CPU, into a [`Kernel`] that the
//! host dispatches and a struct `Buffers`, in which the host names what it binds. All come from one
//! declaration, so bindings cannot disagree.
//!
//! # Rules for results that must agree to the bit
//! `+ - *`, comparisons and exact conversions on `f32` only; quotients by [`math::div`], or by [`math::ratio`] where a
//! bound of its error is enough; rounding errors of products by [`math::two_product`]; no `min`/`max` methods; no float
//! reduction whose order a scheduler decides; no atomic append: count, scan, scatter.
//! The crate `raykd-spirv`, which compiles them, refuses SPIR-V that breaks the first two, and `min` and `max` if they
//! become instructions of a GPU's.
//!
//! # In a shader of your own
//! A crate that rust-gpu compiles may depend on this one, and trace rays in kernels of its own: a
//! [`trace::single::Tree`] over a scene's buffers answers on a GPU what it answers on a CPU, to the bit. So a function
//! that takes one runs on both:
//!
//! ```
//! use raykd_kernels::trace::single::Tree;
//! use raykd_shared::Ray;
//!
//! /// How many of four rays straight up meet something.
//! pub fn covered(tree: &Tree<'_>, [x, y, z]: [f32; 3]) -> u32 {
//!     let (mut i, mut hits) = (0, 0);
//!     while i < 4 {
//!         let from = [x + (i & 1) as f32, y + (i >> 1) as f32, z];
//!         hits += tree.any(&Ray::new(from, [0.0, 0.0, 1.0])).is_some() as u32;
//!         i += 1;
//!     }
//!     hits
//! }
//! ```
//!
//! and its kernel makes the tree of storage buffers, which `Scene::buffers` of the crate `raykd` offers:
//!
//! ```ignore
//! #[spirv_std::spirv(compute(threads(64)))]
//! pub fn kernel(
//!     #[spirv(global_invocation_id)] id: UVec3,
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] header: &TreeHeader,
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] nodes: &[UVec4],
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] corners: &[Vec4],
//!     // ...
//! ) {
//!     let tree = Tree::of_buffers(header, nodes, corners);
//!     // ...
//! }
//! ```
//!
//! The crate `raykd-spirv` compiles it, and refuses what would not be the same bytes everywhere. spirv-std must be
//! version 0.10.0. raykd's own entry points are left out; the feature `entry-points` would put them in. The folder
//! `examples/own_kernel` of raykd's repository has a whole program.
//!
//! # Features
//! * `entry-points`: in SPIR-V, every kernel is an entry point. For raykd's own module; on a CPU it changes nothing.
//! * `doubles`: the same for kernels that need doubles, raykd's second module.
//! * `traffic`: count the bytes that kernels move on the CPU, which slows them.
#![cfg_attr(target_arch = "spirv", feature(asm_experimental_arch))]
#![no_std]
#![allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#![cfg_attr(
    not(target_arch = "x86_64"),
    allow(dead_code, unused_imports, reason = "what only a CPU uses, or one with AVX2")
)]

#[cfg(not(target_arch = "spirv"))]
extern crate alloc as heap;

#[macro_use]
mod kernel;
#[macro_use]
mod words;
pub mod bounds;
#[cfg(target_arch = "x86_64")]
mod eight;
pub mod math;
pub mod mem;
pub mod mesh;
pub mod pair;

pub mod build;
pub mod probe;
pub mod trace;

#[cfg(not(target_arch = "spirv"))]
pub use kernel::{Access, Bindings, Host, Kernel, Order, RawBuf, Slot};
pub use kernel::{Group, Usual, put_groups};

#[cfg(not(target_arch = "spirv"))]
pub use glam;
#[cfg(target_arch = "spirv")]
pub use spirv_std::glam;

/// Whether this is compiled for a GPU. Where bodies differ, one function or number asks this, and says why.
const ON_GPU: bool = cfg!(target_arch = "spirv");

/// Every kernel that any device can run, in pipeline order.
#[cfg(not(target_arch = "spirv"))]
pub const KERNELS: &[&Kernel] = &{
    const LISTS: [&[&Kernel]; 12] = [
        &[&probe::PROBE],
        build::survey::KERNELS,
        build::KERNELS,
        build::radix::KERNELS,
        build::sweep::KERNELS,
        build::wide::KERNELS,
        trace::prepare::KERNELS,
        trace::queries::KERNELS,
        trace::all::KERNELS,
        trace::crossings::KERNELS,
        trace::intersect::KERNELS,
        trace::traverse::KERNELS,
    ];
    const COUNT: usize = {
        let (mut count, mut list) = (0, 0);
        while list < LISTS.len() {
            count += LISTS[list].len();
            list += 1;
        }
        count
    };
    let mut all = [&probe::PROBE; COUNT];
    let (mut list, mut next) = (0, 0);
    while list < LISTS.len() {
        let mut i = 0;
        while i < LISTS[list].len() {
            all[next] = LISTS[list][i];
            (i, next) = (i + 1, next + 1);
        }
        list += 1;
    }
    all
};

/// Kernels that need doubles: their results are those of others, sooner where doubles are quick.
#[cfg(not(target_arch = "spirv"))]
pub const BY_DOUBLES: &[&Kernel] = &[
    &probe::doubles::PROBE_DOUBLES,
    &probe::race::RACE,
    &trace::traverse::settle::by_doubles::SETTLE_BY_DOUBLES,
];

/// [`KERNELS`] as one SPIR-V module, made by `cargo xtask kernels`; its entry points are
/// [`Kernel::entry_point`].
#[cfg(not(target_arch = "spirv"))]
pub const SPIRV: &[u8] = include_bytes!("../spv/raykd.spv");

/// [`BY_DOUBLES`] as one SPIR-V module, for devices with the feature `SHADER_F64`.
#[cfg(not(target_arch = "spirv"))]
pub const SPIRV_BY_DOUBLES: &[u8] = include_bytes!("../spv/doubles.spv");
