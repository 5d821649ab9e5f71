//! References that list a ray's triangles, up to eight, as one kernel hands them to another in two buffers of four
//! words a ray.

use crate::{glam::UVec4, mem::Slots};

/// Stands for no reference, behind the last. References are smaller, which leaves two bits of a word for marks.
pub const NONE: u32 = 0x3FFF_FFFF;

/// Four references from number `first` on, of `count` that are kept, one each so many words from a word on.
#[inline(always)]
pub fn four(own: &impl Slots<u32>, (from, each): (u32, u32), count: u32, first: u32) -> UVec4 {
    let one = move |i: u32| if i < count { own.at(from + each * i) } else { NONE };
    UVec4::new(one(first), one(first + 1), one(first + 2), one(first + 3))
}

/// References, to be looked at one after the other.
#[derive(Clone, Copy, Debug)]
pub struct Listed {
    now: UVec4,
    later: UVec4,
}

impl Listed {
    /// Of those of both buffers.
    #[inline(always)]
    pub fn new(now: UVec4, later: UVec4) -> Self {
        Self { now, later }
    }

    /// The first one, [`NONE`] if there are no more.
    #[inline(always)]
    pub fn first(&self) -> u32 {
        self.now.x
    }

    /// Goes on to the next.
    #[inline(always)]
    pub fn pass(&mut self) {
        self.now = UVec4::new(self.now.y, self.now.z, self.now.w, self.later.x);
        self.later = UVec4::new(self.later.y, self.later.z, self.later.w, NONE);
    }
}
