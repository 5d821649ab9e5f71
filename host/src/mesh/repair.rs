//! The written rule: which triangles take part, and which numbers the kernels get to see.

use super::error::{MeshError, Place, Spot};
use raykd_shared::limits::{DUST, LEAST_UNSCALED, MOST_UNSCALED};
use rayon::prelude::*;
use robust::{Coord, orient2d};

/// What was set aside or changed on the way from the file to the kernels.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Repairs {
    /// Triangles without area: kept out of the tree, but they keep their number.
    pub zero_area: u32,
    /// The number of the first of them.
    pub zero_area_at: Option<u32>,
    /// Triangles with the same three positions in the same order as one of a lower number: they stay in the
    /// tree, where the lowest number wins.
    pub duplicates: u32,
    /// The number of the first of them.
    pub duplicate_at: Option<u32>,
    /// Faces with more than three corners, cut into triangles.
    pub polygons: u32,
    /// Of these, concave ones that the fan from their first corner does not cover: cut otherwise.
    pub concave: u32,
    /// Of these, ones that are crossed by their own edges, or touched from outside by a corner: left as fans.
    pub crossed: u32,
    /// The first such face.
    pub crossed_at: Option<Spot>,
    /// Of these, ones thicker than a thousandth of their extent.
    pub bent: u32,
    /// The first such face.
    pub bent_at: Option<Spot>,
    /// Points, lines and curves of the file, ignored.
    pub ignored: u32,
    /// Coordinates too small to matter (see [`crate::mesh`]) that are 0 for the kernels.
    pub flushed: u32,
    /// Meshes of a glTF file with a skin or morph targets, taken as they are stored.
    pub unposed: u32,
    /// Coordinates that no `f32` is equal to, rounded; of a mesh that was moved, after that
    /// ([`Mesh::translation`](crate::Mesh::translation)).
    pub rounded: u32,
    /// The largest change of a coordinate by that, in the mesh's units.
    pub largest_change: f64,
    /// Of the triangles without area, those that lost it by that.
    pub collapsed: u32,
}

/// What [`survey`] found out about a mesh.
#[derive(Debug)]
pub(super) struct Survey {
    /// Numbers of the triangles that take part, ascending.
    pub(super) kept: Vec<u32>,
    /// Box around those triangles.
    pub(super) bounds: ([f32; 3], [f32; 3]),
    /// Power of two for the kernels.
    pub(super) scale: f32,
    /// Coordinates of smaller magnitude are 0 for the kernels.
    pub(super) dust: f64,
}

/// Largest extents, as powers of two, that need no scaling.
const UNSCALED: std::ops::RangeInclusive<f64> = power_of_two(LEAST_UNSCALED)..=power_of_two(MOST_UNSCALED);

/// `2^e` for `e` in the range of normal numbers.
pub(super) const fn power_of_two(e: i32) -> f64 {
    f64::from_bits(((e + 1023) as u64) << 52)
}

/// The largest `e` with `2^e <= x`, for normal positive `x`.
pub(super) fn exponent(x: f64) -> i32 {
    (x.to_bits() >> 52) as i32 - 1023
}

/// A coordinate as the kernels see it, before scaling: dust and -0 become +0.
#[inline]
pub(super) fn settle(x: f32, dust: f64) -> f32 {
    if f64::from(x.abs()) < dust { 0.0 } else { x + 0.0 }
}

/// Whether a triangle has area, decided exactly: it has none if, and only if, its corners lie on one line,
/// which is when all three projections along the axes are degenerate.
#[inline]
pub(super) fn has_area<T: Copy + Into<f64>>([a, b, c]: [[T; 3]; 3]) -> bool {
    let at = |p: [T; 3], i: usize, j: usize| Coord { x: p[i].into(), y: p[j].into() };
    // Differences and products of two f32 neither overflow nor underflow in f64, as the predicate requires. Those of
    // two f64 do below 1e-150 of a unit, where only what is told of a mesh depends on them.
    [(0, 1), (1, 2), (2, 0)].iter().any(|&(i, j)| orient2d(at(a, i, j), at(b, i, j), at(c, i, j)) != 0.0)
}

/// A coordinate for the kernels.
pub(super) fn scaled(x: f32, dust: f64, scale: f32) -> f32 {
    // By way of f64, where neither subnormal nor large factors are special.
    let x = f64::from(settle(x, dust)) * f64::from(scale);
    if x.abs() <= f64::from(f32::MAX) { x as f32 } else { 0.0 }
}

