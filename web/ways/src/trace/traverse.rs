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
use raykd_kernels::trace::traverse;
use raykd_shared::Node;
use std::ops::{Deref, DerefMut};

/// As in the kernels; leaves are written down, too.
#[derive(Debug)]
pub struct Steps {
    counts: traverse::Steps,
    log: Log,
}

impl Steps {
    pub fn new(log: &Log) -> Self {
        Self { counts: traverse::Steps::default(), log: log.clone() }
    }

    pub fn visit(&mut self, leaf: Node) {
        self.counts.visit(leaf);
        self.log.add(Seen::Leaf(leaf.first()));
    }
}

impl Deref for Steps {
    type Target = traverse::Steps;
    fn deref(&self) -> &traverse::Steps {
        &self.counts
    }
}

impl DerefMut for Steps {
    fn deref_mut(&mut self) -> &mut traverse::Steps {
        &mut self.counts
    }
}
