//! Faces of more than three corners: the triangles they become.

use proptest::prelude::*;
use raykd::{
    Device, Ray, Scene,
    mesh::{Mesh, Spot},
};
use std::{f64::consts::TAU, fmt::Write, path::Path};

/// A mesh of one face.
fn face(points: &[[f32; 3]]) -> Mesh {
    let mut text = String::new();
    for [x, y, z] in points {
        writeln!(text, "v {x} {y} {z}").unwrap();
    }
    text += "f";
    for i in 1..=points.len() {
        write!(text, " {i}").unwrap();
    }
    Mesh::from_bytes(Path::new("face.obj"), text.into_bytes()).unwrap()
}

fn flat(points: &[[f32; 2]]) -> Vec<[f32; 3]> {
    points.iter().map(|&[x, y]| [x, y, 0.0]).collect()
}

/// The fan from the first corner.
fn fan(corners: u32) -> Vec<[u32; 3]> {
    (2..corners).map(|i| [0, i - 1, i]).collect()
}

/// Triangles by corners of the face: vertices are numbered as the face first names them.
fn is_fan(mesh: &Mesh) -> bool {
    mesh.triangles() == fan(mesh.triangles().len() as u32 + 2)
}

/// Twice the signed area in the plane of x and y, exact for small whole numbers.
fn area([a, b, c]: [[f32; 3]; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|p| p.map(f64::from));
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a point is inside a polygon, by crossings of a ray to the right; the point lies on no edge's height.
fn is_inside(points: &[[f32; 2]], [x, y]: [f64; 2]) -> bool {
    (0..points.len())
        .filter(|&i| {
            let [[ax, ay], [bx, by]] = [points[i], points[(i + 1) % points.len()]].map(|p| p.map(f64::from));
            (ay > y) != (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax)
        })
        .count()
        % 2
        == 1
}

/// Rays from above hit the face where, and only where, it is; turned in space too.
fn hits_where_it_is(points: &[[f32; 2]]) -> Mesh {
    let turned = |[x, y]: [f32; 2]| [[x, y, 0.0], [0.5, x, y], [y, -0.25, x]];
    let device = Device::cpu_with_threads(1).unwrap();
    let mut first = None;
    for way in 0..3 {
        let mesh = face(&points.iter().map(|&p| turned(p)[way]).collect::<Vec<_>>());
        assert_eq!(mesh.triangles().len(), points.len() - 2);
        let scene = Scene::build(&device, &mesh, &Default::default()).unwrap();
        let (lo, hi) = points.iter().fold(([f32::MAX; 2], [f32::MIN; 2]), |(lo, hi), p| {
            ([lo[0].min(p[0]), lo[1].min(p[1])], [hi[0].max(p[0]), hi[1].max(p[1])])
        });
        let at = |i: usize, axis: usize| {
            lo[axis] + (hi[axis] - lo[axis]) * ((i as f32 + [0.377, 0.613][axis]) / 47.0)
        };
        let places: Vec<[f32; 2]> = (0..47 * 47).map(|i| [at(i % 47, 0), at(i / 47, 1)]).collect();
        let direction = [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]][way];
        let rays: Vec<Ray> = places
            .iter()
            .map(|&p| {
                let origin = turned(p)[way];
                Ray::new([0, 1, 2].map(|a| origin[a] - 2.0 * direction[a]), direction)
            })
            .collect();
        for (hit, place) in scene.closest(&rays).unwrap().iter().zip(&places) {
            assert_eq!(hit.is_hit(), is_inside(points, place.map(f64::from)), "{points:?} {place:?}");
        }
        first.get_or_insert(mesh);
    }
    first.unwrap()
}

