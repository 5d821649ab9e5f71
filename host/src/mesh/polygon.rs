//! Faces of more than three corners, cut into triangles.
//!
//! A face is looked at along the axis that shows most of it, where its coordinates stay what they are, and every
//! decision is exact. Where the fan from its first corner covers it, as always if it is convex, it stays that fan.
//! Else it is cut by a constrained Delaunay triangulation, which keeps every corner, those on a straight edge too,
//! so that neighbours still meet without gaps; inside is what an odd number of edges encloses.

use super::error::{MeshError, Place, Spot, malformed};
use super::raw::{Polygon, Raw};
use super::repair::{exponent, power_of_two};
use crate::vector::{cross, sub};
use rayon::prelude::*;
use robust::{Coord, orient2d};
use spade::handles::FixedVertexHandle;
use spade::{
    ConstrainedDelaunayTriangulation, HierarchyHintGenerator, Intersection, LineIntersectionIterator, Point2,
    Triangulation, mitigate_underflow,
};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// What became of a face.
enum Cut {
    /// The fan covers it.
    Fan,
    /// It has other triangles, as many.
    Other(Vec<[u32; 3]>),
    /// Its edges cross, or a corner touches one from outside.
    Crossed,
    /// It would take too long.
    TooMuch,
}

/// A face is bent if it is thicker than this part of its extent.
const FLAT: f64 = 1.0e-3;

/// Steps that the edges of a file's concave faces may take to be found, which grows as the square of the edges of other
/// triangles that are in the way of one: half a minute. Only faces of long thin teeth, tens of thousands of them, take
/// so many.
const MOST_STEPS: u64 = 1 << 32;

/// Cuts the faces that their fans do not cover, counts them, and those that are crossed or bent.
pub(super) fn cut(raw: &mut Raw) -> Result<(), MeshError> {
    let polygons = std::mem::take(&mut raw.polygons);
    let Raw { positions, triangles, .. } = &*raw;
    let work = AtomicU64::new(0);
    let looked_at = |polygon: &Polygon| {
        let fan = &triangles[polygon.first as usize..][..polygon.triangles as usize];
        let corners: Vec<u32> = fan[0][..2].iter().copied().chain(fan.iter().map(|t| t[2])).collect();
        let points: Vec<[f64; 3]> = corners.iter().map(|&v| positions[v as usize]).collect();
        let (cut, bent) = judge(&corners, &points, &work);
        (bent || !matches!(cut, Cut::Fan)).then_some((*polygon, cut, bent))
    };
    let odd: Vec<_> = polygons.par_iter().filter_map(looked_at).collect();
    for (polygon, cut, bent) in odd {
        let Polygon { first, triangles, at } = polygon;
        let spot = || if raw.binary { Spot::Element("face".to_owned(), at) } else { Spot::Line(at) };
        match cut {
            Cut::Fan => {}
            Cut::Other(others) => {
                raw.repairs.concave += 1;
                raw.triangles[first as usize..][..triangles as usize].copy_from_slice(&others);
            }
            Cut::Crossed => {
                raw.repairs.crossed += 1;
                raw.repairs.crossed_at.get_or_insert_with(spot);
            }
            Cut::TooMuch => {
                let corners = triangles + 2;
                let what =
                    format!("this concave face of {corners} corners takes too long to cut into triangles");
                return Err(malformed(Place { file: None, spot: spot() }, what));
            }
        }
        if bent {
            raw.repairs.bent += 1;
            raw.repairs.bent_at.get_or_insert_with(spot);
        }
    }
    Ok(())
}

/// How a face is cut, and whether it is bent.
fn judge(corners: &[u32], points: &[[f64; 3]], work: &AtomicU64) -> (Cut, bool) {
    let apex = points[0];
    // What the fan's triangles amount to, with their signs, and what each axis shows of them.
    let (mut normal, mut shown) = ([0.0; 3], [0.0f64; 3]);
    for pair in points[1..].windows(2) {
        let area = cross(sub(pair[0], apex), sub(pair[1], apex));
        for axis in 0..3 {
            normal[axis] += area[axis];
            shown[axis] += area[axis].abs();
        }
    }
    let axis = (0..3).fold(0, |best, axis| if shown[axis] > shown[best] { axis } else { best });
    if shown[axis] == 0.0 {
        return (Cut::Fan, false);
    }
    let flat: Vec<[f64; 2]> = points.iter().map(|p| [p[(axis + 1) % 3], p[(axis + 2) % 3]]).collect();
    let cut = if fan_covers(&flat) { Cut::Fan } else { others(corners, &flat, work) };
    let bent = !matches!(cut, Cut::Crossed) && is_bent(points, normal);
    (cut, bent)
}

