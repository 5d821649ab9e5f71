//! Meshes in `f64`: what rounding to `f32` changes, and meshes that are moved so that it changes less.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Device, Hit, Mesh, Query, Ray, Ray64, Scene, Traversal, mesh::Repairs, shared::MISS,
};
use std::path::Path;

fn read(name: &str, text: &str) -> Mesh {
    crate::read(name, text).unwrap()
}

/// Two triangles for each side.
const SIDES: [[u32; 3]; 12] = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 6, 7],
    [4, 7, 5],
    [0, 4, 5],
    [0, 5, 1],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
    [1, 5, 7],
    [1, 7, 3],
];

fn cube(from: [f64; 3], size: f64) -> Vec<[f64; 3]> {
    (0..8).map(|i| [0, 1, 2].map(|a| from[a] + if i >> a & 1 == 1 { size } else { 0.0 })).collect()
}

/// A cube of 1 cm, in metres, where a national grid has it. Its corners are no `f32`.
const FAR: [f64; 3] = [4.5e6 + 0.003, -5.7e6, 112.125];
const SIZE: f64 = 0.01;

fn far_cube() -> Mesh {
    Mesh::from_f64(cube(FAR, SIZE), SIDES.to_vec()).unwrap()
}

fn add(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|a| p[a] + q[a])
}

/// Rays at the cube from all around, given from its lowest corner in cube sizes.
fn rays() -> Vec<([f64; 3], [f64; 3])> {
    let mut random = raykd::rays::Random::new(7);
    (0..200)
        .map(|_| {
            let to = [(); 3].map(|()| random.unit());
            let from = [(); 3].map(|()| f64::from(random.signed()) * 3.0);
            (from, [0, 1, 2].map(|a| to[a] - from[a]))
        })
        .collect()
}

fn scene(device: &Device, mesh: &Mesh) -> Scene {
    Scene::build(device, mesh, &BuildOptions::default()).unwrap()
}

/// Where a hit is, in the mesh's own coordinates.
fn point(mesh: &Mesh, hit: &Hit) -> [f64; 3] {
    let [a, b, c] = mesh.triangles()[hit.triangle as usize].map(|v| mesh.vertex(v));
    let (u, v) = (f64::from(hit.u), f64::from(hit.v));
    [0, 1, 2].map(|i| (1.0 - u - v) * a[i] + u * b[i] + v * c[i])
}

#[test]
fn a_small_cube_far_off_is_all_there() {
    let mesh = far_cube();
    assert_eq!(mesh.kept().len(), 12);
    let by = mesh.translation();
    assert!((by[0] - FAR[0]).abs() < SIZE && (by[1] - FAR[1]).abs() < SIZE && (by[2] - FAR[2]).abs() < SIZE);
    // Half a unit of f32 below 2^-7.
    assert!(
        mesh.repairs().rounded > 0 && mesh.repairs().largest_change <= 2f64.powi(-32),
        "{:?}",
        mesh.repairs()
    );
    assert_eq!((mesh.repairs().zero_area, mesh.repairs().collapsed), (0, 0));
    for (number, given) in cube(FAR, SIZE).into_iter().enumerate() {
        let found = mesh.vertex(number as u32);
        assert!(
            (0..3).all(|a| (found[a] - given[a]).abs() <= mesh.repairs().largest_change),
            "{found:?} {given:?}"
        );
    }
    let (lo, hi) = mesh.bounds();
    for a in 0..3 {
        assert!(f64::from(lo[a]) <= FAR[a] && FAR[a] + SIZE <= f64::from(hi[a]), "{lo:?} {hi:?}");
    }
    // Half a unit of f32 is a quarter here, so no ray in f32 would do.
    let device = Device::cpu();
    let scene = scene(&device, &mesh);
    let rays: Vec<_> =
        rays().iter().map(|(from, to)| Ray64::new(add(FAR, from.map(|x| x * SIZE)), *to)).collect();
    for (ray, hit) in rays.iter().zip(scene.closest(&rays).unwrap()) {
        assert!(hit.is_hit(), "{ray:?}");
        let (found, along) = (point(&mesh, &hit), ray.direction.map(|x| x * f64::from(hit.t)));
        let wanted = add(ray.origin, along);
        assert!((0..3).all(|a| (found[a] - wanted[a]).abs() < 1e-7), "{found:?} {wanted:?}");
    }
}

