//! The visit of a leaf, the same for every traversal: each triangle it lists is tested.

use super::{
    corners::NORMAL,
    frame::Frame,
    triangle::{Best, may_hit, test},
};
use crate::{
    glam::Vec4,
    mem::{Buf, Slots},
};
use raykd_shared::Node;

/// A hit that others come after: by larger `t`, or at the same `t` by a larger triangle number.
#[derive(Clone, Copy, Debug)]
pub struct After {
    /// Its scaled ray parameter.
    pub t: f32,
    /// Its triangle.
    pub triangle: u32,
}

impl After {
    /// Before every hit.
    pub const NOTHING: Self = Self { t: f32::NEG_INFINITY, triangle: 0 };

    #[inline(always)]
    fn precedes(self, hit: &Best) -> bool {
        hit.t > self.t || (hit.t == self.t && hit.triangle > self.triangle)
    }
}

/// Tests the triangles of `leaf`, with `AFTER` counting only hits after that one. Returns whether it got through
/// all: some software drivers leave a loop after so many rounds whatever its condition says.
#[inline(always)]
pub fn visit<const AFTER: bool>(
    ray: &Frame,
    leaf: Node,
    corners: &Buf<Vec4>,
    after: After,
    best: &mut Best,
) -> bool {
    // A descent that was cut short did not arrive at a leaf. Compilers take the opposite of a loop's condition for
    // granted after the loop, so what is checked here must not look like it.
    let arrived = (leaf.words().1 | !Node::LEAF) == u32::MAX;
    let mut r = leaf.first();
    let end = if arrived { r + leaf.count() } else { r };
    while r < end {
        // On a GPU lanes look for a triangle that may be hit, wait for each other, then test theirs together.
        let mut found = false;
        while r < end && !found {
            let (a, b, c) = corners.three(3 * r);
            found = may_hit(ray, a.truncate(), b.truncate(), c.truncate());
            r += 1;
        }
        if found {
            let (a, b, c) = corners.three(3 * (r - 1));
            let id = a.w.to_bits() & !NORMAL;
            if AFTER {
                let mut hit = *best;
                test(ray, id, a.truncate(), b.truncate(), c.truncate(), &mut hit);
                if after.precedes(&hit) {
                    *best = hit;
                }
            } else {
                test(ray, id, a.truncate(), b.truncate(), c.truncate(), best);
            }
        }
    }
    arrived && r == end
}
