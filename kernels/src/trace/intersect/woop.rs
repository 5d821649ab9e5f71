//! The test of Woop, Benthin & Wald 2013, "Watertight ray/triangle intersection", in `f32` throughout.
//!
//! Edge functions are differences of rounded products. Where one is 0 the paper computes all three again in
//! `f64`; there is none on every GPU, so 0 counts as inside. Both triangles at an edge then still agree and
//! there is no gap, but of rays within rounding of an edge some count as hits that pass it by, and which of
//! two triangles is hit, and `t` on grazing rays, may be wrong. `strict` has the signs right instead.
//!
//! Sheared coordinates below `2^-39` count as 0, for all triangles at a vertex alike. The shear is by a
//! product with the direction's reciprocal instead of a quotient, as many programs do: a rounding more, the
//! same for all triangles.

use super::{
    Best, Corners, Intersector,
    strict::{PRODUCT_FLOOR, Sheared, shear},
    vertices,
};
use crate::{
    math::{component, div, exp2, exponent},
    trace::frame::{Frame, flush},
};

/// The test.
#[derive(Clone, Copy, Debug)]
pub struct Woop;

/// The vertices seen from the ray, with products that do not underflow.
#[inline(always)]
fn seen(ray: &Frame, corners: Corners) -> Sheared {
    let s = shear(ray, vertices(corners));
    Sheared {
        ax: flush(s.ax, PRODUCT_FLOOR),
        ay: flush(s.ay, PRODUCT_FLOOR),
        bx: flush(s.bx, PRODUCT_FLOOR),
        by: flush(s.by, PRODUCT_FLOOR),
        cx: flush(s.cx, PRODUCT_FLOOR),
        cy: flush(s.cy, PRODUCT_FLOOR),
        ..s
    }
}

impl Intersector for Woop {
    type Seen = Sheared;

    #[inline(always)]
    fn new(_ray: &Frame) -> Self {
        Self
    }

    #[inline(always)]
    fn look(self, ray: &Frame, corners: Corners) -> (Sheared, bool) {
        let s = seen(ray, corners);
        (s, s.agree())
    }

    #[inline(always)]
    fn test(self, ray: &Frame, id: u32, _corners: Corners, s: Sheared, best: &mut Best) -> bool {
        let u = s.cx * s.by - s.cy * s.bx;
        let v = s.ax * s.cy - s.ay * s.cx;
        let w = s.bx * s.ay - s.by * s.ax;
        let negative = u < 0.0 || v < 0.0 || w < 0.0;
        let positive = u > 0.0 || v > 0.0 || w > 0.0;
        // Neither: the sum of the weights is 0, a miss.
        if negative != positive {
            let unit = exp2(-exponent(u + v + w));
            let (u, v, w) = (u * unit, v * unit, w * unit);
            let inverse = div(1.0, u + v + w);
            let t = s.depth(component(ray.inverse, ray.main), u, v, w) * inverse;
            best.offer(ray, Best { t, triangle: id, u: v * inverse, v: w * inverse, det: 1.0 });
        }
        true
    }
}

test!(WOOP, brute_woop::BRUTE_WOOP = Woop);