/// Wherever rays are handed over, they are moved as the mesh was: all ways give the hits of the same mesh at home.
#[test]
fn all_queries_move_their_rays() {
    // Of few digits, so that nothing is rounded anywhere.
    let (far, size) = ([4_500_000.015_625, -5_700_000.0, 16_384.007_812_5], 0.015_625);
    let mesh = Mesh::from_f64(cube(far, size), SIDES.to_vec()).unwrap();
    assert_eq!(mesh.repairs().rounded, 0);
    let by = mesh.translation();
    assert!(by.iter().all(|x| *x != 0.0), "{by:?}");
    let positions =
        cube([0, 1, 2].map(|a| far[a] - by[a]), size).iter().map(|p| p.map(|x| x as f32)).collect();
    let home = Mesh::new(positions, SIDES.to_vec()).unwrap();
    assert_eq!(home.positions(), mesh.positions());
    let coarse = |x: f64| (x * 1024.0).round() / 1024.0;
    let wide: Vec<Ray64> = rays()
        .iter()
        .map(|(from, to)| Ray64 {
            t_max: 4.0,
            ..Ray64::new(add(far, from.map(|x| coarse(x) * size)), to.map(coarse))
        })
        .collect();
    let local: Vec<Ray> = wide
        .iter()
        .map(|ray| {
            let origin = [0, 1, 2].map(|a| (ray.origin[a] - by[a]) as f32);
            Ray { t_max: 4.0, ..Ray::new(origin, ray.direction.map(|x| x as f32)) }
        })
        .collect();
    // In f32, from places that it can hold, to the middle of the cube.
    let narrow: Vec<Ray> = (0..50)
        .map(|i| {
            let origin = [far[0] as f32 + 0.5 * i as f32, far[1] as f32 + 1.0, 16384.0 + 0.25 * i as f32];
            let middle = far.map(|x| x + size / 2.0);
            Ray::new(origin, [0, 1, 2].map(|a| (middle[a] - f64::from(origin[a])) as f32))
        })
        .collect();
    let narrow_local: Vec<Ray> = narrow
        .iter()
        .map(|ray| Ray { origin: [0, 1, 2].map(|a| (f64::from(ray.origin[a]) - by[a]) as f32), ..*ray })
        .collect();

    let device = Device::cpu();
    let (mut there, mut here) = (scene(&device, &mesh), scene(&device, &home));
    assert_eq!(there.tree().unwrap().digest(), here.tree().unwrap().digest());
    let wanted = here.closest(&local).unwrap();
    assert!(wanted.iter().all(Hit::is_hit));
    assert_eq!(there.closest(&wide).unwrap(), wanted);
    assert_eq!(there.any(&wide).unwrap(), here.any(&local).unwrap());
    assert_eq!(there.trace(Query::Closest, &wide).unwrap().hits, wanted);
    assert_eq!(there.brute(&wide).unwrap(), wanted);
    let [there_steps, here_steps] = [there.steps(&wide).unwrap(), here.steps(&local).unwrap()];
    assert_eq!((there_steps.hits, there_steps.steps), (here_steps.hits, here_steps.steps));
    let but: Vec<u32> = wanted.iter().map(|hit| hit.triangle).collect();
    let except = [
        there.trace_except(Query::Closest, &wide, &but).unwrap().hits,
        here.trace_except(Query::Closest, &local, &but).unwrap().hits,
    ];
    assert_eq!(except[0], except[1]);
    let (all, home_all) = (there.all(&wide, 4).unwrap(), here.all(&local, 4).unwrap());
    assert_eq!((all.hits, all.totals), (home_all.hits, home_all.totals));
    let mut resident = there.resident(&wide).unwrap();
    resident.trace(Query::Closest).unwrap();
    assert_eq!(resident.hits().unwrap(), wanted);
    assert_eq!(there.closest(&narrow).unwrap(), here.closest(&narrow_local).unwrap());
    assert!(there.closest(&narrow).unwrap().iter().all(Hit::is_hit));
    for &traversal in Traversal::ALL {
        there.traverse_by(traversal).unwrap();
        here.traverse_by(traversal).unwrap();
        assert_eq!(there.closest(&wide).unwrap(), wanted, "{traversal}");
        assert_eq!(there.closest(&wide).unwrap(), here.closest(&local).unwrap(), "{traversal}");
    }
    // A mesh that has forgotten where it was.
    let forgot = mesh.clone().into_local();
    assert_eq!(forgot.translation(), [0.0; 3]);
    assert_eq!(scene(&device, &forgot).closest(&local).unwrap(), wanted);
    // A tree from a file knows nothing of the move, the mesh does.
    let tree = there.tree().unwrap();
    let again = Mesh::from_f64(cube(far, size), SIDES.to_vec()).unwrap();
    assert_eq!(Scene::with_tree(&device, &again, &tree).unwrap().closest(&wide).unwrap(), wanted);
}

