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
//! | [`WideNode`] | 80 | eight boxes of a byte a face, for the traversal `wide` |
//!
//! A tree is a header, `nodes: [Node]` with the root at 0, and `refs: [u32]`, the triangle list its leaves
//! index. [`TreeView`] borrows the three and [`TreeView::validate`] checks them.
//! A tree file, as `raykd build -o` writes it, is the 8 bytes `raykd-kd`, [`LAYOUT_VERSION`] as `u32`, the three in
//! this order, and the SHA-256 of all that in 32 bytes, with nothing between.
//!
//! ```
//! use bytemuck::Zeroable;
//! use raykd_shared::{Content, Node, TreeHeader, TreeView};
//!
//! // A box cut at x = 0.5: triangle 0 lies below the split plane, triangle 1 above.
//! let nodes = [Node::inner(0, 0.5, 2), Node::PADDING, Node::leaf(0, 1), Node::leaf(1, 1)];
//! let refs = [0, 1];
//! let mut header = TreeHeader {
//!     hi: [1.0; 3],
//!     nodes: 4,
//!     refs: 2,
//!     triangles: 2,
//!     depth: 1,
//!     scale: 1.0,
//!     ..TreeHeader::zeroed()
//! };
//! header.checksum = TreeView { header: &header, nodes: &nodes, refs: &refs }.checksum();
//! let tree = TreeView { header: &header, nodes: &nodes, refs: &refs };
//! assert_eq!(tree.validate().unwrap().leaves, 2);
//!
//! // The leaf around a point.
//! let point = [0.7, 0.2, 0.2];
//! let mut node = nodes[0];
//! while let Content::Inner { axis, split, below } = node.content() {
//!     let above = point[axis as usize] * header.scale > split;
//!     node = nodes[below as usize + usize::from(above)];
//! }
//! assert_eq!(refs[node.first() as usize..][..node.count() as usize], [1]);
//! ```
//!
//! The crate `raykd` builds such trees and traces rays through them.
//!
//! # Features
//! * `alloc` (default): [`TreeView::validate`]. Without it there is [`TreeView::validate_in`].
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
mod wide;

pub use node::{Content, Node};
pub use params::{BuildParams, rule};
pub use ray::{Crossings, Hit, MISS, Ray};
pub use tree::{Fault, LAYOUT_VERSION, Report, TreeHeader, TreeView};
pub use wide::WideNode;

// The layouts are defined as little-endian bytes and used as they lie in memory.
#[cfg(all(target_endian = "big", not(target_arch = "spirv")))]
compile_error!("raykd's layouts are little-endian");
