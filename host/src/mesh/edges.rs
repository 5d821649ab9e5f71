//! Whether a mesh is closed: how its triangles meet at edges.

use super::Mesh;
use rayon::prelude::*;

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

/// An edge of a triangle: its ends by number, the lower first, whether the triangle goes from the lower to the higher,
/// and which triangle that is.
type Use = (u32, u32, bool, u32);

impl Mesh {
    /// How triangles meet at edges. Vertices count by place, so that a mesh whose triangles share no vertices may be
    /// closed. Triangles without area count too, but for those with two corners at one place.
    pub fn edges(&self) -> Edges {
        let places = self.places();
        let mut uses: Vec<Use> = Vec::with_capacity(3 * self.triangles().len());
        for (triangle, corners) in (0..).zip(self.triangles()) {
            let [a, b, c] = corners.map(|vertex| places[vertex as usize]);
            if a != b && b != c && c != a {
                uses.extend([(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q), p < q, triangle)));
            }
        }
        uses.par_sort_unstable();
        let mut edges = Edges::default();
        // Of each kind the lowest triangle, and the edge.
        let mut firsts = [(u32::MAX, [0; 2]); 4];
        for edge in uses.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            let forward = edge.iter().filter(|one| one.2).count();
            let kinds =
                [edge.len() == 1, edge.len() == 2 && forward != 1, edge.len() > 2, 2 * forward != edge.len()];
            edges.count += 1;
            let counts = [&mut edges.border, &mut edges.turned, &mut edges.crowded, &mut edges.open];
            let triangle = edge.iter().map(|one| one.3).min().unwrap_or_default();
            for ((kind, counted), first) in kinds.into_iter().zip(counts).zip(&mut firsts) {
                if kind {
                    counted.count += 1;
                    *first = (*first).min((triangle, [edge[0].0, edge[0].1]));
                    counted.first = Some(first.1);
                }
            }
        }
        edges
    }

    /// For each vertex the lowest number of those at its place.
    pub(crate) fn places(&self) -> Vec<u32> {
        let at = |vertex: u32| self.positions()[vertex as usize].map(|x| (x + 0.0).to_bits());
        let mut order: Vec<u32> = (0..self.positions().len() as u32).collect();
        order.par_sort_unstable_by_key(|&vertex| (at(vertex), vertex));
        let mut places = vec![0; order.len()];
        for same in order.chunk_by(|&x, &y| at(x) == at(y)) {
            same.iter().for_each(|&vertex| places[vertex as usize] = same[0]);
        }
        places
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron whose triangles share no vertices, half of them with zeros of the other sign; of each the corners
    /// in order, or not.
    fn tetrahedron(turned: [bool; 4], count: usize) -> Edges {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let listed = faces.iter().zip(turned).take(count);
        let positions = listed.flat_map(|(&[a, b, c], turned)| if turned { [a, c, b] } else { [a, b, c] });
        let signed = |(i, corner): (usize, usize)| {
            corners[corner].map(|x: f32| if x == 0.0 && i % 6 < 3 { -x } else { x })
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