#[test]
fn meshes_of_f32_stay_where_they_are() {
    // Far off, but every coordinate is an f32: nothing to save.
    let positions = cube([4_500_000.0, -5_700_000.0, 112.0], 0.5);
    let wide = Mesh::from_f64(positions.clone(), SIDES.to_vec()).unwrap();
    let narrow = Mesh::new(positions.iter().map(|p| p.map(|x| x as f32)).collect(), SIDES.to_vec()).unwrap();
    assert_eq!((wide.translation(), narrow.translation()), ([0.0; 3], [0.0; 3]));
    assert_eq!((wide.positions(), wide.bounds()), (narrow.positions(), narrow.bounds()));
    assert_eq!((wide.repairs(), wide.repairs().clone()), (narrow.repairs(), Repairs::default()));
    // Near enough: up to eight sizes away it is not worth it.
    for (away, moved) in [(0.0, false), (6.9, false), (7.1, true)] {
        let mesh = Mesh::from_f64(cube([0.1 * away, 0.0, 0.0], 0.1), SIDES.to_vec()).unwrap();
        assert_eq!(mesh.translation()[0] != 0.0, moved, "{away}");
        assert_eq!(mesh.translation()[1..], [0.0; 2]);
    }
    // A triangle without area has no part in where the box is, nor has a vertex that nobody uses.
    let mut positions = cube(FAR, SIZE);
    positions.extend([[0.0; 3], [1e30, -1e38, 7.0]]);
    let mesh = Mesh::from_f64(positions, [&SIDES[..], &[[8, 8, 0]]].concat()).unwrap();
    assert_eq!((mesh.translation(), mesh.kept().len()), (far_cube().translation(), 12));
}

#[test]
fn what_rounding_changed_is_told() {
    let tenth = f64::from(0.1f32) - 0.1;
    let mesh =
        Mesh::from_f64(vec![[0.0, 0.0, 0.1], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]], vec![[0, 1, 2]]).unwrap();
    let mut repairs = Repairs::default();
    (repairs.rounded, repairs.largest_change) = (1, tenth);
    assert_eq!(*mesh.repairs(), repairs);
    // Beside a large triangle a small one that f32 cannot hold, one that has no area in f64 either, and one that may.
    let positions = vec![
        [0.0, 0.0, 0.0],
        [1000.0, 0.0, 0.0],
        [0.0, 1000.0, 0.0],
        [500.0, 500.0, 1.0],
        [500.0 + 1e-9, 500.0, 1.0],
        [500.0, 500.0 + 1e-9, 1.0],
        [500.125, 500.0, 1.0],
    ];
    let mesh = Mesh::from_f64(positions, vec![[0, 1, 2], [3, 4, 5], [3, 3, 4], [3, 6, 5]]).unwrap();
    assert_eq!(mesh.kept(), [0]);
    let Repairs { zero_area, collapsed, rounded, largest_change, .. } = *mesh.repairs();
    assert_eq!((zero_area, collapsed, rounded), (3, 2, 2));
    assert!((largest_change - 1e-9).abs() < 1e-12, "{largest_change}");
    // Of Mesh::new nothing is rounded.
    let mesh = Mesh::new(vec![[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], vec![[0, 1, 2]]).unwrap();
    assert_eq!(*mesh.repairs(), Repairs::default());
}

#[test]
fn numbers_that_are_none_are_refused() {
    for (x, told) in [(f64::NAN, "NaN"), (f64::NEG_INFINITY, "-inf"), (3.5e38, "3.5e38")] {
        let error =
            Mesh::from_f64(vec![[0.0; 3], [0.0, x, 0.0], [1.0; 3]], vec![[0, 1, 2]]).unwrap_err().to_string();
        assert!(
            error.starts_with(&format!("mesh, vertex 1: coordinate '{told}' is not a finite")),
            "{error}"
        );
    }
    let error = Mesh::from_f64(vec![[0.0; 3]; 3], vec![[0, 1, 3]]).unwrap_err().to_string();
    assert!(error.starts_with("mesh, triangle 0: vertex index 3 is out of range"), "{error}");
    let device = Device::cpu();
    let scene = scene(&device, &far_cube());
    for (origin, direction) in [
        ([f64::NAN, 0.0, 0.0], [1.0; 3]),
        (FAR, [0.0; 3]),
        (FAR, [1e300; 3]),
        ([1e300, 0.0, 0.0], [1.0; 3]),
        (FAR, [1e-300; 3]),
    ] {
        let traced = scene.trace(Query::Closest, &[Ray64::new(origin, direction)]).unwrap();
        assert_eq!((traced.hits[0].triangle, traced.invalid), (MISS, 1), "{origin:?} {direction:?}");
    }
}

