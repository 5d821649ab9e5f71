//! Which triangles a ray hits, in which order and where, without rounding: on the `f32` numbers as they were given.
//!
//! ```
//! use raykd_oracle::Oracle;
//! use raykd_shared::Ray;
//!
//! // Two triangles that share the edge from (1, 0, 0) to (0, 1, 0).
//! let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
//! let oracle = Oracle::new(&positions, &[[0, 1, 2], [1, 3, 2]]);
//!
//! // A ray through the edge hits both, at the same t.
//! let hits = oracle.crossings(&Ray::new([0.5, 0.5, 2.0], [0.0, 0.0, -1.0]));
//! assert_eq!(hits.len(), 2);
//! assert!(hits.iter().all(|hit| hit.t == 2.0 && hit.rank == 0));
//! ```
//!
//! Nothing here is shared with raykd's kernels but the layout of a ray. Triangles are closed. A ray in the plane of a
//! triangle misses it, and every ray misses a triangle without area. `t` is rounded to 24 bits, as an `f32` whose
//! exponent has no bounds; then it is compared with `t_min` and `t_max`, both inclusive, and orders the hits. Hits of
//! equal `t` are ordered by triangle number. [`Oracle`] finds hits by a box tree of its own; signs and orders are
//! decided in `f64` where its rounding cannot change them, else in integers ([`exact`]).
//!
//! A kernel computes in `f32`, so its answer may be the exact one of a scene moved by some ULP. [`judge`] says
//! whether it is, for a given distance.
#![forbid(unsafe_code)]

mod boxes;
pub mod exact;
pub mod judge;
mod passage;

pub use passage::Passage;

use boxes::Boxes;
use exact::{Corners, Exact};
use raykd_shared::Ray;
use std::cmp::Ordering;

/// A triangle that a ray hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Its number.
    pub triangle: u32,
    /// The exact ray parameter, within `2^-40` of its size.
    pub t: f64,
    /// 0 for the closest; the same for hits of the same `t`, rounded to 24 bits.
    pub rank: u32,
}

/// Triangles to be asked.
#[derive(Debug)]
pub struct Oracle {
    triangles: Vec<Corners>,
    boxes: Boxes,
}

impl Oracle {
    /// Of vertices and triangles as three indices each; coordinates are finite.
    ///
    /// # Panics
    /// An index is out of range.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let triangles: Vec<Corners> =
            triangles.iter().map(|t| t.map(|vertex| positions[vertex as usize])).collect();
        Self { boxes: Boxes::new(&triangles), triangles }
    }

    /// The corners of a triangle.
    ///
    /// # Panics
    /// There is no such triangle.
    pub fn corners(&self, triangle: u32) -> &Corners {
        &self.triangles[triangle as usize]
    }

    /// The largest distance along an axis from a point to a corner of the box around all triangles: what `f32`
    /// rounding is relative to. 0 without triangles.
    pub fn reach(&self, from: [f32; 3]) -> f64 {
        self.boxes.reach(from)
    }

    /// All hits of a ray, by (`t`, triangle). None for a ray with numbers that are not finite (but `t_min` and
    /// `t_max` may be infinite) or without direction.
    pub fn crossings(&self, ray: &Ray) -> Vec<Crossing> {
        let mut found = Vec::new();
        if is_ray(ray) {
            self.boxes.visit(ray, |triangle| {
                found.extend(exact::cross(ray, self.corners(triangle)).map(|t| (triangle, t)));
            });
        }
        order(ray, &self.triangles, found)
    }

    /// The same without the tree, for small meshes: each triangle in turn.
    pub fn crossings_by_all(&self, ray: &Ray) -> Vec<Crossing> {
        let mut found = Vec::new();
        if is_ray(ray) {
            for (triangle, corners) in self.triangles.iter().enumerate() {
                found.extend(exact::cross(ray, corners).map(|t| (triangle as u32, t)));
            }
        }
        order(ray, &self.triangles, found)
    }
}

