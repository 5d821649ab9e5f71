//! Where a ray crosses the plane of a node: the one rule of every traversal but `stack`, which has it inlined.
//!
//! A plane is `pad` thick on either side (see frame.rs), so a ray is inside it from `first` to `last`. The near
//! child may hold hits up to `last`, the far one hits from `first` on; in between, both.

use crate::{
    glam::UVec4,
    math::{Digits, component},
    mem::{Buf, Slots},
    trace::{frame::Frame, place::Place},
};
use raykd_shared::Node;

/// The children of an inner node in the ray's order, and the interval of `t` inside the plane between them.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// The child that the ray comes to first.
    pub near: Place,
    /// The other.
    pub far: Place,
    /// Before this `t` the ray is on the near side.
    pub first: f32,
    /// After this `t` it is on the far side.
    pub last: f32,
}

impl Crossing {
    /// Loads the children of `node` with one load.
    #[inline(always)]
    pub fn new(ray: &Frame, node: Node, pairs: &Buf<UVec4>) -> Self {
        let pair = pairs.at(node.below() >> 1);
        let below = Place { node: Node::from_words(pair.x, pair.y), index: node.below() };
        let above = Place { node: Node::from_words(pair.z, pair.w), index: node.below() + 1 };
        let back = component(ray.inverse, node.axis()) < 0.0;
        let (first, last) = thick(ray, node.axis(), node.split());
        Self { near: if back { above } else { below }, far: if back { below } else { above }, first, last }
    }

    /// Whether a ray that enters the node at `enter` goes on to the far child alone, if it is `reached`: it
    /// is past the near one, or that is an empty leaf, not worth a visit.
    #[inline(always)]
    pub fn skips_near(&self, enter: f32, reached: bool) -> bool {
        self.last < enter || (reached && self.near.node.is_empty())
    }
}

/// From and to which `t` a ray is inside the thick plane across `axis` at `position`.
#[inline(always)]
pub fn thick(ray: &Frame, axis: u32, position: f32) -> (f32, f32) {
    let inverse = component(ray.inverse, axis);
    let (at, wide) = crossed(position, component(ray.origin, axis), inverse, ray.pad);
    (at - wide, at + wide)
}

/// The `t` at which rays cross a plane, and for how long before and after they are inside it, by what is known of them
/// on its axis.
#[inline(always)]
pub fn crossed<N: Digits>(position: N, origin: N, inverse: N, pad: N) -> (N, N) {
    let at = (position - origin) * inverse;
    (at, (pad * inverse).abs())
}
