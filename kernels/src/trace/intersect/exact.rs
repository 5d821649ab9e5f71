//! The test without rounding: a triangle is hit if, and only if, the ray's line passes through it or its
//! border, on the numbers as they are; `t`, `u` and `v` are correctly rounded.
//!
//! Stages, each for what the one before leaves open: floats turn away triangles that the ray passes at more than they
//! round, or that surely lie behind it or a hit that it has (`bounds.rs`); pairs of floats ([`pair`](crate::pair)), on
//! a CPU and on some GPUs doubles, find signs and quotients with bounds of their errors, but for a `t` next to 0, which
//! the volume of triangle and origin gives (`filter.rs`, `by_doubles.rs`); what those do not decide, one triangle of
//! some thousands, triples do ([`triple`](super::triple)), or pairs of doubles; and what is left after those, such as
//! rays exactly through an edge, integers do ([`integers`]). The filters follow Shewchuk 1997, the sheared edge
//! functions Woop, Benthin & Wald 2013.
//!
//! Since answers are exact, neighbours need not agree about anything, and what was decided in which stage
//! does not show. Numbers of any size count, but origins' that would be subnormal in the scaled scene, and
//! distances `t` that would.

use super::{
    Best, Corners, Glance, Intersector,
    bounds::{Edges, bounds},
    by_doubles::by_doubles,
    filter::{First, Line, Place, Turned, Verdict, all_turned, by, turned},
    integers,
    strict::Mirrored,
    triple::Triple,
    vertices,
    wide::Wide,
};
use crate::{pair::Long, trace::frame::Frame};

/// The test.
#[derive(Clone, Copy, Debug)]
pub struct Exact;

impl Exact {
    /// What floats tell.
    #[inline(always)]
    pub(in crate::trace) fn glance(self, ray: &Frame, corners: Corners, seen: Mirrored) -> Glance {
        bounds(ray, &seen.righted(ray), vertices(corners))
    }

    /// [`Exact::test`] without that look.
    #[inline(always)]
    pub fn settle(self, ray: &Frame, id: u32, corners: Corners, best: &mut Best) -> bool {
        let found = self.stage::<First>(ray, id, corners, best);
        self.go_on::<Triple>(found, ray, id, corners, best)
    }

    /// The same for a GPU that has doubles.
    #[inline(always)]
    pub(in crate::trace) fn settle_by_doubles(
        self,
        ray: &Frame,
        id: u32,
        corners: Corners,
        best: &mut Best,
    ) -> bool {
        let seen = Placed::new(ray, corners);
        let after = id > best.triangle;
        let found = by_doubles(&seen.line, &seen.corners, seen.place(), best.t, after);
        self.go_on::<Wide>(found, ray, id, corners, best)
    }

    /// The stages after the second, of which the first is by these numbers, if that left something open.
    #[inline(always)]
    fn go_on<L: Long>(
        self,
        mut found: Verdict,
        ray: &Frame,
        id: u32,
        corners: Corners,
        best: &mut Best,
    ) -> bool {
        let mut whole = true;
        if !found.certain {
            found = self.stage::<L>(ray, id, corners, best);
        }
        if !found.certain {
            let (a, b, c) = vertices(corners);
            let answer = integers::cross(ray.origin, ray.heading, a, b, c);
            found = Verdict { certain: true, hit: answer.hit, t: answer.t, u: answer.u, v: answer.v };
            whole = answer.whole;
        }
        if found.hit {
            best.offer(ray, Best { t: found.t, triangle: id, u: found.u, v: found.v, det: 1.0 });
        }
        whole
    }

    /// What numbers of this kind tell of the triangle.
    #[inline(always)]
    fn stage<L: Long>(self, ray: &Frame, id: u32, corners: Corners, best: &Best) -> Verdict {
        let seen = Placed::new(ray, corners);
        by::<L>(&seen.line, &seen.corners, seen.place(), best.t, id > best.triangle)
    }
}

/// A ray and a triangle for the stages after the first.
struct Placed {
    line: Line<f32>,
    /// The corners with the ray's main axis last.
    corners: [Turned<f32>; 3],
    /// The ray's origin and the corners with axes in their own order.
    from: Turned<f32>,
    own: [Turned<f32>; 3],
}

impl Placed {
    #[inline(always)]
    fn new(ray: &Frame, corners: Corners) -> Self {
        let vertices = vertices(corners);
        Self {
            line: Line::of(ray),
            corners: all_turned(vertices, ray.main),
            from: turned(ray.origin, 2),
            own: all_turned(vertices, 2),
        }
    }

    #[inline(always)]
    fn place(&self) -> Place<'_> {
        (&self.from, &self.own)
    }
}

impl Intersector for Exact {
    type Seen = Mirrored;