/// Whether the corners' distances from a plane with this normal differ by much.
fn is_bent(points: &[[f64; 3]], normal: [f64; 3]) -> bool {
    let span = |height: &dyn Fn(&[f64; 3]) -> f64| {
        let (lo, hi) = points
            .iter()
            .map(height)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
        hi - lo
    };
    let extent = (0..3).map(|axis| span(&|p| p[axis])).fold(0.0, f64::max);
    let largest = normal.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    if largest == 0.0 {
        return false;
    }
    let normal = normal.map(|x| x / largest);
    let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
    let apex = points[0];
    span(&|p| (0..3).map(|axis| (p[axis] - apex[axis]) * normal[axis]).sum()) > FLAT * extent * length
}

fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    let [a, b, c] = [a, b, c].map(|[x, y]| Coord { x, y });
    orient2d(a, b, c)
}

/// Whether the triangles of the fan from the first corner lie side by side: then they are the face. Seen from
/// there, the corners must go round one way, and not all the way round.
fn fan_covers(points: &[[f64; 2]]) -> bool {
    let apex = points[0];
    let mut around = points.iter().copied().filter(|&p| p != apex);
    let Some(start) = around.next() else { return true };
    let (mut previous, mut sign, mut second_half) = (start, 0.0, false);
    for next in around {
        let step = turn(apex, previous, next);
        if step == 0.0 {
            let between = |i: usize| {
                previous[i] < apex[i] && apex[i] < next[i] || next[i] < apex[i] && apex[i] < previous[i]
            };
            if between(0) || between(1) {
                return false;
            }
        } else {
            if sign * step < 0.0 {
                return false;
            }
            sign = step.signum();
            let side = turn(apex, start, next) * sign;
            if second_half && side >= 0.0 {
                return false;
            }
            second_half |= side < 0.0;
        }
        previous = next;
    }
    true
}

/// The order in which points come into the triangulation: in rounds that double in number, each along a curve that
/// fills the plane (Amenta, Choi & Rote 2003, "Incremental constructions con BRIO"). Corners in order of the face,
/// or all along a curve, take quadratic time for some shapes.
fn rounds(points: &[[f64; 2]]) -> Vec<usize> {
    let key = |i: usize| {
        let round = crate::random::Random::new(i as u64).bits().trailing_zeros();
        // Points are below 2 in size. Bits of x and y in turn.
        let bits = |x: f64| {
            (0..16).map(|b| u64::from(((x + 2.0) * 16384.0) as u32 >> b & 1) << (2 * b)).sum::<u64>()
        };
        (u32::MAX - round, bits(points[i][0]) << 1 | bits(points[i][1]))
    };
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_cached_key(|&i| key(i));
    order
}

