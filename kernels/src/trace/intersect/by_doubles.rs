//! The second stage of the [exact test](super::exact) on a GPU that has doubles at much of the speed of floats. It asks
//! what `filter.rs` asks, in a third of the instructions: one bound serves all edges, conversions are few, and what it
//! does not decide, one triangle of tens of thousands, is left to the next stage at once.

use super::{
    filter::{Turned, Verdict, all_turned, turned, way_of},
    wide::{Wide, product_difference},
};
use crate::{
    glam::Vec3,
    math::{Digits as _, exp2},
    pair::{Long as _, Pair},
    trace::frame::Frame,
};

/// A power of two.
const fn power(e: i32) -> f64 {
    exp2(e) as f64
}

/// Without the sign.
#[inline(always)]
fn size(x: f64) -> f64 {
    if x < 0.0 { -x } else { x }
}

/// The reciprocal within `2^-51` of it, of a number that is normal as a float.
#[inline(always)]
fn inverse(x: f64) -> f64 {
    let near = x as f32;
    let unit = near.unit();
    let r = f64::from((near * unit).inverse() * unit);
    let r = r + r * (1.0 - r * x);
    r + r * (1.0 - r * x)
}

/// Between which floats a number lies when rounded, if it may be off by `error`, of which half is for rounding here.
#[inline(always)]
fn rounded(x: f64, error: f64) -> (f32, f32) {
    ((x - error) as f32, (x + error) as f32)
}

/// `a * (b * c - d * e)`, and the size of its products.
#[inline(always)]
fn part([a, b, c, d, e]: [Pair; 5]) -> (Wide, f32) {
    let size = a.hi.abs() * ((b.hi * c.hi).abs() + (d.hi * e.hi).abs());
    let (bc, de) = (Wide::of(b).times(Wide::of(c)), Wide::of(d).times(Wide::of(e)));
    (bc.plus_about(de.negative()).times(Wide::of(a)), size)
}

/// Six times the volume of a triangle and the ray's origin, and what it may be off by.
#[inline(always)]
fn volume(from: &Turned<f32>, [a, b, c]: &[Turned<f32>; 3]) -> (f64, f32) {
    let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (from.to(a), from.to(b), from.to(c));
    let x = part([ax, by, cz, bz, cy]);
    let y = part([ay, bz, cx, bx, cz]);
    let z = part([az, bx, cy, by, cx]);
    let six = x.0.plus_about(y.0).plus_about(z.0);
    (six.short(), exp2(-94) * (x.1 + y.1 + z.1) + exp2(-100))
}

/// The answer, given the best `t` so far, and whether at the same `t` the triangle comes after it.
///
/// With `e = 2^-53` and `M` the scene's size as seen from the origin, corners across the ray have coordinates `x`
/// within `3 e |x|` and `off`. That is `2^-100 M` where differences are exact and the direction has all its digits,
/// else at most `4 e M` and `2^-64 M`. So an edge function `x y' - y x'` is off by at most
/// `8 e (|x y'| + |y x'|) + off (|x| + |y| + |x'| + |y'| + 2 off)`.
#[inline(always)]
pub(super) fn by_doubles(ray: &Frame, vertices: (Vec3, Vec3, Vec3), best: f32, after: bool) -> Verdict {
    let (way, all_of_it) = way_of(ray);
    let from = turned(ray.origin, ray.main);
    let [a, b, c] = all_turned(vertices, ray.main);
    let (dx, dy, dz) = (f64::from(way.x), f64::from(way.y), f64::from(way.z));
    let seen = |p: &Turned<f32>| {
        let to = |p: f32, from: f32| f64::from(p) - f64::from(from);
        let (x, y, z) = (to(p.x, from.x), to(p.y, from.y), to(p.z, from.z));
        (product_difference(x, dz, z, dx), product_difference(y, dz, z, dy), z)
    };
    let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (seen(&a), seen(&b), seen(&c));
    // Then differences are multiples of `2^-50 M`, and no larger than `M`.
    let far = ray.pad * exp2(19);
    let fits = |x: f32| (x == 0.0) | (x.abs() > far * exp2(-26));
    let all_fit = |p: &Turned<f32>| fits(p.x) & fits(p.y) & fits(p.z);
    let whole = all_of_it & all_fit(&from) & all_fit(&a) & all_fit(&b) & all_fit(&c);
    let off = f64::from(far) * if whole { power(-100) } else { power(-50) };

    let edge = |p: f64, q: f64| (p - q, size(p) + size(q));
    let (u, of_u) = edge(cx * by, cy * bx);
    let (v, of_v) = edge(ax * cy, ay * cx);
    let (w, of_w) = edge(bx * ay, by * ax);
    let sizes = ((size(ax) + size(ay)) + (size(bx) + size(by))) + (size(cx) + size(cy));
    let error = power(-49) * ((of_u + of_v) + of_w) + off * (sizes + 2.0 * off) + power(-98);
    let positive = (u > error, v > error, w > error);
    let negative = (u < -error, v < -error, w < -error);
    let missed = (positive.0 | positive.1 | positive.2) & (negative.0 | negative.1 | negative.2);
    let passes = (positive.0 & positive.1 & positive.2) | (negative.0 & negative.1 & negative.2);
    let det = (u + v) + w;
    let told = (size(det) > 128.0 * error) & (size(det) > power(-70));
    if missed | !told {
        return Verdict { certain: missed, hit: false, t: 0.0, u: 0.0, v: 0.0 };
    }

    let along = inverse(det * dz);
    let inverse = along * dz;
    // A weight and the sum, both off, the latter by a 40th at most: 40 / 39, and room for rounding.
    let part = 1.25 * error * size(inverse);
    let deep = (size(az) + size(bz)) + size(cz);
    // `t` hangs on weights by how far the corners' depths are apart.
    let spread = size(bz - az) + size(cz - az);
    let t = ((u * az + v * bz) + w * cz) * along;
    let (mut near, mut later) = rounded(t, 3.0 * part * spread + power(-49) * deep + off + power(-100));
    // Where origin and corners are in one plane across an axis.
    let on = |a: f32, b: f32, c: f32, from: f32| (a == from) & (b == from) & (c == from);
    let zero = on(a.x, b.x, c.x, from.x) | on(a.y, b.y, c.y, from.y) | on(a.z, b.z, c.z, from.z);
    if zero {
        (near, later) = (0.0, 0.0);
    }
    let far_from_0 = |t: f32| t.abs() > exp2(-60);
    let mut sure = (near == later) & (zero | far_from_0(near));
    if !sure {
        // The mean of depths has lost its digits near the triangle's plane.
        let (six, by) = volume(&turned(ray.origin, 2), &all_turned(vertices, 2));
        let t = -(six * dz) * inverse;
        let off = size(t) * (3.0 * part + power(-48)) + 2.5 * f64::from(by) * size(inverse) + power(-100);
        (near, later) = rounded(t, off);
        sure = (near == later) & far_from_0(near);
    }
    let behind = (near > best) | ((near == later) & (near == best) & after);
    if behind | (near > ray.t_max) | (later < ray.t_min) {
        return Verdict { certain: true, hit: false, t: 0.0, u: 0.0, v: 0.0 };
    }
    let weight = |of: f64| {
        let x = of * inverse;
        rounded(x, part * (1.0 + 3.0 * size(x)) + power(-48) * size(x) + power(-100))
    };
    let (u, v) = (weight(v), weight(w));
    let certain = passes & sure & (u.0 == u.1) & (v.0 == v.1);
    Verdict { certain, hit: true, t: near, u: u.0, v: v.0 }
}
