//! Each triangle is a cluster, in the order of the curve.

use super::{Binary, JOB_TRIANGLES};
use crate::{
    bounds::Bounds,
    glam::{UVec2, UVec4},
    mem::{Buf, Slots},
    mesh::triangle,
};

/// Writes the node of the triangle that is number `i` along the curve.
pub fn singles(
    i: u32,
    job: &Buf<u32>,
    positions: &Buf<f32>,
    indices: &Buf<u32>,
    kept: &Buf<u32>,
    places: &Buf<UVec2>,
    triangles: &mut Buf<u32>,
    clusters: &mut Buf<u32>,
    nodes: &mut Buf<UVec4>,
) {
    if i < job.at(JOB_TRIANGLES) {
        let id = kept.at(places.at(i).y);
        let (a, b, c) = triangle(positions, indices, id);
        Binary { bounds: Bounds::of(a, b, c), count: 1, shares: 0 }.store(nodes, i);
        triangles.put(i, id);
        clusters.put(i, i);
    }
}

kernel! {
    /// [`singles`] over all triangles.
    map SINGLES = singles, threads 128, {
        0 job: read u32, 1 positions: read f32, 2 indices: read u32, 3 kept: read u32, 4 places: read UVec2,
        5 triangles: write u32, 6 clusters: write u32, 7 nodes: write UVec4,
    }
}
