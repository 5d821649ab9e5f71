//! What counts the steps of a traversal.

use crate::mem::{Log, Seen};
use raykd_kernels::trace::traverse;
use raykd_shared::Node;
use std::ops::{Deref, DerefMut};

/// As in the kernels; leaves are written down, too.
#[derive(Debug)]
pub(crate) struct Steps {
    counts: traverse::Steps,
    log: Log,
}

impl Steps {
    pub(crate) fn new(log: &Log) -> Self {
        Self { counts: traverse::Steps::default(), log: log.clone() }
    }

    pub(crate) fn visit(&mut self, leaf: Node) {
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