#[test]
fn convex_faces_are_fans() {
    for n in [4, 5, 9, 1000] {
        let points: Vec<[f64; 2]> =
            (0..n).map(|i| f64::from(i) / f64::from(n) * TAU).map(|a| [a.cos(), a.sin()]).collect();
        for turned in 0..6 {
            let way = |&[x, y]: &[f64; 2]| {
                let p =
                    [[x, y, 0.1 * x - 0.3 * y + 7.0], [x, 0.25 * x + 3.0, y], [0.5 - y, x, y]][turned % 3];
                p.map(|x| x as f32)
            };
            let mut points: Vec<[f32; 3]> = points.iter().map(way).collect();
            if turned > 2 {
                points.reverse();
            }
            let mesh = face(&points);
            assert!(is_fan(&mesh), "{n} {turned}");
            assert_eq!((mesh.repairs().concave, mesh.repairs().crossed, mesh.repairs().bent), (0, 0, 0));
            assert_eq!(mesh.repairs().polygons, 1);
        }
    }
    // Corners on straight edges, twice the same corner, no area at all.
    for points in [
        &[[0, 0], [1, 0], [2, 0], [2, 2], [1, 2], [0, 2], [0, 1]][..],
        &[[1, 0], [2, 0], [2, 2], [1, 2], [0, 2], [0, 1], [0, 0]],
        &[[0, 0], [1, 0], [1, 0], [1, 1]],
        &[[0, 0], [0, 0], [1, 0], [1, 1]],
        &[[0, 0], [1, 0], [1, 1], [0, 0]],
        &[[0, 0], [1, 0], [2, 0], [1, 0]],
        &[[0, 0], [0, 0], [0, 0], [0, 0]],
    ] {
        let points: Vec<[f32; 2]> = points.iter().map(|p| p.map(|x| x as f32)).collect();
        let mesh = face(&flat(&points));
        assert!(is_fan(&mesh), "{points:?} {:?}", mesh.triangles());
        assert_eq!((mesh.repairs().concave, mesh.repairs().crossed), (0, 0), "{points:?}");
    }
}

#[test]
fn a_ray_beside_a_concave_face_misses() {
    // An arrow from each of its corners: the fan of two of them covers it.
    let arrow = [[0.0, 0.0], [4.0, -3.0], [1.0, 0.0], [4.0, 3.0f32]];
    for first in 0..4 {
        for turned in [false, true] {
            let mut points = arrow;
            points.rotate_left(first);
            if turned {
                points.reverse();
            }
            let mesh = hits_where_it_is(&points);
            assert_eq!(mesh.repairs().concave, u32::from(!is_fan(&mesh)));
            // As the face goes round, so do its triangles.
            let way = |t: &[u32; 3]| area(t.map(|v| mesh.positions()[v as usize])) > 0.0;
            assert!(mesh.triangles().iter().all(|t| way(t) != turned), "{points:?} {:?}", mesh.triangles());
        }
    }
    let concave = |points: &[[f32; 2]]| {
        let mesh = hits_where_it_is(points);
        assert_eq!(
            (mesh.repairs().concave, mesh.repairs().crossed, mesh.repairs().bent),
            (1, 0, 0),
            "{points:?}"
        );
        mesh
    };
    // A comb, a star, a spiral, a hole with a bridge to it, two parts that touch at a corner.
    let comb: Vec<[f32; 2]> = (0..40)
        .map(|i| [i as f32, if i % 2 == 0 { 10.0 } else { 1.0 }])
        .chain([[39.0, 0.0], [0.0, 0.0]])
        .collect();
    concave(&comb);
    let star: Vec<[f32; 2]> = (0..24)
        .map(|i| (f64::from(i) / 24.0 * TAU, if i % 2 == 0 { 3.0 } else { 1.0 }))
        .map(|(a, r)| [(r * a.cos()) as f32, (r * a.sin()) as f32])
        .collect();
    concave(&star);
    let arm = |i: i32, out: f64| {
        let a = f64::from(i) / 10.0 * TAU;
        [((0.1 * f64::from(i) + out) * a.cos()) as f32, ((0.1 * f64::from(i) + out) * a.sin()) as f32]
    };
    let spiral: Vec<[f32; 2]> =
        (5..35).map(|i| arm(i, 0.0)).chain((5..35).rev().map(|i| arm(i, 0.5))).collect();
    concave(&spiral);
    let ring = [
        [0., 0.],
        [6., 0.],
        [6., 6.],
        [0., 6.],
        [0., 0.],
        [2., 2.],
        [2., 4.],
        [4., 4.],
        [4., 2.],
        [2., 2.0f32],
    ];
    let mesh = concave(&ring);
    assert_eq!(mesh.kept().len(), 8);
    concave(&[[0., 0.], [2., 0.], [1., 1.], [2., 2.], [0., 2.], [1., 1.0f32]]);
    // Corners on a straight edge of a concave face stay corners.
    let mesh = concave(&[[0., 0.], [1., 0.], [2., 0.], [3., 0.], [3., 3.], [2., 1.], [0., 3.0f32]]);
    for v in 0..7 {
        assert!(mesh.kept().iter().any(|&t| mesh.triangles()[t as usize].contains(&v)), "{v}");
    }
}

