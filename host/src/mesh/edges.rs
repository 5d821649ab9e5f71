//! Whether a mesh is closed: how its triangles meet at edges.

use super::{Mesh, repair::settle};
use rayon::prelude::*;
use std::ops::Range;

/// Edges of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct EdgeCount {
    /// How many there are.
    pub count: u64,
    /// Vertices of the first of them, by triangle number.
    pub first: Option<[u32; 2]>,
}

/// How triangles meet at edges; vertices at one place are one vertex. See [`Mesh::edges`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Edges {
    /// All edges.
    pub count: u64,
    /// Edges of a single triangle: the border of the surface.
    pub border: EdgeCount,
    /// Edges of two triangles that go along it in the same direction: one of them shows its other side, which is also
    /// called inconsistent winding or orientation.
    pub turned: EdgeCount,
    /// Edges of more than two triangles, also called non-manifold.
    pub crowded: EdgeCount,
    /// Edges along which more triangles go in one direction than in the other.
    pub open: EdgeCount,
}

impl Edges {
    /// Whether the surface is closed and all its triangles show outward, or all inward, part by part: along every edge
    /// as many triangles go one way as the other. Then [`Scene::winding`](crate::Scene::winding) is a property of a
    /// point.
    pub const fn are_closed(&self) -> bool {
        self.open.count == 0
    }
}

/// An edge of a triangle, listed at the lower of its ends: the higher one, the triangle, and whether that goes from the
/// lower to the higher, in bits 32 to 63, 1 to 31 and 0.
type Use = u64;

impl Mesh {
    /// How triangles meet at edges. Vertices count by place, where dust is 0, so that a mesh whose triangles share no
    /// vertices may be closed. Triangles without area count too, but for those with two corners at one place.
    pub fn edges(&self) -> Edges {
        if self.repairs.flushed == 0 {
            return edges(self.positions(), self.triangles());
        }
        let settled = self.positions().par_iter().map(|p| p.map(|x| settle(x, self.dust)));
        edges(&settled.collect::<Vec<_>>(), self.triangles())
    }
}