    const LOOPS: bool = true;
    const WHOLE: bool = true;

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    #[inline(always)]
    fn look(self, ray: &Frame, corners: Corners) -> (Mirrored, bool) {
        let seen = Mirrored::new(ray, vertices(corners));
        (seen, Edges::new(seen.image(), ray.pad).may_hit())
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, corners: Corners, seen: Mirrored, best: &mut Best) -> bool {
        // The triangle that a ray starts on, most of all, and one that it has met in another leaf.
        let Glance { near, later, .. } = self.glance(ray, corners, seen);
        let passed = later < ray.t_min || near > best.t || near > ray.t_max || id == best.triangle;
        passed || self.settle(ray, id, corners, best)
    }
}

// A GPU has `narrow`.
#[cfg(not(target_arch = "spirv"))]
with_stack!(EXACT(crate::trace::side_by_side::exact) = Exact);
test!(brute_exact::BRUTE_EXACT = Exact);

#[cfg(test)]
mod tests {
    use super::super::strict::shear;
    use super::*;
    use crate::pair::Pair;
    use crate::{glam::Vec3, math::exp2};
    use bytemuck::Zeroable as _;
    use raykd_shared::{Ray, TreeHeader};

    /// Random bits of a seed, Marsaglia's xorshift.
    struct Bits(u64);

