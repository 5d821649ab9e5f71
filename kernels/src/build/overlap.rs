//! Whether a triangle reaches into a box: separating axes (Akenine-Möller 2001), erring on the side of yes.
//!
//! # Rounding
//! Let `u = 2^-24`, and `w` the largest coordinate, by magnitude, of the vertices from the box's centre. The centre is
//! whatever number comes out, off by `2 u` of its size; half extents are made larger by that. A vertex is then
//! off by `u w`, an edge `e`, taken before the move, by `u |e|`, a projection on an axis across it by less than
//! `8 u (|e1| + |e2|) w`, and the normal by `8 u |d| |e|`. `SLACK` is `64 u`; `TINY` covers what underflow takes.
//!
//! Without branches: sums of magnitudes stand for the largest, which only adds slack.

use crate::{
    glam::Vec3,
    math::{abs, exp2},
};

const SLACK: f32 = exp2(-18);
const TINY: f32 = exp2(-100);

/// Whether the projections of the triangle and of the box meet on an axis across an edge, `(-ez, ey)` in the plane
/// of two coordinates. The triangle reaches from a vertex of the edge, `(py, pz)`, to the third one, `(qy, qz)`.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "four points of a plane and a number")]
fn across(ey: f32, ez: f32, py: f32, pz: f32, qy: f32, qz: f32, hy: f32, hz: f32, slack: f32) -> bool {
    let (a, b) = (ey * pz - ez * py, ey * qz - ez * qy);
    let (ey, ez) = (abs(ey), abs(ez));
    let reach = hy * ez + hz * ey + (ey + ez) * slack + TINY;
    ((a <= reach) | (b <= reach)) & ((a >= -reach) | (b >= -reach))
}

/// The three axes across one edge.
#[inline(always)]
fn edge(e: Vec3, p: Vec3, q: Vec3, h: Vec3, slack: f32) -> bool {
    across(e.y, e.z, p.y, p.z, q.y, q.z, h.y, h.z, slack)
        & across(e.z, e.x, p.z, p.x, q.z, q.x, h.z, h.x, slack)
        & across(e.x, e.y, p.x, p.y, q.x, q.y, h.x, h.y, slack)
}

#[inline(always)]
fn size(v: Vec3) -> f32 {
    abs(v.x) + abs(v.y) + abs(v.z)
}

/// No only if the closed triangle and the closed box `lo..hi` have no point in common. Their boxes are taken to meet.
#[inline(always)]
pub fn overlaps(a: Vec3, b: Vec3, c: Vec3, lo: Vec3, hi: Vec3) -> bool {
    let middle = (lo + hi) * 0.5;
    // Half the extent, and what rounding the centre may have moved it.
    let half = (hi - lo) * 0.5 + (hi - lo) * exp2(-20);
    let drift = size(middle) * exp2(-23);
    let half = half + Vec3::new(drift, drift, drift);
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let (a, b, c) = (a - middle, b - middle, c - middle);
    let far = size(a) + size(b) + size(c);
    // The triangle's plane.
    let n = Vec3::new(ab.y * bc.z - ab.z * bc.y, ab.z * bc.x - ab.x * bc.z, ab.x * bc.y - ab.y * bc.x);
    let apart = n.x * b.x + n.y * b.y + n.z * b.z;
    let thick = abs(n.x) * half.x + abs(n.y) * half.y + abs(n.z) * half.z;
    let slack = size(ab) * size(bc) * (far + size(half)) * SLACK + TINY;
    let slanted = far * SLACK;
    (abs(apart) <= thick + slack)
        & edge(ab, a, c, half, slanted)
        & edge(bc, b, a, half, slanted)
        & edge(ca, c, b, half, slanted)
}
