//! Where a mesh meets itself other than at shared edges: vertices on edges, edges through triangles.

use super::Scene;
use crate::{Error, Mesh, mesh::places};
use raykd_shared::{Content, TreeView};
use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

/// Where an edge meets something else.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub struct Contact {
    /// Vertices of the edge, the lower number first.
    pub edge: [u32; 2],
    /// What it meets: a vertex or a triangle.
    pub other: u32,
}

/// Contacts of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ContactCount {
    /// How many there are.
    pub count: u64,
    /// The first of them, by edge.
    pub first: Option<Contact>,
}

/// Where a mesh meets itself; vertices at one place are one vertex. See [`Scene::contacts`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Contacts {
    /// Vertices of triangles that lie on an edge, between its ends.
    pub t_junctions: ContactCount,
    /// Edges that pass through a triangle of which they have no vertex: their ends are on different sides of it, and
    /// what is between meets it, also at an edge of it, but not at a vertex.
    pub intersections: ContactCount,
}

impl ContactCount {
    /// Contacts come in order.
    fn add(&mut self, contact: Contact) {
        self.count += 1;
        self.first = self.first.or(Some(contact));
    }

    /// Of edges, and of others that come behind them.
    fn and(self, behind: Self) -> Self {
        Self { count: self.count + behind.count, first: self.first.or(behind.first) }
    }
}

impl Scene {
    /// Where the mesh of which this scene was built meets itself, decided exactly. Triangles that overlap in one plane
    /// are not told, nor is what triangles without area meet.
    ///
    /// The tree tells which triangles an edge comes near. It is walked on the CPU, in time that grows with the number
    /// of triangles and of those near.
    ///
    /// # Errors
    /// The mesh is another one, or the device failed.
    pub fn contacts(&self, mesh: &Mesh) -> Result<Contacts, Error> {
        let tree = self.tree()?;
        tree.check_mesh(mesh)?;
        let places = places(mesh.positions());
        let near = Near::new(tree.view(), mesh, &places);
        let mut edges: Vec<[u32; 2]> = Vec::with_capacity(3 * mesh.kept().len());
        for &triangle in mesh.kept() {
            let [a, b, c] = near.corners(triangle);
            edges.extend([[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)]));
        }
        edges.par_sort_unstable();
        edges.dedup();
        let both = |a: Contacts, b: Contacts| Contacts {
            t_junctions: a.t_junctions.and(b.t_junctions),
            intersections: a.intersections.and(b.intersections),
        };
        let part = |part: &[[u32; 2]]| {
            let (mut found, mut list) = (Contacts::default(), Vec::new());
            part.iter().for_each(|&edge| near.look(edge, &mut list, &mut found));
            found
        };
        Ok(self.device.install(|| edges.par_chunks(256).map(part).reduce(Contacts::default, both)))
    }
}

/// What is near an edge.
struct Near<'a> {
    tree: TreeView<'a>,
    mesh: &'a Mesh,
    /// For each vertex the lowest number of those at its place.
    places: &'a [u32],
    /// As the tree knows them.
    positions: Vec<[f64; 3]>,
    /// More than what rounding adds to a place on an edge.
    pad: f64,
}

type Point = [f64; 3];

impl<'a> Near<'a> {
    fn new(tree: TreeView<'a>, mesh: &'a Mesh, places: &'a [u32]) -> Self {
        let scaled = mesh.scaled_positions();
        let positions = scaled.as_chunks().0.iter().map(|p: &[f32; 3]| p.map(f64::from)).collect();
        let ends = tree.header.lo.iter().chain(&tree.header.hi);
        let pad = 1e-12 * ends.fold(0.0, |most: f64, &x| most.max(f64::from(x).abs()));
        Self { tree, mesh, places, positions, pad }
    }

    /// Vertices of a triangle, by the lowest number at their place.
    fn corners(&self, triangle: u32) -> [u32; 3] {
        self.mesh.triangles()[triangle as usize].map(|vertex| self.places[vertex as usize])
    }

    fn at(&self, vertex: u32) -> Point {
        self.positions[vertex as usize]
    }

    /// Adds what an edge meets. `list` is room that is used again.
    fn look(&self, edge: [u32; 2], list: &mut Vec<u32>, found: &mut Contacts) {
        let [p, q] = edge.map(|vertex| self.at(vertex));
        list.clear();
        self.walk(0, [p, q], (0.0, 1.0), list);
        list.sort_unstable();
        list.dedup();
        list.retain(|&triangle| {
            let corners = self.corners(triangle);
            let apart = corners.iter().all(|corner| !edge.contains(corner));
            if apart && passes([p, q], corners.map(|vertex| self.at(vertex))) {
                found.intersections.add(Contact { edge, other: triangle });
            }
            corners.iter().any(|&corner| !edge.contains(&corner) && is_between([p, q], self.at(corner)))
        });
        // Several triangles have that vertex.
        let on = |&corner: &u32| !edge.contains(&corner) && is_between([p, q], self.at(corner));
        let mut vertices: Vec<u32> = list.iter().flat_map(|&t| self.corners(t)).filter(on).collect();
        vertices.sort_unstable();
        vertices.dedup();
        vertices.iter().for_each(|&other| found.t_junctions.add(Contact { edge, other }));
    }