/// Box of the kept triangles, and their smallest non-zero magnitude.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measure {
    pub(crate) lo: [f32; 3],
    pub(crate) hi: [f32; 3],
    pub(crate) smallest: f32,
}

impl Measure {
    const NOTHING: Self =
        Self { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3], smallest: f32::INFINITY };

    /// Of some triangles.
    pub(crate) fn of(kept: &[u32], corners: impl Fn(u32) -> [[f32; 3]; 3] + Sync) -> Self {
        kept.par_iter()
            .fold(|| Self::NOTHING, |m, &t| corners(t).into_iter().fold(m, Self::with))
            .reduce(|| Self::NOTHING, |a, b| a.and(&b))
    }

    fn with(mut self, p: [f32; 3]) -> Self {
        for (a, x) in p.into_iter().enumerate() {
            self.lo[a] = self.lo[a].min(x);
            self.hi[a] = self.hi[a].max(x);
            if x != 0.0 {
                self.smallest = self.smallest.min(x.abs());
            }
        }
        self
    }

    fn and(mut self, other: &Self) -> Self {
        for a in 0..3 {
            self.lo[a] = self.lo[a].min(other.lo[a]);
            self.hi[a] = self.hi[a].max(other.hi[a]);
        }
        self.smallest = self.smallest.min(other.smallest);
        self
    }

    fn extent(&self) -> f64 {
        (0..3).map(|a| f64::from(self.hi[a]) - f64::from(self.lo[a])).fold(0.0, f64::max)
    }

    /// Coordinates of smaller magnitude are 0.
    pub(crate) fn dust(&self) -> f64 {
        power_of_two(exponent(self.extent()) + DUST)
    }

    /// Whether there are such, other than 0.
    pub(crate) fn has_dust(&self) -> bool {
        f64::from(self.smallest) < self.dust()
    }

    /// The power of two that coordinates are multiplied with for the kernels.
    pub(crate) fn scale(&self) -> Result<f32, MeshError> {
        scale_for(self.extent())
    }

    /// The box with coordinates for the kernels.
    pub(crate) fn scaled(&self, scale: f32) -> ([f32; 3], [f32; 3]) {
        let scaled = |corner: [f32; 3]| corner.map(|x| scaled(x, self.dust(), scale));
        (scaled(self.lo), scaled(self.hi))
    }
}

/// Applies the rule. The inputs are finite and in range.
pub(super) fn survey(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Survey, MeshError> {
    let corners = |t: u32| triangles[t as usize].map(|v| positions[v as usize]);
    let has_area_without = |t, dust| has_area(corners(t).map(|p| p.map(|x| settle(x, dust))));
    let all = || (0..triangles.len() as u32).into_par_iter();
    let mut kept: Vec<u32> = all().filter(|&t| has_area(corners(t))).collect();
    // Dropping dust can flatten triangles, and without those the mesh, and with it the measure of dust, may be
    // smaller. `kept` only shrinks, so this ends; nearly always in the first round.
    loop {
        if kept.is_empty() {
            return Ok(Survey { kept, bounds: ([0.0; 3], [0.0; 3]), scale: 1.0, dust: 0.0 });
        }
        let mut measured = Measure::of(&kept, corners);
        let dust = measured.dust();
        if measured.has_dust() {
            let before = kept.len();
            kept.retain(|&t| has_area_without(t, dust));
            if kept.len() < before {
                continue;
            }
            // Others have area only without dust, and a closed mesh may need them. Not if dust would be another then.
            let more: Vec<u32> = all().filter(|&t| has_area_without(t, dust)).collect();
            let larger = Measure::of(&more, corners);
            if larger.dust() == dust {
                (measured, kept) = (larger, more);
            }
        }
        let bounds = (measured.lo.map(|x| settle(x, dust)), measured.hi.map(|x| settle(x, dust)));
        return Ok(Survey { kept, bounds, scale: measured.scale()?, dust });
    }
}

/// The power of two that brings a mesh of this extent into the range where the kernels' arithmetic neither
/// overflows nor loses digits.
fn scale_for(extent: f64) -> Result<f32, MeshError> {
    if UNSCALED.contains(&extent) {
        return Ok(1.0);
    }
    // Within the normal numbers of f32, for the kernels; the very largest meshes end below 8 instead of 2, the
    // smallest at 2^-10 instead of 1.
    let scale = power_of_two((-exponent(extent)).clamp(-126, 127));
    if extent * scale < *UNSCALED.start() {
        return Err(MeshError::TooSmall { at: Place::default(), extent });
    }
    Ok(scale as f32)
}

/// The first of all triangles that is not among the `kept` ones.
pub(super) fn first_left_out(triangles: usize, kept: &[u32]) -> Option<u32> {
    (0..triangles as u32).find(|&t| kept.get(t as usize) != Some(&t))
}

/// How many triangles of `kept` repeat one of a lower number, same positions, same order; and the first of them.
pub(super) fn duplicates(positions: &[[f32; 3]], triangles: &[[u32; 3]], kept: &[u32]) -> (u32, Option<u32>) {
    let key = |t: u32| triangles[t as usize].map(|v| positions[v as usize].map(|x| (x + 0.0).to_bits()));
    // Equal triangles have equal hashes, so only triangles whose hash occurs twice need a closer look.
    let hashes: Vec<u64> = kept.par_iter().map(|&t| hash(key(t))).collect();
    let mut sorted = hashes.clone();
    sorted.par_sort_unstable();
    let mut twice: Vec<u64> = sorted.windows(2).filter(|w| w[0] == w[1]).map(|w| w[0]).collect();
    if twice.is_empty() {
        return (0, None);
    }
    twice.dedup();
    let mut suspects: Vec<_> = kept
        .par_iter()
        .zip(&hashes)
        .filter(|(_, hash)| twice.binary_search(hash).is_ok())
        .map(|(&t, _)| (key(t), t))
        .collect();
    suspects.par_sort_unstable();
    let again = || suspects.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| w[1].1);
    (again().count() as u32, again().min())
}

