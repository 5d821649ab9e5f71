//! The memory layouts of raykd, as the kernels write them and as other crates can read them.
//!
//! Everything here is `no_std`, plain data (`bytemuck::Pod`), little-endian, made of 4-byte fields:
//!
//! | type | bytes | what |
//! |---|---|---|
//! | [`Node`] | 8 | split plane + axis + child pair, or a leaf's range of references |
//! | [`TreeHeader`] | 64 | bounds, counts, depth, scale and SAH costs of one tree |
//! | [`Ray`] | 32 | origin, direction, `t_min`, `t_max` |
//! | [`Hit`] | 16 | triangle, `t`, barycentric `u`, `v` |
//!
//! A tree is a header, `nodes: [Node]` with the root at 0, and `refs: [u32]`, the triangle list its leaves
//! index. [`TreeView`] borrows the three and [`TreeView::validate`] checks them.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(feature = "alloc")]
extern crate alloc;

pub mod limits;
mod node;
mod params;
mod ray;
pub mod status;
mod tree;

pub use node::{Content, Node};
pub use params::{BuildParams, rule};
pub use ray::{Hit, MISS, Ray};
pub use tree::{Fault, LAYOUT_VERSION, Report, TreeHeader, TreeView};

// The layouts are defined as little-endian bytes and used as they lie in memory.
#[cfg(all(target_endian = "big", not(target_arch = "spirv")))]
compile_error!("raykd's layouts are little-endian");
