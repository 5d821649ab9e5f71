//! One ray and one triangle: in `f64` where that is certain, else in integers.
//!
//! With the corners `a`, `b`, `c` seen from the ray's origin and `d` its direction, the ray's line passes the edges
//! on the sides that the signs of `d·(c×b)`, `d·(a×c)` and `d·(b×a)` tell. It hits the triangle if no two of them
//! disagree and not all are 0; their sum is `-d·n` with `n` the normal, and `t = a·(b×c) / d·n`.

use num_bigint::{BigInt, Sign};
use num_rational::Ratio;
use num_traits::{Signed as _, ToPrimitive as _, Zero as _};
use raykd_shared::Ray;

/// A triangle's corners.
pub type Corners = [[f32; 3]; 3];

/// Half an ULP of 1 in `f64`.
const EPSILON: f64 = f64::EPSILON * 0.5;
/// Relative accuracy of a `t` that [`cross`] returns.
const ACCURACY: f64 = 1.0 / (1u64 << 40) as f64;

/// Whether two ray parameters from [`cross`], or one and an end of a ray, differ for certain when rounded to the 24
/// bits of `f32`.
pub(crate) fn apart(a: f64, b: f64) -> bool {
    const DIGITS: f64 = 4.0 * f32::EPSILON as f64;
    a.is_infinite() || b.is_infinite() || (a - b).abs() > DIGITS * a.abs().max(b.abs())
}

/// A number and the most that rounding may have changed it by.
#[derive(Clone, Copy)]
struct Rough {
    value: f64,
    error: f64,
}

impl Rough {
    fn sign(self) -> Option<i32> {
        if self.value > self.error {
            Some(1)
        } else if self.value < -self.error {
            Some(-1)
        } else if self.error == 0.0 {
            Some(0)
        } else {
            None
        }
    }
}

/// `x·(y×z)` of vectors whose components carry one rounding at most. Each term `x_i y_j z_k` carries at most seven
/// (three of the components, two products, two sums): less than 8 half ULPs of it. Numbers are differences of `f32`
/// or `f32`, at least `2^-149` in size or 0, so that nothing is lost below the range of `f64`, or above it.
fn triple(x: [f64; 3], y: [f64; 3], z: [f64; 3]) -> Rough {
    let (mut value, mut size) = (0.0, 0.0);
    for (x, (j, k)) in x.into_iter().zip([(1, 2), (2, 0), (0, 1)]) {
        let (p, q) = (y[j] * z[k], y[k] * z[j]);
        value += x * (p - q);
        size += x.abs() * (p.abs() + q.abs());
    }
    Rough { value, error: 16.0 * EPSILON * size }
}

/// Where a ray hits a triangle, both of finite numbers (but `t_min` and `t_max` may be any): `t` within `2^-40` of its
/// size, or 0 only if it is; `None` if it does not, or not between `t_min` and `t_max`, which are compared with `t`
/// rounded to 24 bits.
pub fn cross(ray: &Ray, corners: &Corners) -> Option<f64> {
    let [a, b, c] = corners.map(|p| [0, 1, 2].map(|i| f64::from(p[i]) - f64::from(ray.origin[i])));
    let d = ray.direction.map(f64::from);
    let edges = [triple(d, c, b), triple(d, a, c), triple(d, b, a)];
    let signs = edges.map(Rough::sign);
    if signs.contains(&Some(1)) && signs.contains(&Some(-1)) {
        return None;
    }
    let exact;
    if let [Some(u), Some(v), Some(w)] = signs {
        if u == 0 && v == 0 && w == 0 {
            return None;
        }
        let det = edges.iter().map(|e| e.value).sum::<f64>();
        let det_error: f64 = edges.iter().map(|e| e.error + 4.0 * EPSILON * e.value.abs()).sum();
        let volume = triple(a, b, c);
        let t = -volume.value / det;
        let certain = volume.error <= 0.25 * ACCURACY * volume.value.abs()
            && det_error <= 0.25 * ACCURACY * det.abs()
            && [ray.t_min, ray.t_max].iter().all(|&end| apart(t, f64::from(end)));
        if certain {
            return (t > f64::from(ray.t_min) && t < f64::from(ray.t_max)).then_some(t);
        }
        exact = Exact::new(ray, corners);
    } else {
        exact = Exact::new(ray, corners);
        if !exact.inside {
            return None;
        }
    }
    exact.is_in_range(ray).then(|| exact.t())
}