    impl Bits {
        fn below(&mut self, n: u64) -> u64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 16) % n
        }

        /// From -1 to 1.
        fn unit(&mut self) -> f32 {
            self.below(1 << 24) as f32 / (1 << 23) as f32 - 1.0
        }
    }

    /// A triangle that a ray meets: of any size from the scene's to a millionth of it, blunt or thin, square to the ray
    /// or grazed, near the ray's origin or far off, some at an edge.
    fn met(bits: &mut Bits) -> (Ray, [Vec3; 3]) {
        let mut vector = || Vec3::new(bits.unit(), bits.unit(), bits.unit());
        let (origin, at, one, two) = (vector(), vector(), vector(), vector());
        let mut power = |most: u64| exp2(-(bits.below(most) as i32));
        let (size, thin, near, graze) = (power(20), power(14), power(24), power(14));
        let at = origin + (at - origin) * near;
        let way = at - origin;
        let two = if bits.below(2) == 0 { two } else { way * (1.0 / size) + two * graze };
        let (u, v) = (bits.unit().abs(), bits.unit().abs());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let u = if bits.below(8) == 0 { 0.0 } else { u };
        let (one, two) = (one * size, two * (size * thin));
        let a = at - one * u - two * v;
        (Ray::new(origin.to_array(), way.to_array()), [a, a + one, a + two])
    }

    /// A triangle of few digits, and a ray exactly through an edge or a vertex of it.
    fn on_edge(bits: &mut Bits) -> (Ray, [Vec3; 3]) {
        let mut vector = |digits: u64| {
            let mut whole = || (bits.below(2 << digits) as i32 - (1 << digits)) as f32 * exp2(-20);
            Vec3::new(whole(), whole(), whole())
        };
        let (origin, a, c, step) = (vector(20), vector(19), vector(19), vector(14));
        let b = a + step * 16.0;
        let way = a + step * bits.below(17) as f32 - origin;
        (Ray::new(origin.to_array(), way.to_array()), [a, b, c])
    }

    /// A triangle, and a ray that passes one of its edges by at most `2^-53` of how far that goes to either side.
    fn beside_edge(bits: &mut Bits) -> (Ray, [Vec3; 3]) {
        let slope = 1 + bits.below(3) as i32;
        let mut end = |sign: i32| {
            let y = sign * (1 << 20 | bits.below(1 << 20) as i32);
            Vec3::new((slope * y) as f32, y as f32, exp2(22)) * exp2(-22)
        };
        let (a, b) = (end(-1), end(1));
        let c = Vec3::new(bits.unit(), bits.unit(), 1.0);
        let y = bits.below(1 << 20) as i32;
        let x = slope * y + bits.below(5) as i32 - 2;
        (Ray::new([x as f32 * exp2(-54), y as f32 * exp2(-54), 0.0], [0.0, 0.0, 1.0]), [a, b, c])
    }

    /// A small triangle far away, and a ray to the middle of an edge from a place so near 0 that it makes no difference
    /// to a double beside the corners.
    fn far_beside_edge(bits: &mut Bits) -> (Ray, [Vec3; 3]) {
        let mut vector = |digits: u64, unit: i32| {
            let mut whole = || (bits.below(2 << digits) as i32 - (1 << digits)) as f32 * exp2(unit);
            Vec3::new(whole(), whole(), whole())
        };
        let (middle, half, other) = (vector(20, -20), vector(7, -20), vector(7, -20));
        let origin = vector(3, -54);
        (Ray::new(origin.to_array(), middle.to_array()), [middle + half, middle - half, middle + other])
    }

    /// A triangle, and a ray that passes one of its edges by `2^-70` of what the edge function's products are, or none.
    fn close_beside_edge(bits: &mut Bits) -> (Ray, [Vec3; 3]) {
        // Seen along the ray `x` has 47 digits, of which the last 24 are those of `z`, and `y` has 23.
        let corner = |x: i64, y: i64| {
            let z = (-x).rem_euclid(1 << 24);
            let top = (x + z) >> 24;
            let whole = z >= 1 << 23 && top.abs() < 1 << 24;
            whole.then(|| Vec3::new(top as f32, y as f32, z as f32) * exp2(-23))
        };
        loop {
            let [y, other] = [(); 2].map(|()| 1 << 22 | bits.below(1 << 22) as i64);
            let small = bits.below(3) as i64 - 1;
            // `x * other - y * beside` is that small number (Euclid).
            let (mut r, mut s) = ((other, y), (1, 0));
            while r.1 != 0 {
                let q = r.0 / r.1;
                (r, s) = ((r.1, r.0 - q * r.1), (s.1, s.0 - q * s.1));
            }
            let x = (s.0 * small).rem_euclid(y);
            if r.0 != 1 || (x * other - small) % y != 0 {
                continue;
            }
            let (beside, times) = ((x * other - small) / y, bits.below(1 << 22) as i64);
            let ends = (corner(x + times * y, y), corner(-(beside + times * other), -other));
            if let (Some(a), Some(b)) = ends {
                let c = Vec3::new(bits.unit(), bits.unit(), 1.0 + bits.unit().abs());
                return (Ray::new([0.0; 3], [exp2(-24), 0.0, 1.0]), [a, b, c]);
            }
        }
    }

    /// What is certain by floats, doubles, pairs, triples or pairs of doubles is what integers find.
    fn compare(seed: u64, count: u32) -> [u32; 7] {
        let header = TreeHeader { lo: [-2.0; 3], hi: [2.0; 3], scale: 1.0, ..TreeHeader::zeroed() };
        let mut bits = Bits(seed);
        let mut told = [0; 7];
        for _ in 0..count {
            let (ray, mut corners) = match bits.below(12) {
                0 => on_edge(&mut bits),
                1 => beside_edge(&mut bits),
                2 => far_beside_edge(&mut bits),
                3 => close_beside_edge(&mut bits),
                _ => met(&mut bits),
            };
            corners.rotate_left(bits.below(3) as usize);
            let [a, b, c] = corners;
            let frame = Frame::of(&ray, &header).whole();
            if !frame.valid {
                continue;
            }
            let right = integers::cross(frame.origin, frame.heading, a, b, c);
            let in_range = right.hit && right.t >= frame.t_min;
            let image = shear(&frame, (a, b, c));
            let seen = bounds(&frame, &image, (a, b, c));
            let (line, corners) = (Line::of(&frame), all_turned((a, b, c), frame.main));
            if right.hit {
                assert!(Edges::new(&image, frame.pad).may_hit(), "{ray:?} {a} {b} {c}");
                assert!(seen.near <= right.t && right.t <= seen.later, "{ray:?} {a} {b} {c}");
            }
            if seen.sure {
                assert!(right.hit, "{ray:?} {a} {b} {c}");
                told[0] += 1;
            }
            for (i, found) in [
                by::<f64>(&line, &corners, (&line.from, &corners), f32::INFINITY, false),
                by::<Pair>(&line, &corners, (&line.from, &corners), f32::INFINITY, false),
                by::<Triple>(&line, &corners, (&line.from, &corners), f32::INFINITY, false),
                by_doubles(&line, &corners, (&line.from, &corners), f32::INFINITY, false),
                by::<Wide>(&line, &corners, (&line.from, &corners), f32::INFINITY, false),
            ]
            .iter()
            .enumerate()
            {
                if found.certain {
                    told[1 + i] += 1;
                    assert_eq!(found.hit, in_range, "{ray:?} {a} {b} {c}");
                    if found.hit {
                        told[6] += u32::from(i == 3);
                        assert_eq!(
                            [found.t, found.u, found.v],
                            [right.t, right.u, right.v],
                            "{ray:?} {a} {b} {c}"
                        );
                    }
                }
            }
        }
        told
    }

    #[test]
    fn what_is_certain_is_what_integers_find() {
        let told = compare(0x5EED, 200_000);
        let least = [25_000, 90_000, 100_000, 140_000, 120_000, 160_000, 60_000];
        assert!(told.iter().zip(least).all(|(&told, least)| told > least), "{told:?}");
    }
}