/// The far cube as a file, and as text with a number for its first coordinate.
#[test]
fn files_keep_their_digits() {
    let points = cube(FAR, SIZE);
    let far = far_cube();
    let same = |mesh: &Mesh| {
        assert_eq!(mesh.translation(), far.translation());
        let corners =
            |mesh: &Mesh| mesh.triangles().iter().map(|t| t.map(|v| mesh.vertex(v))).collect::<Vec<_>>();
        assert_eq!(corners(mesh), corners(&far));
        assert_eq!(mesh.kept().len(), 12);
    };
    let lines = |before: &str| {
        points.iter().map(|p| format!("{before}{} {} {}\n", p[0], p[1], p[2])).collect::<String>()
    };
    let faces = |before: &str, first: u32| {
        SIDES.map(|t| format!("{before} {} {} {}\n", t[0] + first, t[1] + first, t[2] + first)).concat()
    };
    same(&read("a.obj", &format!("{}{}", lines("v "), faces("f", 1))));
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 8\nproperty double x\nproperty double y\nproperty double z\n\
             element face 12\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    same(&read("a.ply", &format!("{}{}{}", head("ascii"), lines(""), faces("3", 0))));
    for big in [false, true] {
        let bytes = |x: f64| if big { x.to_be_bytes() } else { x.to_le_bytes() };
        let index = |i: u32| if big { i.to_be_bytes() } else { i.to_le_bytes() };
        let mut file = head(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
        file.extend(points.as_flattened().iter().flat_map(|&x| bytes(x)));
        for side in SIDES {
            file.push(3);
            file.extend(side.iter().flat_map(|&i| index(i)));
        }
        same(&Mesh::from_bytes(Path::new("a.ply"), file).unwrap());
    }
    let mut stl = "solid\n".to_owned();
    for side in SIDES {
        stl += "facet normal 0 0 0\nouter loop\n";
        side.iter().for_each(|&v| {
            stl += &lines("vertex ").lines().nth(v as usize).map(|l| format!("{l}\n")).unwrap()
        });
        stl += "endloop\nendfacet\n";
    }
    same(&read("a.stl", &format!("{stl}endsolid\n")));
}

/// Decimals next to the middle between two `f32`, where rounding to `f64` first would round the wrong way.
#[test]
fn text_is_rounded_once() {
    for text in [
        "1.00000017881393432617187499999999999",
        "1.00000017881393432617187500000000001",
        "1.000000178813934326171875",
        "-1.00000005960464477539062500000000001",
        "-1.00000005960464477539062499999999999",
        "1.1e-42",
        "0.1",
        "16777217",
        "2.10194769649872e-45",
        "2.1019476964872256e-45",
    ] {
        let wanted: f32 = text.parse().unwrap();
        let obj = read("a.obj", &format!("v {text} 0 0\nv 4 0 0\nv 0 4 0\nf 1 2 3\n"));
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n{text} 0 0\n4 0 0\n0 4 0\n3 0 1 2\n"
        );
        let stl = format!(
            "solid\nfacet\nouter loop\nvertex {text} 0 0\nvertex 4 0 0\nvertex 0 4 0\nendloop\nendfacet\nendsolid\n"
        );
        for mesh in [obj, read("a.ply", &ply), read("a.stl", &stl)] {
            assert_eq!(mesh.positions()[0][0].to_bits(), wanted.to_bits(), "{text}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// A soup far off is hit where the same soup at home is: of the triangle that the ray goes to, near the point.
    #[test]
    fn soups_far_off_are_hit(
        far in prop::array::uniform3(prop::sample::select(vec![0.0, 1e3, -4.5e6, 1.7e9])),
        soup in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1.0f64..1.0)), 1..30),
        weights in prop::array::uniform2(0.1f64..0.4),
        from in prop::array::uniform3(-3.0f64..3.0),
    ) {
        let positions: Vec<[f64; 3]> = soup.as_flattened().iter().map(|p| add(*p, far)).collect();
        let count = soup.len() as u32;
        let mesh = Mesh::from_f64(positions, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()).unwrap();
        let device = Device::cpu();
        let scene = scene(&device, &mesh);
        let rays: Vec<Ray64> = (0..count).map(|t| {
            let at = point(&mesh, &Hit { triangle: t, t: 0.0, u: weights[0] as f32, v: weights[1] as f32 });
            let origin = add(from, far);
            Ray64::new(origin, [0, 1, 2].map(|a| at[a] - origin[a]))
        }).collect();
        let all = scene.all(&rays, count).unwrap();
        for (t, ray) in rays.iter().enumerate() {
            let hits = all.of(t);
            // Not where a triangle is nearly in line with the ray, and thin.
            let [a, b, c] = soup[t];
            let (e, f) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
            let normal = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
            let slope: f64 = (0..3).map(|i| normal[i] * ray.direction[i]).sum();
            if slope.abs() > 1e-3 {
                let own = hits.iter().find(|hit| hit.triangle == t as u32);
                prop_assert!(own.is_some_and(|hit| (hit.t - 1.0).abs() < 1e-2), "{own:?} of {hits:?}");
            }
        }
    }
}