/// A ray against a triangle in integers.
#[derive(Clone, Debug)]
pub struct Exact {
    /// Whether the line passes through the triangle: no two edge functions disagree, and not all are 0.
    inside: bool,
    /// `t` is `numerator / denominator`.
    numerator: BigInt,
    /// Not negative; 0 only if the ray is parallel to the plane, or the triangle has no area.
    denominator: BigInt,
    /// The weights of the second and third corner, undivided.
    weights: [BigInt; 2],
}

/// A fraction rounded to the nearest number of 24 bits, of two the even one, however large or small. The denominator
/// is positive; both come from a few `f32`, so that `f64` holds the quotient.
fn nearest(numerator: &BigInt, denominator: &BigInt) -> f64 {
    // 26 or 27 bits and one for all that follow: `f32` rounds these as it would the fraction.
    let shift = 26 + denominator.bits() as i64 - numerator.bits() as i64;
    let (up, down) = (shift.max(0) as u64, (-shift).max(0) as u64);
    let (dividend, divisor) = (numerator.abs() << up, denominator << down);
    let whole = &dividend / &divisor;
    let more = &whole * divisor != dividend;
    let digits = 2 * whole.to_u32().unwrap_or(0) + u32::from(more);
    let size = f64::from(digits as f32) * f64::from_bits(((1023 - 1 - shift) as u64) << 52);
    if numerator.is_negative() { -size } else { size }
}

/// A number of 24 bits as `f32`: 0 if it is too small to be normal, infinite if it is too large.
fn narrow(x: f64) -> f32 {
    if x.abs() < f64::from(f32::MIN_POSITIVE) { 0.0 } else { x as f32 }
}

/// A finite number times `2^149`: an integer.
pub(crate) fn integer(x: f32) -> BigInt {
    let (bits, field) = (x.to_bits(), x.to_bits() >> 23 & 0xFF);
    let digits = bits & 0x007F_FFFF | if field > 0 { 0x0080_0000 } else { 0 };
    let size = BigInt::from(digits) << field.saturating_sub(1);
    if bits >> 31 == 1 { -size } else { size }
}

impl Exact {
    /// Of finite numbers.
    pub fn new(ray: &Ray, corners: &Corners) -> Self {
        let origin = ray.origin.map(integer);
        let [a, b, c] = corners.map(|p| [0, 1, 2].map(|i| integer(p[i]) - &origin[i]));
        let d = ray.direction.map(integer);
        let cross = |x: &[BigInt; 3], y: &[BigInt; 3]| {
            [(1, 2), (2, 0), (0, 1)].map(|(i, j)| &x[i] * &y[j] - &x[j] * &y[i])
        };
        let dot = |x: &[BigInt; 3], y: &[BigInt; 3]| -> BigInt { x.iter().zip(y).map(|(x, y)| x * y).sum() };
        let bc = cross(&b, &c);
        let edges = [-dot(&d, &bc), -dot(&d, &cross(&c, &a)), -dot(&d, &cross(&a, &b))];
        let sum: BigInt = edges.iter().sum();
        let is = |sign| edges.iter().any(|edge| edge.sign() == sign);
        let inside = is(Sign::Plus) != is(Sign::Minus);
        let [_, u, v] = edges;
        let (mut numerator, mut denominator, mut weights) = (dot(&a, &bc), -sum, [-u, -v]);
        if denominator.is_negative() {
            (numerator, denominator, weights) = (-numerator, -denominator, weights.map(|w| -w));
        }
        Self { inside, numerator, denominator, weights }
    }

    /// Whether the ray's line passes through the closed triangle, and not in its plane.
    pub const fn inside(&self) -> bool {
        self.inside
    }

    /// The ray parameter to within an ULP of `f64`.
    pub fn t(&self) -> f64 {
        if self.denominator.is_zero() {
            return f64::NAN;
        }
        Ratio::new_raw(self.numerator.clone(), self.denominator.clone()).to_f64().unwrap_or(f64::NAN)
    }

    /// The ray parameter rounded to 24 bits, however large or small: what hits are ordered by, and what is compared
    /// with `t_min` and `t_max`.
    ///
    /// # Panics
    /// The ray is parallel to the plane, or the triangle has no area.
    pub fn rounded_t(&self) -> f64 {
        nearest(&self.numerator, &self.denominator)
    }

