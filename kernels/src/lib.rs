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
//! `+ - *`, comparisons and exact conversions on `f32` only; quotients by [`math::div`]; no `min`/`max`
//! methods; no float reduction whose order a scheduler decides; no atomic append: count, scan, scatter.
//! `cargo xtask kernels` refuses SPIR-V that breaks the first three.
//!
//! # Features
//! * `traffic`: count the bytes that kernels move on the CPU, which slows them.
#![no_std]

#[macro_use]
mod kernel;
#[macro_use]
mod words;
pub mod math;
pub mod mem;
pub mod mesh;

pub mod build;
pub mod probe;
pub mod trace;

pub use kernel::Group;
#[cfg(not(target_arch = "spirv"))]
pub use kernel::{Access, Bindings, Host, Kernel, Order, RawBuf, Slot};

#[cfg(not(target_arch = "spirv"))]
pub use glam;
#[cfg(target_arch = "spirv")]
pub use spirv_std::glam;

/// Whether this is compiled for a GPU. Where bodies differ, one function or number asks this, and says why.
const ON_GPU: bool = cfg!(target_arch = "spirv");

/// Every kernel, in pipeline order.
#[cfg(not(target_arch = "spirv"))]
pub const KERNELS: &[&Kernel] = &[
    &probe::PROBE,
    &build::survey::vertices::VERTICES,
    &build::survey::indices::INDICES,
    &build::survey::sift::SIFT,
    &build::survey::offsets::OFFSETS,
    &build::survey::collect::COLLECT,
    &build::survey::settle::SETTLE,
    &build::boxes::BOXES,
    &build::alone::ALONE,
    &build::bin::BIN,
    &build::split::SPLIT,
    &build::count::COUNT,
    &build::tally::TALLY,
    &build::alloc::ALLOC,
    &build::scatter::SCATTER,
    &build::treelet::TREELETS,
    &build::place::PLACE,
    &build::top::TOP,
    &build::emit::EMIT,
    &build::sweep::start::START,
    &build::sweep::sort::SORT,
    &build::sweep::weigh::WEIGH,
    &build::sweep::cheapest::CHEAPEST,
    &build::sweep::classify::CLASSIFY,
    &build::sweep::rank::RANK,
    &build::sweep::total::TOTAL,
    &build::sweep::advance::ADVANCE,
    &build::sweep::children::CHILDREN,
    &build::sweep::distribute::DISTRIBUTE,
    &build::sweep::carry::CARRY,
    &build::sweep::insert::INSERT,
    &build::sweep::sizes::SIZES,
    &build::sweep::number::NUMBER,
    &build::sweep::leaves::LEAVES,
    &trace::workgroups::WORKGROUPS,
    &trace::prepare::corners::CORNERS,
    &trace::prepare::corners::transforms::TRANSFORMS,
    &trace::queries::closest::CLOSEST,
    &trace::queries::any::ANY,
    &trace::queries::steps::STEPS,
    &trace::queries::except::EXCEPT,
    &trace::queries::all::ALL_HITS,
    &trace::queries::moeller::MOELLER,
    &trace::queries::plane::PLANE,
    &trace::queries::baldwin::BALDWIN,
    &trace::queries::woop::WOOP,
    &trace::queries::exact::EXACT,
    &trace::queries::brute_strict::BRUTE_STRICT,
    &trace::queries::brute_exact::BRUTE_EXACT,
    &trace::queries::brute_moeller::BRUTE_MOELLER,
    &trace::queries::brute_plane::BRUTE_PLANE,
    &trace::queries::brute_baldwin::BRUTE_BALDWIN,
    &trace::queries::brute_woop::BRUTE_WOOP,
    &trace::prepare::parents::PARENTS,
    &trace::prepare::node_boxes::NODE_BOXES,
    &trace::prepare::rope_links::ROPE_LINKS,
    &trace::queries::restart::RESTART,
    &trace::queries::pushdown::PUSHDOWN,
    &trace::queries::shortstack1::SHORTSTACK1,
    &trace::queries::shortstack2::SHORTSTACK2,
    &trace::queries::shortstack4::SHORTSTACK4,
    &trace::queries::shortstack8::SHORTSTACK8,
    &trace::queries::backtrack::BACKTRACK,
    &trace::queries::ropes::ROPES,
    &trace::queries::optimised_ropes::OPTIMISED_ROPES,
    &trace::queries::sequential::SEQUENTIAL,
];

/// All kernels as one SPIR-V module, made by `cargo xtask kernels`; its entry points are
/// [`Kernel::entry_point`].
#[cfg(not(target_arch = "spirv"))]
pub const SPIRV: &[u8] = include_bytes!("../spv/raykd.spv");