/// Whether the numbers are those of a ray.
fn is_ray(ray: &Ray) -> bool {
    let finite = ray.origin.iter().chain(&ray.direction).all(|x| x.is_finite());
    finite && ray.direction != [0.0; 3] && !ray.t_min.is_nan() && !ray.t_max.is_nan()
}

/// Hits in order; of those that are close together `t` is rounded exactly.
fn order(ray: &Ray, triangles: &[Corners], found: Vec<(u32, f64)>) -> Vec<Crossing> {
    let rounded = |triangle: u32| Exact::new(ray, &triangles[triangle as usize]).rounded_t();
    let compare = |a: &(u32, f64), b: &(u32, f64)| {
        if exact::apart(a.1, b.1) {
            a.1.total_cmp(&b.1)
        } else if triangles[a.0 as usize] == triangles[b.0 as usize] {
            Ordering::Equal
        } else {
            rounded(a.0).total_cmp(&rounded(b.0))
        }
    };
    let mut found = found;
    found.sort_by(|a, b| compare(a, b).then(a.0.cmp(&b.0)));
    let mut rank = 0;
    let mut crossings = Vec::with_capacity(found.len());
    for (i, hit) in found.iter().enumerate() {
        rank += u32::from(i > 0 && compare(&found[i - 1], hit).is_ne());
        crossings.push(Crossing { triangle: hit.0, t: hit.1, rank });
    }
    crossings
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lattice_point() -> impl Strategy<Value = [f32; 3]> {
        prop::array::uniform3((-4i8..5).prop_map(f32::from))
    }

    fn point() -> impl Strategy<Value = [f32; 3]> {
        prop_oneof![lattice_point(), prop::array::uniform3(-4.0f32..4.0)]
    }

    proptest! {
        /// The box tree loses nothing, and hits come in order.
        #[test]
        fn tree_and_all_agree(
            soup in prop::collection::vec(prop::array::uniform3(point()), 1..60),
            rays in prop::collection::vec((point(), point(), -1.0f32..1.0), 40),
        ) {
            let triangles: Vec<_> = (0..soup.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let oracle = Oracle::new(&soup.concat(), &triangles);
            for (origin, direction, t_min) in rays {
                let ray = Ray { t_min, ..Ray::new(origin, direction) };
                let found = oracle.crossings(&ray);
                prop_assert_eq!(&found, &oracle.crossings_by_all(&ray));
                for pair in found.windows(2) {
                    let (a, b) = (pair[0], pair[1]);
                    prop_assert!(b.rank == a.rank + 1 || b.rank == a.rank && b.triangle > a.triangle);
                }
            }
        }
    }

    /// A right triangle with legs of 4 in the plane `z = 0`, twice.
    fn corner() -> Oracle {
        Oracle::new(&[[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], &[[0, 1, 2], [0, 2, 1], [0, 1, 1]])
    }

    #[test]
    fn hits_known_by_hand() {
        let down = |x, y| Ray::new([x, y, 2.0], [0.0, 0.0, -4.0]);
        let ids =
            |ray: Ray| corner().crossings(&ray).iter().map(|c| (c.triangle, c.t, c.rank)).collect::<Vec<_>>();
        let both = vec![(0, 0.5, 0), (1, 0.5, 0)];
        for (x, y) in [(1.0, 1.0), (0.0, 0.0), (2.0, 2.0), (4.0, 0.0)] {
            assert_eq!(ids(down(x, y)), both);
        }
        assert_eq!(ids(down(2.0, 2.0f32.next_up())), []);
        assert_eq!(ids(down(-f32::from_bits(1), 1.0)), []);
        assert_eq!(ids(Ray { t_max: 0.5, t_min: 0.5, ..down(1.0, 1.0) }), both);
        assert_eq!(ids(Ray { t_max: 0.5f32.next_down(), ..down(1.0, 1.0) }), []);
        // In the plane; not a ray.
        assert_eq!(ids(Ray::new([-1.0, 1.0, 0.0], [1.0, 0.0, 0.0])), []);
        assert_eq!(ids(Ray::new([1.0, 1.0, f32::NAN], [0.0, 0.0, 1.0])), []);
        assert_eq!(ids(Ray::new([1.0, 1.0, 0.0], [0.0; 3])), []);
    }

    /// Every kind of wrong answer is seen, and right ones pass.
    #[test]
    fn wrong_answers_are_judged() {
        use judge::Fault;
        use raykd_shared::Hit;
        let oracle = corner();
        let ray = Ray::new([1.0, 1.0, 2.0], [0.0, 0.0, -1.0]);
        let judge = |ray: &Ray, triangle, t| {
            oracle.judge(ray, &oracle.crossings(ray), &Hit { triangle, t, u: 0.25, v: 0.25 }, 1.0e-6)
        };
        let miss = Hit::NONE.triangle;
        assert_eq!(judge(&ray, 0, 2.0), None);
        assert_eq!(judge(&ray, 1, 2.0f32.next_up()), None);
        assert_eq!(judge(&ray, 0, 2.000_01), Some(Fault::Misplaced));
        assert_eq!(judge(&ray, miss, 0.0), Some(Fault::Missed));
        assert_eq!(judge(&Ray { t_max: 1.0, ..ray }, miss, 0.0), None);
        assert_eq!(judge(&Ray { t_max: 1.0, ..ray }, 0, 2.0), Some(Fault::OutOfRange));
        let past = Ray { origin: [3.0, 3.0, 2.0], ..ray };
        assert_eq!(judge(&past, miss, 0.0), None);
        assert_eq!(judge(&past, 0, 2.0), Some(Fault::Invented));
        // So close beside an edge that both answers are right.
        let beside = Ray { origin: [2.0, 2.000_000_5, 2.0], ..ray };
        assert_eq!([judge(&beside, miss, 0.0), judge(&beside, 0, 2.0)], [None; 2]);
    }

    /// Of hits whose `t` is rounded alike, the lower number is the closest; nor is the other one wrong.
    #[test]
    fn hits_at_one_rounded_t_may_be_either() {
        use raykd_shared::Hit;
        let flat = |z| [[0.0, 0.0, z], [4.0, 0.0, z], [0.0, 4.0, z]];
        let oracle = Oracle::new(&[flat(0.0), flat(2f32.powi(-30))].concat(), &[[0, 1, 2], [3, 4, 5]]);
        let ray = Ray::new([1.0, 1.0, 2.0], [0.0, 0.0, -1.0]);
        let crossings = oracle.crossings(&ray);
        assert_eq!(crossings.iter().map(|c| (c.triangle, c.rank)).collect::<Vec<_>>(), [(0, 0), (1, 0)]);
        assert!(crossings[0].t > crossings[1].t);
        for triangle in [0, 1] {
            let hit = Hit { triangle, t: 2.0, u: 0.25, v: 0.25 };
            assert_eq!(oracle.judge(&ray, &crossings, &hit, 1.0e-14), None);
        }
    }

    /// Where `t` has no room in `f32`, order still counts.
    #[test]
    fn wrong_answers_to_long_and_short_directions_are_judged() {
        use judge::Fault;
        use raykd_shared::Hit;
        for (height, length, t) in [(1.0, -3e38, 0.0), (9.0, -2e-38, f32::INFINITY)] {
            let flat = |z| [[0.0, 0.0, z], [4.0, 0.0, z], [0.0, 4.0, z]];
            let oracle = Oracle::new(&[flat(0.0), flat(-height)].concat(), &[[0, 1, 2], [3, 4, 5]]);
            let ray = Ray::new([1.0, 1.0, height], [0.0, 0.0, length]);
            let crossings = oracle.crossings(&ray);
            assert_eq!(crossings.iter().map(|c| (c.triangle, c.rank)).collect::<Vec<_>>(), [(0, 0), (1, 1)]);
            let judge =
                |triangle, t| oracle.judge(&ray, &crossings, &Hit { triangle, t, u: 0.25, v: 0.25 }, 1.0e-6);
            assert_eq!(judge(0, t), None);
            assert_eq!(judge(1, t), Some(Fault::Missed));
            assert_eq!(judge(Hit::NONE.triangle, 0.0), Some(Fault::Missed));
            assert_eq!(judge(0, 1.0), Some(Fault::Misplaced));
        }
    }

    #[test]
    fn without_triangles_nothing_is_hit() {
        use raykd_shared::Hit;
        let nothing = Oracle::new(&[[1.0; 3]], &[]);
        let ends = [f32::NEG_INFINITY, 0.0, f32::INFINITY];
        for direction in [[1.0, 1.0, 1.0], [-1.0, 2.0, -3.0], [0.0, 0.0, 1.0]] {
            for (t_min, t_max) in ends.into_iter().flat_map(|a| ends.map(|b| (a, b))) {
                let ray = Ray { t_min, t_max, ..Ray::new([0.5; 3], direction) };
                assert!(nothing.crossings(&ray).is_empty(), "{ray:?}");
                assert_eq!(nothing.judge(&ray, &[], &Hit::NONE, 0.0), None, "{ray:?}");
            }
        }
        assert_eq!(nothing.reach([1.0, -2.0, 3.0]), 0.0);
    }

    #[test]
    fn a_triangle_that_is_none_is_invented() {
        use judge::Fault;
        use raykd_shared::Hit;
        let ray = Ray::new([0.0, 0.0, 5.0], [0.1, 0.1, -1.0]);
        let crossings = corner().crossings(&ray);
        for triangle in [corner().triangles.len() as u32, u32::MAX - 1] {
            let hit = Hit { triangle, t: crossings[0].t as f32, u: 0.0, v: 0.0 };
            assert_eq!(corner().judge(&ray, &crossings, &hit, 1e-6), Some(Fault::Invented));
        }
    }

    #[test]
    fn a_ray_in_a_plane_is_in_no_range() {
        let ray = Ray { t_min: f32::NEG_INFINITY, ..Ray::new([0.5, 0.5, 0.0], [1.0, 1.0, 0.0]) };
        let exact = Exact::new(&ray, &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert!(!exact.inside() && !exact.is_in_range(&ray) && exact.t().is_nan());
    }

    /// What is compared with the ends is `t` rounded, up or down.
    #[test]
    fn ends_are_compared_with_the_rounded_t() {
        let mut ways = [0; 2];
        for (n, d) in (1..8u8).flat_map(|n| (9..60u8).map(move |d| (f32::from(n), f32::from(d)))) {
            let t = n / d;
            if f64::from(t) * f64::from(d) == f64::from(n) {
                continue;
            }
            ways[usize::from(f64::from(t) * f64::from(d) < f64::from(n))] += 1;
            for (t_min, t_max, expected) in
                [(t, 1.0, 2), (t.next_up(), 1.0, 0), (0.0, t, 2), (0.0, t.next_down(), 0), (t, t, 2)]
            {
                let ray = Ray { t_min, t_max, ..Ray::new([1.0, 1.0, n], [0.0, 0.0, -d]) };
                assert_eq!(corner().crossings(&ray).len(), expected, "{ray:?}");
                assert_eq!(corner().crossings_by_all(&ray).len(), expected, "{ray:?}");
            }
        }
        assert!(ways.iter().all(|&n| n > 50), "{ways:?}");
    }

    #[test]
    fn ulps_count_from_the_exact_value() {
        assert_eq!(judge::ulps(1.0, 1.0), 0.0);
        assert_eq!(judge::ulps(1.0f32.next_up(), 1.0), 1.0);
        assert!((judge::ulps(3.0, 3.0 + 1.2e-7) - 0.503).abs() < 0.01);
    }
}