    /// The ray parameter, and the weights of the second and third corner, as `f32` rounded to nearest even; numbers
    /// below the normal range are 0, those beyond it infinite.
    ///
    /// # Panics
    /// As [`Self::rounded_t`].
    pub fn rounded(&self) -> [f32; 3] {
        let [u, v] = &self.weights;
        [&self.numerator, u, v].map(|n| narrow(nearest(n, &self.denominator)))
    }

    /// Whether there is a rounded ray parameter, and it lies between `t_min` and `t_max`, or on one of them.
    pub fn is_in_range(&self, ray: &Ray) -> bool {
        if self.denominator.is_zero() {
            return false;
        }
        let t = self.rounded_t();
        f64::from(ray.t_min) <= t && t <= f64::from(ray.t_max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn integers_are_the_numbers() {
        let unit = BigInt::from(1) << 149u32;
        assert_eq!(integer(1.0), unit);
        assert_eq!(integer(-2.5) * 2, unit * -5);
        assert_eq!(integer(f32::from_bits(3)), BigInt::from(3));
        assert_eq!(integer(-0.0), BigInt::from(0));
        assert_eq!(integer(f32::MIN_POSITIVE), BigInt::from(1) << 23u32);
    }

    /// Numbers of very different sizes, and small integers, for which much is 0.
    fn number() -> impl Strategy<Value = f32> {
        prop_oneof![
            (-3i8..4).prop_map(f32::from),
            (-1.0f32..1.0, -140i32..100).prop_map(|(x, e)| x * 2f32.powi(e)),
            -1.0f32..1.0,
        ]
    }

    fn point() -> impl Strategy<Value = [f32; 3]> {
        prop::array::uniform3(number())
    }

    /// Numbers of 24 bits, the middle between two, and what is just beside the middle.
    #[test]
    fn rounding_is_to_nearest_even() {
        let odd = (1 << 23) + 5;
        for (halves, more, rounded) in [
            (2 * odd, 0, odd),
            (2 * odd + 1, -1, odd),
            (2 * odd + 1, 0, odd + 1),
            (2 * odd + 1, 1, odd + 1),
            (2 * odd + 3, -1, odd + 1),
            (2 * odd + 3, 0, odd + 1),
            (2 * odd + 3, 1, odd + 2),
            ((1 << 25) - 1, 0, 1 << 24),
        ] {
            for shift in [-300, 0, 250] {
                let numerator: BigInt = ((BigInt::from(halves) << 70) + more) << 400;
                let denominator = BigInt::from(1) << (471 - shift);
                let expected = f64::from(rounded) * 2f64.powi(shift);
                assert_eq!(nearest(&numerator, &denominator), expected);
                assert_eq!(nearest(&-numerator, &denominator), -expected);
            }
        }
        assert_eq!(nearest(&BigInt::from(0), &BigInt::from(7)), 0.0);
        let least = f64::from(f32::MIN_POSITIVE);
        let below = least - 2f64.powi(-150);
        assert_eq!(below as f32, f32::MIN_POSITIVE);
        let sizes = [least, below, 2f64.powi(128), -2f64.powi(128), f64::from(3e38f32)];
        assert_eq!(sizes.map(narrow), [f32::MIN_POSITIVE, 0.0, f32::INFINITY, f32::NEG_INFINITY, 3e38]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        /// What the filter lets through is what integers say, also of ranges that begin or end about where the hit is.
        #[test]
        fn rough_agrees_with_exact(
            origin in point(), direction in point(), corners in prop::array::uniform3(point()), ends in 0u32..16,
        ) {
            prop_assume!(direction != [0.0; 3]);
            let ray = Ray::new(origin, direction);
            let exact = Exact::new(&ray, &corners);
            let mut ray = ray;
            if exact.inside() {
                let t = exact.rounded()[0];
                ray.t_min = [0.0, t.next_down(), t, t.next_up()][ends as usize % 4];
                ray.t_max = [f32::INFINITY, t.next_down(), t, t.next_up()][ends as usize / 4];
            }
            let expected = (exact.inside() && exact.is_in_range(&ray)).then(|| exact.t());
            let found = cross(&ray, &corners);
            prop_assert_eq!(found.is_some(), expected.is_some());
            if let (Some(t), Some(exact)) = (found, expected) {
                prop_assert!((t - exact).abs() <= ACCURACY * exact.abs(), "{} {}", t, exact);
            }
        }
    }
}