/// How triangles meet at edges: see [`Mesh::edges`].
pub(crate) fn edges(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Edges {
    let places = places(positions);
    // Each thread looks for the edges of as many vertices.
    let part = positions.len().div_ceil(rayon::current_num_threads()).max(1);
    let parts = (0..positions.len()).into_par_iter().step_by(part);
    let sums = parts.map(|first| of_vertices(first..positions.len().min(first + part), &places, triangles));
    sums.reduce(Sum::default, Sum::and).edges()
}

/// Counts edges of which the lower end is one of these vertices.
fn of_vertices(vertices: Range<usize>, places: &[u32], triangles: &[[u32; 3]]) -> Sum {
    let (first, count) = (vertices.start as u32, vertices.len());
    let sides = || {
        let of = move |(triangle, corners): (u64, &[u32; 3])| {
            let [a, b, c] = corners.map(|vertex| places[vertex as usize]);
            let whole = a != b && b != c && c != a;
            [(a, b), (b, c), (c, a)].into_iter().filter_map(move |(p, q)| {
                let listed = u64::from(p.max(q)) << 32 | triangle << 1 | u64::from(p < q);
                let at = p.min(q).wrapping_sub(first) as usize;
                (whole && at < count).then_some((at, listed))
            })
        };
        (0..).zip(triangles).flat_map(of)
    };
    // Where the edges of a vertex end in the list, and then where they begin.
    let mut ends = vec![0; count + 1];
    sides().for_each(|(at, _)| ends[at] += 1);
    let mut all = 0;
    for end in &mut ends {
        all += *end;
        *end = all;
    }
    let mut uses: Vec<Use> = vec![0; all];
    for (at, listed) in sides() {
        ends[at] -= 1;
        uses[ends[at]] = listed;
    }
    let mut sum = Sum::default();
    for (low, range) in (first..).zip(ends.windows(2)) {
        let uses = &mut uses[range[0]..range[1]];
        uses.sort_unstable();
        uses.chunk_by(|x, y| x >> 32 == y >> 32).for_each(|edge| sum.count(low, edge));
    }
    sum
}

/// Edges counted so far: all, then those of each kind, of which the lowest triangle with its edge.
#[derive(Clone, Copy)]
struct Sum {
    all: u64,
    kinds: [(u64, (u32, [u32; 2])); 4],
}

impl Default for Sum {
    fn default() -> Self {
        Self { all: 0, kinds: [(0, (u32::MAX, [0; 2])); 4] }
    }
}

impl Sum {
    /// Counts an edge by its uses.
    fn count(&mut self, low: u32, edge: &[Use]) {
        let forward = edge.iter().filter(|&one| one & 1 != 0).count();
        let is =
            [edge.len() == 1, edge.len() == 2 && forward != 1, edge.len() > 2, 2 * forward != edge.len()];
        // They are in order.
        let (triangle, high) = ((edge[0] as u32) >> 1, (edge[0] >> 32) as u32);
        self.all += 1;
        for ((count, first), _) in self.kinds.iter_mut().zip(is).filter(|(_, is)| *is) {
            *count += 1;
            *first = (*first).min((triangle, [low, high]));
        }
    }

    fn and(mut self, other: Self) -> Self {
        self.all += other.all;
        for ((count, first), (more, other)) in self.kinds.iter_mut().zip(other.kinds) {
            *count += more;
            *first = (*first).min(other);
        }
        self
    }

    fn edges(self) -> Edges {
        let [border, turned, crowded, open] =
            self.kinds.map(|(count, (_, edge))| EdgeCount { count, first: (count > 0).then_some(edge) });
        Edges { count: self.all, border, turned, crowded, open }
    }
}

/// For each vertex the lowest number of those at its place.
pub(crate) fn places(positions: &[[f32; 3]]) -> Vec<u32> {
    let at = |(vertex, place): (u32, &[f32; 3])| (place.map(|x| (x + 0.0).to_bits()), vertex);
    let mut order: Vec<([u32; 3], u32)> = (0..).zip(positions).map(at).collect();
    order.par_sort_unstable();
    let mut places = vec![0; order.len()];
    for same in order.chunk_by(|x, y| x.0 == y.0) {
        same.iter().for_each(|&(_, vertex)| places[vertex as usize] = same[0].1);
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron whose triangles share no vertices, some of them with zeros of the other sign, or dust; of each the
    /// corners in order, or not.
    fn tetrahedron(turned: [bool; 4], count: usize) -> Edges {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let listed = faces.iter().zip(turned).take(count);
        let positions = listed.flat_map(|(&[a, b, c], turned)| if turned { [a, c, b] } else { [a, b, c] });
        let signed = |(i, corner): (usize, usize)| {
            corners[corner].map(|x: f32| if x == 0.0 { [-0.0, 0.0, 1e-25][i % 9 / 3] } else { x })
        };
        let positions: Vec<[f32; 3]> = positions.enumerate().map(signed).collect();
        let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Mesh::new(positions, triangles).unwrap().edges()
    }

    #[test]
    fn closed_open_and_turned_surfaces_are_told_apart() {
        for all in [false, true] {
            let closed = tetrahedron([all; 4], 4);
            assert!(closed.are_closed());
            assert_eq!(closed, Edges { count: 6, ..Edges::default() });
        }
        let open = tetrahedron([false; 4], 3);
        assert!(!open.are_closed());
        assert_eq!((open.count, open.border.count, open.open.count), (6, 3, 3));
        let turned = tetrahedron([false, false, true, false], 4);
        assert!(!turned.are_closed());
        assert_eq!((turned.border.count, turned.turned.count, turned.open.count), (0, 3, 3));
    }

    #[test]
    fn crowded_edges_may_be_closed() {
        // Two tetrahedra that share an edge.
        let positions = vec![
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        let one = [[0, 3, 2], [0, 2, 1], [0, 1, 3], [2, 3, 1]];
        let two = one.map(|t: [u32; 3]| t.map(|v| if v > 1 { v + 2 } else { v }));
        let mesh = Mesh::new(positions, [one, two].concat()).unwrap();
        let edges = mesh.edges();
        assert!(edges.are_closed());
        assert_eq!((edges.crowded.count, edges.crowded.first), (1, Some([0, 1])));
        // The poles of a teapot have triangles with two corners at one place.
        assert!(!Mesh::teapot(3).edges().are_closed());
    }
}
