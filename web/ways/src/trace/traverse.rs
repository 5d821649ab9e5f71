//! The traversals, and what counts their steps.

#[path = "../../../../kernels/src/trace/traverse/backtrack.rs"]
pub mod backtrack;
#[path = "../../../../kernels/src/trace/traverse/crossing.rs"]
pub mod crossing;
#[path = "../../../../kernels/src/trace/traverse/leaf.rs"]
pub mod leaf;
#[path = "../../../../kernels/src/trace/traverse/pushdown.rs"]
pub mod pushdown;
#[path = "../../../../kernels/src/trace/traverse/restart.rs"]
pub mod restart;
#[path = "../../../../kernels/src/trace/traverse/ropes.rs"]
pub mod ropes;
#[path = "../../../../kernels/src/trace/traverse/sequential.rs"]
pub mod sequential;
#[path = "../../../../kernels/src/trace/traverse/shortstack.rs"]
pub mod shortstack;
#[path = "../../../../kernels/src/trace/traverse/stack.rs"]
pub mod stack;
pub use raykd_kernels::trace::traverse::trail;

use crate::mem::{Log, Seen};
use raykd_shared::Node;

/// As in the kernels; leaves are written down, too.
#[derive(Debug)]
pub struct Steps {
    pub inner: u32,
    pub leaves: u32,
    pub tests: u32,
    pub turns: u32,
    pub status: u32,
    log: Log,
}

impl Steps {
    pub fn new(log: &Log) -> Self {
        Self { inner: 0, leaves: 0, tests: 0, turns: 0, status: 0, log: log.clone() }
    }

    pub fn visit(&mut self, leaf: Node) {
        self.leaves += 1;
        self.tests += leaf.count();
        self.log.add(Seen::Leaf(leaf.first()));
    }
}