/// Triangles of a face that its fan does not cover, as many as the fan has.
fn others(corners: &[u32], points: &[[f64; 2]], work: &AtomicU64) -> Cut {
    // Powers of two change no decision, and bring the numbers to where the predicates are exact.
    let scale = [0, 1].map(|axis| {
        let largest = points.iter().fold(0.0f64, |most, p| most.max(p[axis].abs()));
        if largest == 0.0 { 1.0 } else { power_of_two(-exponent(largest)) }
    });
    let points: Vec<[f64; 2]> =
        points.iter().map(|p| [p[0] * scale[0] + 0.0, p[1] * scale[1] + 0.0]).collect();
    let mut cdt =
        ConstrainedDelaunayTriangulation::<Point2<f64>, (), (), (), HierarchyHintGenerator<f64>>::new();
    let order = rounds(&points);
    let mut vertices = vec![FixedVertexHandle::from_index(0); points.len()];
    for &i in &order {
        let Ok(vertex) = cdt.insert(mitigate_underflow(Point2::new(points[i][0], points[i][1]))) else {
            return Cut::Crossed;
        };
        vertices[i] = vertex;
    }
    // The lowest corner at each place.
    let mut corner_at = vec![usize::MAX; cdt.num_vertices()];
    for (i, vertex) in vertices.iter().enumerate().rev() {
        corner_at[vertex.index()] = i;
    }
    let mut odd = vec![false; cdt.num_undirected_edges()];
    let mut some_edge = Vec::new();
    for &i in &order {
        let (from, to) = (vertices[i], vertices[(i + 1) % points.len()]);
        if from == to {
            continue;
        }
        let in_the_way = LineIntersectionIterator::new_from_handles(&cdt, from, to)
            .filter(|it| matches!(it, Intersection::EdgeIntersection(_)))
            .count() as u64;
        let steps = in_the_way * in_the_way;
        if work.fetch_add(steps, Relaxed).saturating_add(steps) > MOST_STEPS {
            return Cut::TooMuch;
        }
        let edges = cdt.try_add_constraint(from, to);
        if edges.is_empty() {
            return Cut::Crossed;
        }
        for edge in &edges {
            odd[edge.as_undirected().index()] ^= true;
        }
        some_edge.push(edges[0]);
    }
    // From outside to inside, and out again.
    let mut inside: Vec<Option<bool>> = vec![None; cdt.num_all_faces()];
    inside[cdt.outer_face().fix().index()] = Some(false);
    let mut borders: Vec<_> =
        cdt.convex_hull().map(|edge| if edge.is_outer_edge() { edge } else { edge.rev() }).collect();
    while let Some(border) = borders.pop() {
        let here = inside[border.face().fix().index()].unwrap_or_default();
        let beyond = border.rev().face();
        let there = &mut inside[beyond.fix().index()];
        if there.is_none() {
            *there = Some(here != odd[border.as_undirected().fix().index()]);
            borders.extend(beyond.as_inner().iter().flat_map(|face| face.adjacent_edges()));
        }
    }
    let is_inside = |face: usize| inside[face] == Some(true);
    // The face's direction: inside lies left of its edges, or right.
    let single = some_edge.iter().find(|edge| odd[edge.as_undirected().index()]);
    let left = single.is_none_or(|&edge| is_inside(cdt.directed_edge(edge).face().fix().index()));
    let mut found: Vec<[u32; 3]> = Vec::new();
    for face in cdt.inner_faces().filter(|face| is_inside(face.fix().index())) {
        let [a, b, c] = face.vertices().map(|vertex| corner_at[vertex.index()] as u32);
        let mut triangle = if left { [a, b, c] } else { [a, c, b] };
        let lowest = (0..3).fold(0, |best, i| if triangle[i] < triangle[best] { i } else { best });
        triangle.rotate_left(lowest);
        found.push(triangle);
    }
    // A corner that touches another edge from outside makes one more than there are numbers for.
    if found.len() > points.len() - 2 {
        return Cut::Crossed;
    }
    found.sort_unstable();
    // Where corners coincide there are fewer: the rest have no area.
    found.resize(points.len() - 2, [0; 3]);
    Cut::Other(found.into_iter().map(|t| t.map(|corner| corners[corner as usize])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_limited_over_all_faces() {
        let mut random = crate::random::Random::new(1);
        let teeth =
            (0..500).map(|i| [f64::from(i), if i % 2 == 0 { 1.0 } else { 2.0 + 500.0 * random.unit() }]);
        let points: Vec<[f64; 2]> = teeth.chain([[499.0, 0.0], [0.0, 0.0]]).collect();
        let corners: Vec<u32> = (0..points.len() as u32).collect();
        let work = AtomicU64::new(0);
        assert!(matches!(others(&corners, &points, &work), Cut::Other(_)));
        let one = work.load(Relaxed);
        assert!(one > 0);
        let nearly = AtomicU64::new(MOST_STEPS - one);
        assert!(matches!(others(&corners, &points, &nearly), Cut::Other(_)));
        assert!(matches!(others(&corners, &points, &nearly), Cut::TooMuch));
    }
}