    /// Lists the triangles of all leaves whose closed cells the edge meets from `t0` to `t1`, and maybe others. Every
    /// point of a triangle is in the closed cell of a leaf that lists it, so whatever meets the edge is listed.
    fn walk(&self, node: u32, edge: [Point; 2], (t0, t1): (f64, f64), list: &mut Vec<u32>) {
        match self.tree.nodes[node as usize].content() {
            Content::Leaf { first, count } => {
                list.extend_from_slice(&self.tree.refs[first as usize..][..count as usize]);
            }
            Content::Inner { axis, split, below } => {
                let (pad, split) = (self.pad, f64::from(split));
                let [p, q] = edge.map(|end| end[axis as usize]);
                let way = q - p;
                let (a, b) = (p + t0 * way, p + t1 * way);
                // Where the edge meets the plane, made wider; everywhere if it hardly leaves it.
                let (first, last) = if way.abs() > 4.0 * pad {
                    let (t, wide) = ((split - p) / way, 2.0 * pad / way.abs());
                    (t0.max(t - wide), t1.min(t + wide))
                } else {
                    (t0, t1)
                };
                let (before, after) = ((t0, last), (first, t1));
                let (low, high) = if way > 0.0 { (before, after) } else { (after, before) };
                if a.min(b) <= split + pad {
                    self.walk(below, edge, low, list);
                }
                if a.max(b) >= split - pad {
                    self.walk(below + 1, edge, high, list);
                }
            }
        }
    }
}

/// Whether a point lies on an edge, between its ends.
fn is_between([p, q]: [Point; 2], v: Point) -> bool {
    let within = |axis: usize| p[axis].min(q[axis]) <= v[axis] && v[axis] <= p[axis].max(q[axis]);
    let level = |i: usize, j: usize| {
        let [p, q, v] = [p, q, v].map(|point| Coord { x: point[i], y: point[j] });
        orient2d(p, q, v) == 0.0
    };
    (0..3).all(within) && v != p && v != q && level(0, 1) && level(1, 2) && level(2, 0)
}

