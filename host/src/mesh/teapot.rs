//! The Utah teapot: 32 bicubic Bézier patches, at any resolution.
//!
//! Evaluated in f64 with sums, products and the quotients `i / n`, and rounded once to f32: the same numbers
//! everywhere. Patches that share an edge share its vertices, since a point on an edge depends, bit for bit, on
//! the control points of that edge alone, from whichever end they are counted.

use std::collections::HashMap;
use std::sync::LazyLock;

/// The finest tessellation: about 64 million triangles.
pub(super) const MAX_LEVEL: u32 = 1000;

/// One control net, row by row.
type Patch = [[[f64; 3]; 4]; 4];

static PATCHES: LazyLock<Vec<Patch>> = LazyLock::new(|| {
    let lines = || include_str!("../../assets/teapot.txt").lines();
    let points: Vec<[f64; 3]> = lines().filter_map(|l| numbers(l.strip_prefix("v ")?)).collect();
    lines()
        .filter_map(|l| numbers::<usize, 16>(l.strip_prefix("p ")?))
        .map(|net| std::array::from_fn(|row| std::array::from_fn(|column| points[net[4 * row + column]])))
        .collect()
});

/// The `N` numbers of a line.
fn numbers<T: std::str::FromStr, const N: usize>(line: &str) -> Option<[T; N]> {
    let all: Vec<T> = line.split(' ').map_while(|word| word.parse().ok()).collect();
    all.try_into().ok()
}

/// Vertices and triangles with every patch cut into `level` x `level` quads of two triangles. At the poles, on
/// the lid's knob and under the bottom, `8 * level` of the triangles have no area.
pub(super) fn tessellate(level: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let n = level.clamp(1, MAX_LEVEL) as usize;
    let weights: Vec<[f64; 4]> = (0..=n).map(|i| bernstein(i, n)).collect();
    let mut positions = Vec::with_capacity(32 * (n + 1) * (n + 1));
    let mut triangles = Vec::with_capacity(64 * n * n);
    let mut known = HashMap::with_capacity(32 * (n + 1) * (n + 1));
    let mut grid = vec![0u32; (n + 1) * (n + 1)];
    for patch in PATCHES.iter() {
        let vertices = weights.iter().flat_map(|u| weights.iter().map(|v| place(point(patch, u, v))));
        for (slot, p) in grid.iter_mut().zip(vertices) {
            *slot = *known.entry(p.map(f32::to_bits)).or_insert_with(|| {
                positions.push(p);
                positions.len() as u32 - 1
            });
        }
        for row in 0..n {
            for column in 0..n {
                let at = row * (n + 1) + column;
                let [a, b, c, d] = [at, at + 1, at + n + 2, at + n + 1].map(|i| grid[i]);
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    (positions, triangles)
}

/// The level whose tessellation comes closest to so many triangles with area.
pub fn teapot_level_for(triangles: u32) -> u32 {
    let distance = |n: u32| (64 * u64::from(n) * u64::from(n) - 8 * u64::from(n)).abs_diff(triangles.into());
    let guess = (triangles / 64).isqrt();
    (guess..=guess + 1).map(|n| n.clamp(1, MAX_LEVEL)).min_by_key(|&n| distance(n)).unwrap_or(1)
}

/// Bernstein polynomials at `i / n`. Counting from the other end gives the same four numbers in reverse.
fn bernstein(i: usize, n: usize) -> [f64; 4] {
    let (t, s) = (i as f64 / n as f64, (n - i) as f64 / n as f64);
    [s * s * s, s * s * t * 3.0, t * t * s * 3.0, t * t * t]
}

/// A weighted sum, inner and outer terms paired so that its value does not depend on the direction.
fn blend(p: [[f64; 3]; 4], w: &[f64; 4]) -> [f64; 3] {
    std::array::from_fn(|a| (p[0][a] * w[0] + p[3][a] * w[3]) + (p[1][a] * w[1] + p[2][a] * w[2]))
}

fn point(patch: &Patch, u: &[f64; 4], v: &[f64; 4]) -> [f64; 3] {
    blend(patch.map(|row| blend(row, v)), u)
}

/// Turns y up, makes it five times as large (about 32 x 16 x 20) and puts the centre of its box at the origin.
fn place([x, y, z]: [f64; 3]) -> [f32; 3] {
    [x * 5.0 - 1.070_312_5, z * 5.0 - 7.875, y * -5.0].map(|x| x as f32 + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_asset_is_complete() {
        assert_eq!(PATCHES.len(), 32);
        assert_eq!(numbers::<u32, 2>("1 2 3"), None);
    }

    #[test]
    fn levels() {
        for (triangles, level) in
            [(0, 1), (56, 1), (992, 4), (1000, 4), (6320, 10), (1_000_000, 125), (u32::MAX, 1000)]
        {
            assert_eq!(teapot_level_for(triangles), level, "{triangles}");
        }
    }
}
