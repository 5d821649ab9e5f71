//! The point where the ray meets the triangle's plane, and whether it is inside, by three edge functions in
//! the projection along the largest component of the normal (Snyder & Barr 1987, "Ray tracing complex models
//! containing surface tessellations").
//!
//! The point depends on the whole triangle, so neighbours do not agree about their edge, less so the farther
//! the point is from the scene's origin: it is rounded to coordinates.

use super::{
    Best, Corners, Intersector,
    unit::{Unit, cross, dot, largest},
    vertices,
};
use crate::{
    glam::Vec3,
    math::{abs, component, cycle, div, exp2},
    trace::frame::{Frame, flush},
};

/// Smaller `t` are 0, in a [`Unit`].
const T_FLOOR: f32 = exp2(-40);
/// Points farther away belong to no triangle, in a [`Unit`].
const BEYOND: f32 = exp2(41);

/// The test.
#[derive(Clone, Copy, Debug)]
pub struct Plane(Unit);

/// On which side of the edge from `p` to `q` the point is, seen along an axis: twice the area they span.
#[inline(always)]
fn side(unit: Unit, axis: u32, p: Vec3, q: Vec3, point: Vec3) -> f32 {
    let (edge, way) = (cycle(unit.between(p, q), axis), cycle(unit.between(p, point), axis));
    edge.x * way.y - edge.y * way.x
}

impl Intersector for Plane {
    type Seen = ();

    #[inline(always)]
    fn new(ray: &Frame) -> Self {
        Self(Unit::new(ray))
    }

    #[inline(always)]
    fn look(self, _ray: &Frame, _corners: Corners) -> ((), bool) {
        ((), true)
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, corners: Corners, _seen: (), best: &mut Best) -> bool {
        let Self(unit) = self;
        let (a, b, c) = vertices(corners);
        let normal = cross(unit.between(a, b), unit.between(a, c));
        let along = dot(normal, ray.direction);
        if along != 0.0 {
            let t = flush(div(dot(normal, unit.between(ray.origin, a)), along), T_FLOOR);
            let near = abs(t) < BEYOND;
            let t = unit.undone(t);
            if near && best.may_take(ray, t) {
                let point = ray.origin + ray.direction * t;
                let axis = largest(normal);
                let size = component(normal, axis);
                let sign = if size < 0.0 { -1.0 } else { 1.0 };
                let u = sign * side(unit, axis, c, a, point);
                let v = sign * side(unit, axis, a, b, point);
                let w = sign * side(unit, axis, b, c, point);
                if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                    best.offer(ray, Best { t, triangle: id, u, v, det: abs(size) });
                }
            }
        }
        true
    }
}

test!(PLANE, brute_plane::BRUTE_PLANE = Plane);