/// A 64-bit hash of nine words: multiply, rotate, and a final mix.
fn hash(key: [[u32; 3]; 3]) -> u64 {
    let mixed = key.as_flattened().iter().fold(0x9e37_79b9_7f4a_7c15u64, |h, &word| {
        (h ^ u64::from(word)).wrapping_mul(0xd6e8_feb8_6659_fd93).rotate_left(29)
    });
    (mixed ^ mixed >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The cross product in integers: exact.
    fn lattice_area(t: [[i64; 3]; 3]) -> bool {
        let d = |p: [i64; 3], q: [i64; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
        let (u, v) = (d(t[1], t[0]), d(t[2], t[0]));
        (0..3).any(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            u[j] * v[k] != u[k] * v[j]
        })
    }

    proptest! {
        #[test]
        fn area_agrees_with_integers(
            t in prop::array::uniform3(prop::array::uniform3(-4i64..5)),
            shift in -149i32..120,
        ) {
            let scale = power_of_two(shift);
            let float = t.map(|p| p.map(|x| (x as f64 * scale) as f32));
            prop_assert_eq!(has_area(float), lattice_area(t));
        }

        #[test]
        fn large_multiples_are_exact(
            a in prop::array::uniform3(-2000i64..2000),
            d in prop::array::uniform3(-2000i64..2000),
            m in -4000i64..4000,
            nudge in prop::array::uniform3(-1i64..2),
        ) {
            // a, a + d and a + m d are collinear; a nudge by one unit mostly undoes that.
            let b = [0, 1, 2].map(|i| a[i] + d[i]);
            let c = [0, 1, 2].map(|i| a[i] + m * d[i] + nudge[i]);
            let t = [a, b, c];
            prop_assert_eq!(has_area(t.map(|p| p.map(|x| x as f32))), lattice_area(t));
        }
    }

    #[test]
    fn powers_of_two() {
        assert_eq!(power_of_two(0), 1.0);
        assert_eq!(power_of_two(-149), f64::from(f32::from_bits(1)));
        for e in [-149, -1, 0, 127] {
            assert_eq!(exponent(power_of_two(e)), e);
            assert_eq!(exponent(power_of_two(e) * 1.999), e);
        }
    }

    #[test]
    fn hashes_see_every_corner() {
        let base = [[1, 2, 3], [4, 5, 6], [7, 8, 9]];
        let mut seen = vec![hash(base), hash([[4, 5, 6], [7, 8, 9], [1, 2, 3]])];
        for word in 0..9 {
            let mut changed = base;
            changed[word / 3][word % 3] ^= 1;
            seen.push(hash(changed));
        }
        seen.sort_unstable();
        assert!(seen.windows(2).all(|w| w[0] != w[1]));
    }
}