/// Whether the ends of an edge are on different sides of a triangle, and the edge meets it, but not at a vertex.
fn passes([p, q]: [Point; 2], [a, b, c]: [Point; 3]) -> bool {
    let apart = |axis: usize| {
        let (lo, hi) = (p[axis].min(q[axis]), p[axis].max(q[axis]));
        [a, b, c].iter().all(|corner| corner[axis] < lo) || [a, b, c].iter().all(|corner| corner[axis] > hi)
    };
    if (0..3).any(apart) {
        return false;
    }
    let side = |points: [Point; 4]| {
        let [a, b, c, d] = points.map(|[x, y, z]| Coord3D { x, y, z });
        let volume = orient3d(a, b, c, d);
        i32::from(volume > 0.0) - i32::from(volume < 0.0)
    };
    if side([a, b, c, p]) * side([a, b, c, q]) >= 0 {
        return false;
    }
    let turns = [[a, b], [b, c], [c, a]].map(|[from, to]| side([p, q, from, to]));
    let on_edges = turns.iter().filter(|&&turn| turn == 0).count();
    on_edges < 2 && !(turns.contains(&1) && turns.contains(&-1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BuildOptions, Device, TreeError};

    type Corner = [f32; 3];

    fn contacts(mesh: &Mesh) -> Contacts {
        let scene = Scene::build(&Device::cpu(), mesh, &BuildOptions::default()).unwrap();
        scene.contacts(mesh).unwrap()
    }

    /// By all edges and all triangles.
    fn slowly(mesh: &Mesh) -> Contacts {
        let places = places(mesh.positions());
        let at = |vertex: u32| mesh.positions()[vertex as usize].map(f64::from);
        let kept: Vec<_> =
            mesh.kept().iter().map(|&t| mesh.triangles()[t as usize].map(|v| places[v as usize])).collect();
        let mut edges: Vec<_> = kept
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[p, q]| [p.min(q), p.max(q)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut vertices: Vec<_> = kept.concat();
        vertices.sort_unstable();
        vertices.dedup();
        let mut found = Contacts::default();
        for edge in edges {
            let ends = edge.map(at);
            for &other in vertices.iter().filter(|&&v| is_between(ends, at(v))) {
                found.t_junctions.add(Contact { edge, other });
            }
            for (&other, corners) in mesh.kept().iter().zip(&kept) {
                let apart = corners.iter().all(|v| !edge.contains(v));
                if apart && passes(ends, corners.map(at)) {
                    found.intersections.add(Contact { edge, other });
                }
            }
        }
        found
    }

    /// Triangles with small whole numbers, which touch and cross in every way, and with any.
    fn soup(seed: u64, whole: bool) -> Mesh {
        let mut random = crate::rays::Random::new(seed);
        let mut corner = || {
            if whole {
                [(); 3].map(|()| random.below(5) as f32 - 1.0)
            } else {
                random.point().map(|x| 3.0 * x)
            }
        };
        let triangles: Vec<[Corner; 3]> = (0..120).map(|_| [corner(), corner(), corner()]).collect();
        let numbers = (0..120).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Mesh::new(triangles.concat(), numbers).unwrap()
    }

    #[test]
    fn the_tree_misses_no_contact() {
        for seed in 0..40 {
            for whole in [true, false] {
                let mesh = soup(seed, whole);
                let found = contacts(&mesh);
                assert_eq!(found, slowly(&mesh), "{seed} {whole}");
                assert!(
                    found.intersections.count > 10 && (found.t_junctions.count > 10) == whole,
                    "{found:?}"
                );
            }
        }
    }

    #[test]
    fn what_passes_and_what_lies_between() {
        let triangle = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let through = |x: f64, y: f64, from: f64, to: f64| passes([[x, y, from], [x, y, to]], triangle);
        // Inside, and through two edges, from either side.
        for (x, y) in [(1.0, 1.0), (2.0, 2.0), (0.0, 1.0)] {
            assert!(through(x, y, -1.0, 1.0) && through(x, y, 1.0, -2.0), "{x} {y}");
            assert!(!through(x, y, 0.0, 1.0) && !through(x, y, 1.0, 3.0), "{x} {y}");
        }
        // At a vertex, and beside it by as little as can be.
        for (x, y) in [(0.0, 0.0), (4.0, 0.0), (2.0f64.next_up(), 2.0), (-f64::MIN_POSITIVE, 1.0)] {
            assert!(!through(x, y, -1.0, 1.0), "{x} {y}");
        }
        assert!(!passes([[-1.0, 1.0, 0.0], [5.0, 1.0, 0.0]], triangle), "in its plane");
        let ends = [[0.0, 3.0, -1.0], [6.0, 0.0, 2.0]];
        assert!(is_between(ends, [2.0, 2.0, 0.0]) && is_between(ends, [4.0, 1.0, 1.0]));
        assert!(!is_between(ends, [8.0, -1.0, 3.0]) && !ends.iter().any(|&end| is_between(ends, end)));
        for axis in 0..3 {
            let mut beside = [4.0, 1.0, 1.0f64];
            beside[axis] = beside[axis].next_down();
            assert!(!is_between(ends, beside), "{axis}");
        }
    }

    #[test]
    fn contacts_known_by_hand() {
        let corners = vec![
            [0.0, 0.0, 0.0],
            [3.0, 0.0, 0.0],
            [0.0, 3.0, 0.0],
            // On the edge from 0 to 1; below it; on its other side, and the first vertex again.
            [1.0, 0.0, 0.0],
            [1.0, -1.0, 0.0],
            [3.0, -1.0, 0.0],
            [3.0, 0.0, 0.0],
            // Through the first triangle, by one edge.
            [1.0, 1.0, -1.0],
            [1.0, 1.0, 1.0],
            [9.0, 9.0, 1.0],
        ];
        let triangles = vec![[0, 1, 2], [3, 4, 5], [3, 5, 6], [7, 8, 9]];
        let found = contacts(&Mesh::new(corners.clone(), triangles.clone()).unwrap());
        let one = |edge, other| ContactCount { count: 1, first: Some(Contact { edge, other }) };
        assert_eq!(found.t_junctions, one([0, 1], 3));
        // The edge from 7 to 8, and that from 1 to 2 through its triangle.
        let first = Some(Contact { edge: [1, 2], other: 3 });
        assert_eq!(found.intersections, ContactCount { count: 2, first });
        // As far below as a float can be, it is on no edge.
        let mut beside = corners;
        beside[3][1] = -f32::EPSILON;
        let found = contacts(&Mesh::new(beside, triangles).unwrap());
        assert_eq!(found.t_junctions, ContactCount::default());
    }

    #[test]
    fn another_mesh_is_refused_and_none_has_no_contacts() {
        let [one, other] = [soup(1, true), soup(2, true)];
        let scene = Scene::build(&Device::cpu(), &one, &BuildOptions::default()).unwrap();
        assert!(matches!(scene.contacts(&other), Err(Error::Tree { why: TreeError::OtherMesh { .. }, .. })));
        let flat = Mesh::new(vec![[0.0; 3], [1.0; 3], [2.0; 3]], vec![[0, 1, 2]]).unwrap();
        assert_eq!(contacts(&flat), Contacts::default());
    }
}