#[test]
fn crossed_and_bent_faces_are_named() {
    let v = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 4 4 1\nv 2 0 0\n";
    let read =
        |faces: &str| Mesh::from_bytes(Path::new("a.obj"), format!("{v}{faces}").into_bytes()).unwrap();
    let mesh = read("f 1 2 3 4\nf 1 2 5 4\nf 1 3 2 4\nf 1 3 4 2\nf 1 2 5 4\n");
    let found = mesh.repairs();
    assert_eq!((found.polygons, found.concave, found.crossed, found.bent), (5, 0, 2, 2));
    assert_eq!(found.crossed_at, Some(Spot::Line(9)));
    assert_eq!(found.bent_at, Some(Spot::Line(8)));
    // Still the fans.
    assert_eq!(mesh.triangles()[4..6], [[0, 2, 1], [0, 1, 3]]);
    // A corner on another edge, from within: two parts. From outside there are no numbers for all triangles.
    let within = read("f 4 1 2 3 6\n");
    assert_eq!((within.repairs().concave, within.repairs().crossed, within.kept().len()), (1, 0, 2));
    let outside = [[0, 0], [8, 0], [8, 8], [0, 8], [2, 2], [4, 6], [6, 6], [6, 2], [0, 2]];
    let outside = face(&flat(&outside.map(|p| p.map(|x| x as f32))));
    assert_eq!((outside.repairs().concave, outside.repairs().crossed), (0, 1));
    assert!(is_fan(&outside));
    // In a binary file, the face's number.
    let mut ply =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nelement face 2\nproperty list uchar uchar vertex_index\nend_header\n"
            .to_vec();
    for p in [[0f32, 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]] {
        ply.extend(p.iter().flat_map(|x| x.to_le_bytes()));
    }
    ply.extend([4, 0, 1, 2, 3, 4, 0, 2, 1, 3]);
    let mesh = Mesh::from_bytes(Path::new("a.ply"), ply).unwrap();
    assert_eq!(mesh.repairs().crossed_at, Some(Spot::Element("face".to_owned(), 1)));
    assert_eq!(mesh.repairs().crossed_at.as_ref().unwrap().to_string(), "face 1");
}

