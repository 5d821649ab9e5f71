//! As in the kernels, but that nobody hears of it: a node is visited when its children are read.

use crate::{glam::UVec4, mem::Buf};
use raykd_shared::Node;

/// A node and its number.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) node: Node,
    pub(crate) index: u32,
}

impl Place {
    pub(crate) fn load(index: u32, pairs: &Buf<UVec4>) -> Self {
        let pair = pairs.peek(index >> 1);
        let (word0, word1) = if index & 1 == 0 { (pair.x, pair.y) } else { (pair.z, pair.w) };
        Self { node: Node::from_words(word0, word1), index }
    }
}
