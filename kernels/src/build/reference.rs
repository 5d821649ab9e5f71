//! References of a level: a triangle, and the box of what its node holds of it.

use super::{SplitPlane, from_bits, is_above, is_below, to_bits};
use crate::{
    bounds::Bounds,
    build::clip::clip_plane,
    glam::{UVec4, Vec4},
    math::component,
    mem::{Buf, Slots},
    mesh,
};
use raykd_shared::Node;

/// A reference in a level's list: two words of four.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// The triangle's number.
    pub triangle: u32,
    /// For [`super::sweep`], the number of its node in the level.
    pub cell: u32,
    /// A box around its part in the node; empty if that has turned out to be nothing.
    pub bounds: Bounds,
}

/// A reference as it stands in a list.
#[derive(Clone, Copy, Debug, Default)]
pub struct Words {
    /// The lower corner of the box, and the triangle's number.
    pub lo: UVec4,
    /// The upper corner, and [`Reference::cell`].
    pub hi: UVec4,
}

impl Words {
    /// Reads reference `i` of a list.
    #[inline(always)]
    pub fn load(list: &Buf<UVec4>, i: u32) -> Self {
        let (lo, hi) = list.two(2 * i);
        Self { lo, hi }
    }

    /// Writes reference `i` of a list.
    #[inline(always)]
    pub fn store(self, list: &mut Buf<UVec4>, i: u32) {
        list.put_two(2 * i, (self.lo, self.hi));
    }

    /// The box.
    #[inline(always)]
    pub fn bounds(self) -> Bounds {
        Bounds { lo: from_bits(self.lo), hi: from_bits(self.hi) }
    }

    /// The reference.
    #[inline(always)]
    pub fn read(self) -> Reference {
        Reference { triangle: self.lo.w, cell: self.hi.w, bounds: self.bounds() }
    }
}

/// The triangle of reference `i` of a list.
#[inline(always)]
pub fn triangle_at(list: &Buf<UVec4>, i: u32) -> u32 {
    list.at(2 * i).w
}

impl Reference {
    /// Elements of a list that one takes.
    pub const ELEMENTS: u32 = 2;

    /// A triangle's reference in the root.
    #[inline(always)]
    pub fn whole(positions: &Buf<f32>, indices: &Buf<u32>, triangle: u32) -> Self {
        let (a, b, c) = mesh::triangle(positions, indices, triangle);
        Self { triangle, cell: 0, bounds: Bounds::of(a, b, c) }
    }

    /// Reads reference `i` of a list.
    #[inline(always)]
    pub fn load(list: &Buf<UVec4>, i: u32) -> Self {
        Words::load(list, i).read()
    }

    /// Writes reference `i` of a list.
    #[inline(always)]
    pub fn store(&self, list: &mut Buf<UVec4>, i: u32) {
        self.words().store(list, i);
    }

    /// As it stands in a list.
    #[inline(always)]
    pub fn words(&self) -> Words {
        Words { lo: to_bits(self.bounds.lo, self.triangle), hi: to_bits(self.bounds.hi, self.cell) }
    }

    /// Boxes around what of it lies below and above a plane that its box straddles.
    #[inline(always)]
    pub fn halves(&self, positions: &Buf<f32>, indices: &Buf<u32>, plane: SplitPlane) -> (Bounds, Bounds) {
        let (a, b, c) = mesh::triangle(positions, indices, self.triangle);
        clip_plane(a, b, c, &self.bounds, plane.axis, plane.at)
    }

    /// [`Reference::sides`] of reference `i` of a list: without branches, half of which a CPU would guess wrong.
    #[inline(always)]
    pub fn sides_at(list: &Buf<UVec4>, i: u32, plane: SplitPlane) -> u32 {
        let numbers = |words: UVec4| Vec4::from_array(words.to_array().map(f32::from_bits));
        let (lo, hi) = (numbers(list.at(2 * i)), numbers(list.at(2 * i + 1)));
        let at = Vec4::splat(plane.at);
        let is_empty = lo.cmpgt(hi).bitmask() & 7 != 0;
        let below = (lo.cmplt(at) | hi.cmple(at)).bitmask() >> plane.axis & 1;
        let above = hi.cmpgt(at).bitmask() >> plane.axis & 1;
        if plane.axis == Node::LEAF {
            1
        } else if is_empty {
            0
        } else {
            below | above << 1
        }
    }

    /// Which children it goes to: bit 0 below, bit 1 above. A leaf keeps all its references below.
    #[inline(always)]
    pub fn sides(&self, plane: SplitPlane) -> u32 {
        if plane.axis == Node::LEAF {
            1
        } else if self.bounds.is_empty() {
            0
        } else {
            let (lo, hi) = (component(self.bounds.lo, plane.axis), component(self.bounds.hi, plane.axis));
            is_below(lo, hi, plane.at) as u32 | ((is_above(hi, plane.at) as u32) << 1)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{glam::Vec3, mem::view};

    /// Boxes before, behind, across, in and at planes on all axes, and empty ones.
    #[test]
    fn both_ways_to_tell_sides_are_one() {
        let at = [-1.0, -0.0, 0.0, 1.0, f32::INFINITY, f32::NEG_INFINITY];
        for (x, y) in at.iter().flat_map(|x| at.map(|y| (*x, y))) {
            for axis in 0..3 {
                let mut bounds = Bounds { lo: Vec3::splat(-2.0), hi: Vec3::splat(2.0) };
                (bounds.lo[axis], bounds.hi[axis]) = (x, y);
                // What is no part of the box has all bits.
                let reference = Reference { triangle: u32::MAX, cell: u32::MAX, bounds };
                let list = [to_bits(bounds.lo, reference.triangle), to_bits(bounds.hi, reference.cell)];
                for across in [0, 1, 2, Node::LEAF] {
                    for at in at {
                        let plane = SplitPlane { axis: across, at, pays: true };
                        let found = Reference::sides_at(&view(&list), 0, plane);
                        assert_eq!(found, reference.sides(plane), "{bounds:?} {plane:?}");
                    }
                }
            }
        }
    }
}