/// Shapes that take some ways to cut them quadratic time, which would be hours.
#[test]
fn many_corners_take_no_quadratic_time() {
    const N: usize = 200_000;
    let round = |radius: &dyn Fn(usize) -> f64| -> Vec<[f32; 2]> {
        (0..N)
            .map(|i| (i as f64 / N as f64 * TAU, radius(i)))
            .map(|(a, r)| [(r * a.cos()) as f32, (r * a.sin()) as f32])
            .collect()
    };
    let mut random = raykd::rays::Random::new(7);
    let teeth: Vec<f32> = (0..N).map(|i| if i % 2 == 0 { 1.0 } else { 1.0 + random.unit() as f32 }).collect();
    let teeth = |wide: f32| {
        (0..N)
            .map(|i| [i as f32 * wide, teeth[i]])
            .chain([[N as f32 * wide, 0.0], [0.0, 0.0]])
            .collect::<Vec<_>>()
    };
    for (name, points, concave) in [
        ("star", round(&|i| if i % 2 == 0 { 1.0 } else { 0.5 }), true),
        ("teeth", teeth(1.0 / N as f32), true),
        ("thin teeth", teeth(1.0e-9), true),
        // As rounded, it is not quite convex.
        ("circle", round(&|_| 1.0), true),
        ("fan", std::iter::once([0.0; 2]).chain((0..N).map(|i| [1.0, i as f32])).collect(), false),
    ] {
        let start = std::time::Instant::now();
        let mesh = face(&flat(&points));
        let taken = start.elapsed();
        println!("{name}: {taken:?}");
        assert_eq!(mesh.triangles().len(), points.len() - 2);
        assert_eq!((mesh.repairs().concave, mesh.repairs().crossed), (u32::from(concave), 0), "{name}");
        assert_eq!(is_fan(&mesh), !concave, "{name}");
        assert!(taken.as_secs() < 120, "{name} took {taken:?}");
    }
}

/// A polygon with whole numbers for corners that does not cross itself: a star around a point between them.
fn simple() -> impl Strategy<Value = Vec<[f32; 2]>> {
    prop::collection::vec((-8i32..8, -8i32..8), 4..14).prop_filter_map("around a point", |corners| {
        let from = |&(x, y): &(i32, i32)| (f64::from(y) - 0.31).atan2(f64::from(x) - 0.47);
        let mut corners = corners;
        corners.sort_by(|a, b| from(a).total_cmp(&from(b)));
        corners.dedup();
        let gap = |i: usize| (from(&corners[(i + 1) % corners.len()]) - from(&corners[i])).rem_euclid(TAU);
        let fine =
            corners.len() > 3 && (0..corners.len()).all(|i| gap(i) > 1e-9 && gap(i) < TAU / 2.0 - 1e-9);
        fine.then(|| corners.iter().map(|&(x, y)| [x as f32, y as f32]).collect())
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// All areas have the face's sign, and their sum is the face's: so they lie side by side and are the face.
    #[test]
    fn triangles_are_the_face(points in simple(), start in any::<prop::sample::Index>(), back in any::<bool>()) {
        let mut points = points;
        let first = start.index(points.len());
        points.rotate_left(first);
        if back {
            points.reverse();
        }
        let mesh = face(&flat(&points));
        prop_assert_eq!(mesh.triangles().len(), points.len() - 2);
        prop_assert_eq!((mesh.repairs().crossed, mesh.repairs().bent), (0, 0));
        let sign = if back { -1.0 } else { 1.0 };
        let areas: Vec<f64> =
            mesh.triangles().iter().map(|t| sign * area(t.map(|v| mesh.positions()[v as usize]))).collect();
        prop_assert!(areas.iter().all(|&a| a >= 0.0), "{:?} {:?}", points, mesh.triangles());
        let whole: f64 = (0..points.len())
            .map(|i| (points[i].map(f64::from), points[(i + 1) % points.len()].map(f64::from)))
            .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
            .sum();
        prop_assert_eq!(areas.iter().sum::<f64>(), sign * whole);
    }

    /// Any corners: rays hit inside, by parity, unless the face is crossed; the same every time.
    #[test]
    fn any_corners(points in prop::collection::vec(
        (-4i32..4, -4i32..4).prop_map(|(x, y)| [x as f32, y as f32]), 4..9,
    )) {
        let mesh = face(&flat(&points));
        prop_assert_eq!(mesh.triangles().len(), points.len() - 2);
        if mesh.repairs().crossed == 0 && !is_fan(&mesh) && mesh.kept().len() > 1 {
            hits_where_it_is(&points);
        }
        let again = face(&flat(&points));
        prop_assert_eq!(again.triangles(), mesh.triangles());
    }
}
