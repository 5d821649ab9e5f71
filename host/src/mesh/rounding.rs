//! From `f64` to the `f32` that kernels compute in; a mesh far from the origin is moved there first.

use super::repair::{exponent, has_area, power_of_two};
use rayon::prelude::*;

/// Coordinates more than this many times as large as the mesh's largest extent are worth moving: unmoved, they would
/// lose four binary digits or more of those that the extent leaves.
const FAR: f64 = 8.0;

/// A mesh's positions in `f32`.
#[derive(Debug)]
pub(super) struct Rounded {
    pub(super) positions: Vec<[f32; 3]>,
    /// What was subtracted from every position before.
    pub(super) translation: [f64; 3],
    /// How many coordinates are not what they were, and by how much at most.
    pub(super) coordinates: u32,
    pub(super) largest_change: f64,
}

/// Rounds finite positions within the range of `f32`; the triangles' indices are in range.
pub(super) fn round(given: &[[f64; 3]], triangles: &[[u32; 3]]) -> Rounded {
    let exact = given.as_flattened().par_iter().all(|&x| f64::from(x as f32) == x);
    let translation = if exact { [0.0; 3] } else { translation(given, triangles) };
    let round = |x: f64, by: f64| (x - by).clamp(f32::MIN.into(), f32::MAX.into()) as f32;
    let positions: Vec<[f32; 3]> =
        given.par_iter().map(|p| [0, 1, 2].map(|a| round(p[a], translation[a]))).collect();
    let changes = (given.par_iter().zip(&positions)).filter(|_| !exact).flat_map_iter(|(p, r)| {
        [0, 1, 2].map(|a| change(p[a], translation[a], r[a])).into_iter().filter(|x| *x > 0.0)
    });
    let (count, largest_change) =
        changes.map(|x| (1u64, x)).reduce(|| (0, 0.0), |a, b| (a.0 + b.0, f64::max(a.1, b.1)));
    Rounded { positions, translation, coordinates: count.try_into().unwrap_or(u32::MAX), largest_change }
}

/// How far `r + by` is from `x`: 0 only if they are equal.
fn change(x: f64, by: f64, r: f32) -> f64 {
    // What the difference lost by its rounding (Knuth's two-sum), which mostly is nothing.
    let difference = x - by;
    let back = difference - x;
    let lost = (x - (difference - back)) - (by + back);
    ((f64::from(r) - difference) - lost).abs()
}

/// What to subtract from a mesh's positions: on axes where they are far off, the middle of its box, rounded to few
/// digits so that differences are exact.
fn translation(given: &[[f64; 3]], triangles: &[[u32; 3]]) -> [f64; 3] {
    let nothing = || ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let join = |a: ([f64; 3], [f64; 3]), b: ([f64; 3], [f64; 3])| {
        ([0, 1, 2].map(|i| a.0[i].min(b.0[i])), [0, 1, 2].map(|i| a.1[i].max(b.1[i])))
    };
    let (lo, hi) = triangles
        .par_iter()
        .map(|t| t.map(|v| given[v as usize]))
        .filter(|corners| has_area(*corners))
        .map(|corners| corners.into_iter().fold(nothing(), |all, p| join(all, (p, p))))
        .reduce(nothing, join);
    let extent = (0..3).map(|a| hi[a] - lo[a]).fold(0.0, f64::max);
    if !extent.is_normal() {
        return [0.0; 3];
    }
    let step = power_of_two((exponent(extent) - 2).max(-1022));
    [0, 1, 2].map(|a| {
        let middle = f64::midpoint(lo[a], hi[a]);
        match lo[a].abs().max(hi[a].abs()) > FAR * extent {
            true if middle.abs() < step * power_of_two(52) => (middle / step).round() * step,
            true => middle,
            false => 0.0,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn changes_are_those_of_the_sum() {
        assert_eq!(change(0.1, 0.0, 0.1), f64::from(0.1f32) - 0.1);
        assert_eq!(change(-0.5, 0.0, -0.5), 0.0);
        assert_eq!(change(4.5e6 + 0.25, 4.5e6, 0.25), 0.0);
        // The difference itself is rounded here: only the vertex that nobody uses can be so far off.
        assert_eq!(change(1e-20, 4.5e6, -4.5e6), 1e-20);
        assert_eq!(change(1.0, 1e30, -1e30_f32), (f64::from(-1e30_f32) + 1e30).abs());
    }

    proptest! {
        /// Two points of a mesh far off are as far apart after the move as before, but for their own rounding.
        #[test]
        fn moved_differences_are_exact(
            far in -1e7f64..1e7, sizes in prop::array::uniform3(-1.0f64..1.0), shrink in 0i32..20,
        ) {
            let size = sizes[0].abs().max(1e-3) * 2f64.powi(-shrink);
            let given = [[far, 0.1, 0.2], [far + size, 0.1, 0.2], [far, 0.1 + size * sizes[1], 0.2 + size]];
            let moved = round(&given, &[[0, 1, 2]]);
            let by = moved.translation;
            let sizes = [given[1][0] - far, (given[2][1] - 0.1).abs(), given[2][2] - 0.2];
            let near = far.abs().max((far + size).abs()) <= FAR * sizes.into_iter().fold(0.0, f64::max);
            prop_assert_eq!(by[0] == 0.0, near);
            for (p, r) in given.iter().zip(&moved.positions) {
                for a in 0..3 {
                    prop_assert_eq!(p[a] - by[a] + by[a], p[a]);
                    prop_assert!((p[a] - by[a] - f64::from(r[a])).abs() <= moved.largest_change);
                    if by[a] != 0.0 {
                        prop_assert!(f64::from(r[a]).abs() <= size * 2.0);
                    }
                }
            }
        }
    }
}
