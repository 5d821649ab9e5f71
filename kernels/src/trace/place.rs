//! A node and where it stands.

use crate::{
    glam::UVec4,
    mem::{Buf, Slots},
};
use raykd_shared::Node;

/// A node and its number.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The node.
    pub node: Node,
    /// Its number.
    pub index: u32,
}

impl Place {
    /// Loads node `index`.
    #[inline(always)]
    pub fn load(index: u32, pairs: &Buf<UVec4>) -> Self {
        let pair = pairs.at(index >> 1);
        let node =
            if index & 1 == 0 { Node::from_words(pair.x, pair.y) } else { Node::from_words(pair.z, pair.w) };
        Self { node, index }
    }
}
