//! The next hits of a ray, several by one walk.

use super::{
    Steps,
    leaf::{Choice, LeafTriangle},
    stack::walk_keeping,
};
use crate::{
    glam::{UVec4, Vec4},
    math::high,
    mem::{Buf, Slots},
    trace::{
        frame::Frame,
        intersect::{Best, Intersector},
    },
};

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

    /// A hit's place.
    #[inline(always)]
    pub fn of(hit: &Best) -> Self {
        Self { t: hit.t, triangle: hit.triangle }
    }

    /// Goes on behind a hit: nothing before it counts from now on, or is looked for.
    #[inline(always)]
    pub fn pass(&mut self, ray: &mut Frame, hit: &Best) {
        *self = Self::of(hit);
        ray.enter = high(ray.enter, hit.t);
    }

    /// Whether a hit comes after this one.
    #[inline(always)]
    pub fn precedes(self, hit: &Best) -> bool {
        hit.t > self.t || (hit.t == self.t && hit.triangle > self.triangle)
    }
}

/// How many hits [`Next`] keeps.
pub const AT_ONCE: u32 = 8;
/// How many hits there are.
const COUNT: u32 = 0;
/// The hits, in order.
const HITS: u32 = COUNT + 1;
/// Words of a hit: `t`, triangle, and the weights `u`, `v` and `det`.
const EACH: u32 = 5;
/// Words that [`Next`] keeps.
pub const WORDS: usize = (HITS + AT_ONCE * EACH) as usize;

/// Keeps the first [`AT_ONCE`] hits that come after another, in order. A triangle may be listed in several leaves, but
/// of the hits kept each is there once.
#[derive(Clone, Copy, Debug)]
pub struct Next(pub After);

impl Next {
    /// Forgets all hits.
    #[inline(always)]
    pub(in crate::trace) fn clear(own: &mut impl Slots<u32>) {
        own.put(COUNT, 0);
    }

    /// How many hits there are.
    #[inline(always)]
    pub(in crate::trace) fn count(own: &impl Slots<u32>) -> u32 {
        own.at(COUNT)
    }

    /// Hit `i`.
    #[inline(always)]
    pub fn hit(own: &impl Slots<u32>, i: u32) -> Best {
        let at = HITS + EACH * i;
        Best {
            t: f32::from_bits(own.at(at)),
            triangle: own.at(at + 1),
            u: f32::from_bits(own.at(at + 2)),
            v: f32::from_bits(own.at(at + 3)),
            det: f32::from_bits(own.at(at + 4)),
        }
    }

    /// Puts a hit where it belongs, if it is not there.
    #[inline(always)]
    fn insert(own: &mut impl Slots<u32>, hit: &Best) {
        let count = Self::count(own);
        let mut place = 0;
        let mut before = true;
        let mut there = false;
        while place < count && before {
            let at = HITS + EACH * place;
            let (t, triangle) = (f32::from_bits(own.at(at)), own.at(at + 1));
            before = t < hit.t || (t == hit.t && triangle < hit.triangle);
            there |= triangle == hit.triangle;
            place += before as u32;
        }
        if !there {
            let full = count == AT_ONCE;
            let mut word = HITS + EACH * if full { AT_ONCE } else { count + 1 };
            let first = HITS + EACH * place;
            while word > first + EACH {
                word -= 1;
                own.put(word, own.at(word - EACH));
            }
            own.put(first, hit.t.to_bits());
            own.put(first + 1, hit.triangle);
            own.put(first + 2, hit.u.to_bits());
            own.put(first + 3, hit.v.to_bits());
            own.put(first + 4, hit.det.to_bits());
            own.put(COUNT, if full { count } else { count + 1 });
        }
    }
}

#[cfg(not(target_arch = "spirv"))]
impl Next {
    /// Whether a triangle's hit is kept.
    pub(in crate::trace) fn has(own: &[u32; WORDS], triangle: u32) -> bool {
        (0..Self::count(own)).any(|i| own[(HITS + EACH * i + 1) as usize] == triangle)
    }

    /// Keeps a hit if it is one of the next, of which the last may be at `last`. Returns where the last may be then.
    pub(in crate::trace) fn keep(own: &mut [u32; WORDS], hit: &Best, last: f32) -> f32 {
        let full = Self::count(own) == AT_ONCE;
        if !full || After::of(hit).precedes(&Self::hit(own, AT_ONCE - 1)) {
            Self::insert(own, hit);
        }
        if Self::count(own) == AT_ONCE { Self::hit(own, AT_ONCE - 1).t } else { last }
    }
}

impl<I: Intersector> Choice<I> for Next {
    #[inline(always)]
    fn test(
        self,
        by: I,
        ray: &Frame,
        triangle: LeafTriangle<I>,
        best: &mut Best,
        own: &mut impl Slots<u32>,
    ) -> bool {
        let mut hit = Best { t: best.t, triangle: best.triangle, ..Best::NOTHING };
        let whole = triangle.test(by, ray, &mut hit);
        if hit.triangle != best.triangle && self.0.precedes(&hit) {
            Self::insert(own, &hit);
            // Of a full list the last is what others must be better than.
            if Self::count(own) == AT_ONCE {
                *best = Self::hit(own, AT_ONCE - 1);
            }
        }
        whole
    }
}

/// Finds the next hits `after` one by a walk, and goes on behind the last of them. Returns how many there are; if fewer
/// than [`AT_ONCE`], no others come.
#[inline(always)]
pub(in crate::trace) fn next_hits<I: Intersector>(
    ray: &mut Frame,
    (pairs, corners): (&Buf<UVec4>, &Buf<Vec4>),
    after: &mut After,
    aside: &mut impl Slots<u32>,
    own: &mut impl Slots<u32>,
    steps: &mut Steps,
) -> u32 {
    Next::clear(own);
    walk_keeping::<I, Next, false>(ray, pairs, corners, Next(*after), false, aside, own, steps);
    let count = Next::count(own);
    if count == AT_ONCE {
        after.pass(ray, &Next::hit(own, AT_ONCE - 1));
    }
    count
}
