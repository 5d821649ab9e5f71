//! Crossings are those of a ray that starts a little off, in rational arithmetic, on every device; and which points are
//! inside hangs on no direction.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Builder, Crossings, Mesh, Ray, Scene,
    mesh::MeshSource,
    rays::{Random, Ray64},
    shared::Content,
    stress::shapes::{Point, Welded, cubes, icosphere, loose},
};
use raykd_oracle::Passage;
use raykd_tests::{Failure, cases, devices, same, unless_cut};
use rayon::prelude::*;

/// Triangles counterclockwise seen from outside, of a shape round the origin.
fn outward(mesh: &Mesh) -> Vec<[Point; 3]> {
    let corners = |t: &[u32; 3]| t.map(|v| mesh.positions()[v as usize]);
    let turned = |[a, b, c]: [Point; 3]| {
        let [x, y, z] = [a, b, c].map(|p| p.map(f64::from));
        let volume = x[0] * (y[1] * z[2] - y[2] * z[1])
            + x[1] * (y[2] * z[0] - y[0] * z[2])
            + x[2] * (y[0] * z[1] - y[1] * z[0]);
        if volume < 0.0 { [a, c, b] } else { [a, b, c] }
    };
    mesh.triangles().iter().map(corners).map(turned).collect()
}

/// Two cones of so many triangles each with a rim between: all of them meet at two vertices.
fn fan(rim: u32) -> Vec<[Point; 3]> {
    let on = |i: u32| {
        let turn = f64::from(i % rim) / f64::from(rim) * std::f64::consts::TAU;
        [(4.0 * turn.cos()) as f32, (4.0 * turn.sin()) as f32, 0.0]
    };
    let cones = |i| [[on(i), on(i + 1), [0.0, 0.0, 3.0]], [on(i + 1), on(i), [0.0, 0.0, -2.0]]];
    (0..rim).flat_map(cones).collect()
}

/// A closed mesh of small whole numbers, or a sphere: what rays meet at edges and vertices.
fn closed(kind: u32, random: &mut Random) -> Vec<[Point; 3]> {
    let listed = |mesh: Welded| {
        let mesh = mesh.mesh();
        mesh.triangles().iter().map(|t| t.map(|v| mesh.positions()[v as usize])).collect::<Vec<_>>()
    };
    match kind {
        0 => listed(cubes(12, random)),
        1 => fan(3 + random.below(40) as u32),
        2 => outward(&icosphere(1)),
        // The same cube many times: more crossings than are kept at once, all at two places.
        3 => {
            let mut stack = Welded::default();
            (0..5 + random.below(30)).for_each(|_| stack.cube([0.0; 3]));
            listed(stack)
        }
        // Boxes through each other, and triangles without area.
        _ => {
            let mut all = Vec::new();
            for _ in 0..8 {
                let corner = [(); 3].map(|()| random.below(4) as f32);
                let size = [(); 3].map(|()| 1.0 + random.below(3) as f32);
                let mut one = Welded::default();
                one.cube([0.0; 3]);
                let stretched = |p: Point| [0, 1, 2].map(|i| corner[i] + p[i] * size[i]);
                all.extend(listed(one).into_iter().map(|t| t.map(stretched)));
            }
            all.push([[0.0; 3], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0]]);
            all
        }
    }
}

/// A place that a mesh has something at, or beside it.
fn place(triangles: &[[Point; 3]], random: &mut Random) -> Point {
    let [a, b, c] = triangles[random.below(triangles.len())];
    let mean = |p: Point, q: Point| [0, 1, 2].map(|i| 0.5 * (p[i] + q[i]));
    match random.below(7) {
        0 => a,
        1 => mean(b, c),
        2 => mean(a, mean(b, c)),
        3 => a.map(f32::round),
        4 => mean(a, c).map(|x| x - 1.0),
        5 => [a[0], b[1], c[2]],
        _ => random.point().map(|x| 3.0 * x),
    }
}

/// A direction along an axis, an edge, a diagonal, to a corner, or any.
fn way(triangles: &[[Point; 3]], from: Point, random: &mut Random) -> Point {
    let [a, b, _] = triangles[random.below(triangles.len())];
    let found = match random.below(5) {
        0 => [0, 1, 2].map(|i| b[i] - a[i]),
        1 => [0, 1, 2].map(|i| a[i] - from[i]),
        2 => [(); 3].map(|()| random.below(3) as f32 - 1.0),
        3 => {
            let mut axis = [0.0; 3];
            axis[random.below(3)] = if random.below(2) == 0 { 1.0 } else { -1.0 };
            axis
        }
        _ => random.point(),
    };
    if found == [0.0; 3] { [0.0, 0.0, -1.0] } else { found }
}

/// What the rule gives, triangle by triangle.
fn expected(triangles: &[[Point; 3]], ray: &Ray) -> Crossings {
    let mut found = Crossings::default();
    for corners in triangles {
        if let Some(passage) = Passage::new(ray, corners).filter(|passage| passage.is_in_range(ray, corners))
        {
            found.leaving += u32::from(passage.leaving);
            found.entering += u32::from(!passage.leaving);
        }
    }
    found
}

fn check(kind: u32, seed: u64, count: usize) -> Result<(), Failure> {
    let mut random = Random::new(seed);
    let triangles = closed(kind, &mut random);
    let mesh = loose(&triangles);
    let rays: Vec<Ray> = (0..count)
        .map(|_| {
            let from = place(&triangles, &mut random);
            let ray = Ray::new(from, way(&triangles, from, &mut random));
            let range = [(0.0, f32::INFINITY), (f32::NEG_INFINITY, 0.0), (-1.0, 1.0), (0.0, 0.0), (0.5, 2.0)];
            let (t_min, t_max) = range[random.below(8).saturating_sub(3)];
            Ray { t_min, t_max, ..ray }
        })
        .collect();
    let wanted: Vec<Crossings> = rays.iter().map(|ray| expected(&triangles, ray)).collect();
    let builder = Builder::ALL[random.below(Builder::ALL.len())];
    let options = BuildOptions::default().with_builder(builder);
    for named in devices() {
        let scene = Scene::build(&named.device, &mesh, &options)?;
        let Some(found) = unless_cut(scene.crossings(&rays))? else { continue };
        if let Some(i) = wanted.iter().zip(&found.counts).position(|(a, b)| a != b) {
            let (a, b) = (wanted[i], found.counts[i]);
            return Err(Failure(format!(
                "{}, {builder}: {:?} crosses {b:?}, not {a:?}",
                named.name, rays[i]
            )));
        }
        let tracer = scene.tracer()?;
        let single: Vec<Crossings> = rays.iter().map(|ray| tracer.crossings(ray)).collect();
        same("single rays", &wanted, &single)?;
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(20))]

    #[test]
    fn crossings_are_those_of_a_moved_origin(kind in 0..5u32, seed: u64) {
        check(kind, seed, 150)?;
    }

    #[test]
    fn every_direction_finds_the_same_points_inside(kind in 0..5u32, seed: u64) {
        let mut random = Random::new(seed);
        let triangles = closed(kind, &mut random);
        let mesh = loose(&triangles);
        let points: Vec<Point> = (0..40).map(|_| place(&triangles, &mut random)).collect();
        for named in devices() {
            let scene = Scene::build(&named.device, &mesh, &BuildOptions::default())?;
            let Some(inside) = unless_cut(scene.winding(&points))? else { continue };
            let mut rays = Vec::new();
            for &point in &points {
                rays.extend((0..100).map(|_| Ray::new(point, way(&triangles, point, &mut random))));
            }
            let Some(found) = unless_cut(scene.crossings(&rays))? else { continue };
            for (i, (crossings, ray)) in found.counts.iter().zip(&rays).enumerate() {
                prop_assert_eq!(crossings.winding(), inside.counts[i / 100], "{}: {:?}", named.name, ray);
            }
        }
    }
}

/// Planes of a tree, by axis.
fn planes(scene: &Scene) -> [Vec<f32>; 3] {
    let tree = scene.tree().unwrap();
    let tree = tree.view();
    let (lo, hi, scale) = (tree.header.lo, tree.header.hi, tree.header.scale);
    let mut planes = [0, 1, 2].map(|axis| vec![lo[axis] / scale, hi[axis] / scale]);
    for node in tree.nodes {
        if let Content::Inner { axis, split, .. } = node.content() {
            planes[axis as usize].push(split / scale);
        }
    }
    planes
}

/// Numbers that are looked up in the tree, against those of rays: also of points in its planes, at corners of its
/// cells, outside, and of what is no point.
fn looked_up(triangles: &[[Point; 3]], closed: bool, random: &mut Random) -> Result<(), Failure> {
    // As it is; so small that digits are lost; large; and so far off that no ray starts there.
    let (times, off) =
        [(1.0, 0.0), (2f32.powi(-142), 0.0), (2f32.powi(90), 0.0), (2f32.powi(12), 2f32.powi(34))]
            [random.below(6).saturating_sub(2)];
    let moved = |point: Point| point.map(|x| x * times + off);
    let mesh = loose(&triangles.iter().map(|triangle| triangle.map(moved)).collect::<Vec<_>>());
    let builder = Builder::ALL[random.below(Builder::ALL.len())];
    let mut points: Vec<Point> = (0..150).map(|_| moved(place(triangles, random))).collect();
    points.extend([[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [0.0, 0.0, 1e38], [1e-41, -1e-41, -0.0]]);
    for named in devices() {
        let scene = Scene::build(&named.device, &mesh, &BuildOptions::default().with_builder(builder))?;
        let planes = planes(&scene);
        let in_planes = |point: Point, random: &mut Random| {
            [0, 1, 2].map(|axis| {
                let on = planes[axis][random.below(planes[axis].len())];
                if random.below(3) == 0 { point[axis] } else { on }
            })
        };
        let mut all = points.clone();
        while all.len() < (8 * triangles.len()).max(300) {
            all.push(in_planes(moved(place(triangles, random)), random));
        }
        let rays = scene.winding_rays(&all);
        let Some(by_rays) = unless_cut(scene.crossings(&rays))? else { continue };
        let before = scene.bytes_on_device();
        let Some(found) = unless_cut(scene.winding(&all))? else { continue };
        // The median cuts no empty space off, and where little is empty no number is kept.
        let kept = scene.bytes_on_device() > before;
        if builder != Builder::Median && kept != (closed && off == 0.0) {
            let told = format!("{}, {builder}: closed {closed}, {off} off, kept {kept}", named.name);
            return Err(Failure(told));
        }
        let wanted: Vec<i32> = by_rays.counts.iter().map(|crossings| crossings.winding()).collect();
        same(&format!("{}, {builder}", named.name), &wanted, &found.counts)?;
        same("invalid", &[by_rays.invalid], &[found.invalid])?;
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(20))]

    #[test]
    fn numbers_of_empty_leaves_are_those_of_rays(kind in 0..5u32, seed: u64) {
        let mut random = Random::new(seed);
        let mut triangles = closed(kind, &mut random);
        // The last one of boxes has no area, but edges that no other triangle has.
        triangles.truncate(triangles.len() - usize::from(kind == 4));
        // A solid far off, so that most of the box is empty.
        triangles.extend(fan(4).into_iter().map(|triangle| triangle.map(|p| p.map(|x| x + 40.0))));
        looked_up(&triangles, true, &mut random)?;
        looked_up(&triangles[1..], false, &mut random)?;
    }
}

/// A kernel takes the height of an empty leaf's middle for 0, which lies in the slab below. Points above the middle
/// have all their digits.
#[test]
fn no_number_is_kept_of_a_leaf_whose_middle_counts_as_zero() {
    let mut slab = Welded::default();
    slab.cube([0.0; 3]);
    let (positions, triangles) = slab.done();
    let flat = positions.iter().map(|p| [1.75 * p[0], 1.75 * p[1], 0.25 * p[2]]);
    // A tetrahedron that stands on its tip above the slab.
    let tip = [[0.875, 0.875, 1.625], [0.0, 0.0, 1.75], [1.75, 0.0, 1.75], [0.0, 1.75, 1.75]];
    let positions = flat.chain(tip).map(|p| p.map(|x| x * f32::MIN_POSITIVE)).collect();
    let sides = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]].map(|t| t.map(|v| v + 8));
    let mesh = Mesh::new(positions, [triangles, sides.to_vec()].concat()).unwrap();
    for named in devices() {
        let scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
        let before = scene.bytes_on_device();
        let point = [1.25, 1.25, 1.5].map(|x| x * f32::MIN_POSITIVE);
        let found = scene.winding(&vec![point; 300]).unwrap();
        assert!(scene.bytes_on_device() > before, "{}", named.name);
        assert_eq!((found.counts, found.invalid), (vec![0; 300], 0), "{}", named.name);
    }
}

/// Tasks of rayon that ask a scene while another finds numbers out, on threads that take up any task while they wait.
#[test]
fn tasks_that_ask_at_once_do_not_wait_for_each_other() {
    let triangles = outward(&icosphere(3));
    let mesh = loose(&triangles);
    let mut random = Random::new(1);
    let points: Vec<Point> = (0..8 * triangles.len()).map(|_| place(&triangles, &mut random)).collect();
    // Chance decides who waits for whom, so there are more threads than cores.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
    for _ in 0..100 {
        let scene = Scene::build(raykd_tests::cpu(), &mesh, &BuildOptions::default()).unwrap();
        let (clone, before) = (scene.clone(), scene.bytes_on_device());
        let ask = |points: &[Point]| clone.winding(points).unwrap().counts;
        let found: Vec<i32> = pool.install(|| points.par_chunks(100).flat_map(ask).collect());
        assert!(scene.bytes_on_device() > before, "clones share what was found");
        same("tasks", &scene.winding(&points).unwrap().counts, &found).unwrap();
    }
}

/// In planes whose corners differ by what is no float, so that pairs do not tell of which side of 0 a crossing is.
#[test]
fn rays_that_start_in_planes_lose_no_crossing() {
    let y = f32::from_bits(0xB4F1_8A24);
    let corners: [[(u32, u32); 3]; 12] = [
        [(0x467D_E971, 0x47C0_0000), (0x4700_0000, 0x4700_0000), (0xC740_0000, 0x46A6_A615)],
        [(0x4673_283B, 0x47C0_0000), (0xC61E_897F, 0xC780_0000), (0xC648_8A8C, 0x46F6_43CB)],
        [(0xC671_99DB, 0xC800_0000), (0xC680_0000, 0x4800_0000), (0x4780_0000, 0x4700_0000)],
        [(0x0000_0000, 0xC6AF_1835), (0x4700_0000, 0xC508_9A50), (0xC491_F050, 0x4780_0000)],
        [(0x0000_0000, 0x4700_0000), (0xC700_0000, 0x47C0_0000), (0x4700_0000, 0x4484_CB60)],
        [(0x459A_43C4, 0xC800_0000), (0x0000_0000, 0x4800_0000), (0x4780_0000, 0x45EB_1B90)],
        [(0x4680_0000, 0xC7C0_0000), (0x45F5_906A, 0x4780_0000), (0xC63E_4B66, 0x46FF_493A)],
        [(0x4680_0000, 0x47C0_0000), (0x462B_BD62, 0x0000_0000), (0xC680_0000, 0x4780_0000)],
        [(0xC64D_C7EE, 0xC700_0000), (0x45A1_8438, 0x47C0_0000), (0x4740_0000, 0xC6E9_B162)],
        [(0x4700_0000, 0x4700_0000), (0x4634_621A, 0x47C0_0000), (0xC700_0000, 0x4700_0000)],
        [(0x4625_861B, 0x4648_2594), (0x4740_0000, 0xC6C2_782A), (0x4700_0000, 0x45B0_CA7C)],
        [(0xC52E_C12C, 0xC6D2_3ED0), (0xC63F_FC0F, 0x45CE_D5EC), (0x462D_C97B, 0xC7C0_0000)],
    ];
    let many = corners.map(|three| three.map(|(x, z)| [f32::from_bits(x), y, f32::from_bits(z)]));
    let ray = |origin: [u32; 3], direction: [u32; 3], t_max: f32| Ray {
        t_min: f32::NEG_INFINITY,
        t_max,
        ..Ray::new(origin.map(f32::from_bits), direction.map(f32::from_bits))
    };
    let (x, z) = (0xC40F_891F, 0x4743_451A);
    let through =
        ray([x, y.to_bits(), z], [0x3F7F_FFFF, 0x33AA_3899, 0xB39E_1D54], f32::from_bits(0x3F35_3B8C));
    let one = [[
        [0xBDFC_D6EA, 0xBF7C_D6EA, 0x3E99_999A],
        [0x4145_87E7, 0xB9B5_3C3D, 0x3E99_999A],
        [0xBA48_A747, 0x41BB_A781, 0x3E99_999A],
    ]
    .map(|corner: [u32; 3]| corner.map(f32::from_bits))];
    let up = |t_max| ray([0x3E00_0000, 0x3E00_0000, 0x3E99_999A], [0, 0, 0x3F80_0000], t_max);
    let (to, before) = (up(0.0), up(-f32::MIN_POSITIVE));
    for (triangles, ray, wanted) in
        [(&many[..], through, (6, 3)), (&one[..], to, (1, 0)), (&one[..], before, (0, 0))]
    {
        let wanted = Crossings { leaving: wanted.0, entering: wanted.1 };
        assert_eq!(expected(triangles, &ray), wanted);
        for named in devices() {
            let scene = Scene::build(&named.device, &loose(triangles), &BuildOptions::default()).unwrap();
            same(named.name, &[wanted], &scene.crossings(&[ray]).unwrap().counts).unwrap();
        }
    }
}

/// A triangle on a line closes a gap that is there once a corner of it is 0.
#[test]
fn closed_meshes_stay_closed_without_dust() {
    let d = 2f32.powi(-59);
    let (a, b, m) = ([0.0, 0.0, 0.0], [1.0, 0.0, d], [0.5, 0.0, d / 2.0]);
    let (top, bottom, back) = ([0.5, 0.5, 1.0], [0.5, 0.5, -1.0], [0.5, 1.0, 0.0]);
    let faces = [
        [a, b, top],
        [a, m, b],
        [m, a, bottom],
        [b, m, bottom],
        [b, back, top],
        [back, a, top],
        [back, b, bottom],
        [a, back, bottom],
    ];
    let mesh = loose(&faces);
    let inside = [0.5, 0.25, d / 4.0];
    let ways = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.3, -1.0, 0.0], [1.0, 0.2, 0.1]];
    let rays = ways.map(|way| Ray::new(inside, way));
    for named in devices() {
        let scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
        for found in scene.crossings(&rays).unwrap().counts {
            assert_eq!(found.leaving - found.entering, 1, "{}", named.name);
        }
    }
}

/// Where all of a range but 0 is too small for the scaled scene, its end stands where crossings at the origin do.
#[test]
fn crossings_at_the_origin_are_not_in_ranges_beside_it() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0f32]];
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    for (size, direction, end) in [(0, -126, 1.0f32), (0, -100, 2f32.powi(-26)), (-124, 0, 0.5)] {
        let size = 2f32.powi(size);
        let tetrahedron: Vec<[Point; 3]> =
            faces.iter().map(|face| face.map(|v| corners[v].map(|x| x * size))).collect();
        for way in [-1.0, 1.0] {
            let ray = Ray::new([0.25, 0.25, 0.0].map(|x| x * size), [0.0, 0.0, way * 2f32.powi(direction)]);
            let ranges = [(end, f32::MAX), (f32::MIN, -end), (0.0, end), (-end, end), (f32::MIN, f32::MAX)];
            let rays = ranges.map(|(t_min, t_max)| Ray { t_min, t_max, ..ray });
            let wanted = rays.map(|ray| expected(&tetrahedron, &ray));
            if way < 0.0 {
                assert_eq!(wanted[0], Crossings { leaving: 0, entering: 0 }, "{ray:?}");
            }
            for named in devices() {
                let scene =
                    Scene::build(&named.device, &loose(&tetrahedron), &BuildOptions::default()).unwrap();
                same(named.name, &wanted, &scene.crossings(&rays).unwrap().counts).unwrap();
            }
        }
    }
}

#[test]
fn a_thousand_triangles_round_a_vertex_are_crossed_once() {
    for (rim, may_stop) in [(50, false), (100, true), (1000, true)] {
        let triangles = fan(rim);
        let mesh = loose(&triangles);
        // Through both vertices that all triangles share, along an edge of the rim, and in the rim's plane.
        let rays = [
            Ray::new([0.0, 0.0, 9.0], [0.0, 0.0, -1.0]),
            Ray::new([0.0, 0.0, 3.0], [0.0, 0.0, -1.0]),
            Ray::new([9.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
            Ray::new([4.0, 0.0, -9.0], [0.0, 0.0, 1.0]),
        ];
        let wanted: Vec<_> = rays.iter().map(|ray| expected(&triangles, ray)).collect();
        let through = Crossings { leaving: 1, entering: 1 };
        assert_eq!([wanted[0], wanted[2]], [through; 2]);
        for named in devices() {
            let scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
            let found = scene.crossings(&rays);
            // A software rasteriser runs every loop of the exact test once for every triangle, needed or not.
            let found = if may_stop { unless_cut(found).unwrap() } else { Some(found.unwrap()) };
            if let Some(found) = found {
                same(named.name, &wanted, &found.counts).unwrap();
            }
        }
    }
}

#[test]
fn points_of_meshes_far_off_and_points_that_are_none() {
    let mut cube = Welded::default();
    cube.cube([0.0; 3]);
    let (positions, triangles) = cube.done();
    let far = 4.5e6;
    let wide: Vec<[f64; 3]> = positions.iter().map(|p| p.map(|x| f64::from(x) * 0.01 + far)).collect();
    let mesh = Mesh::from_f64(wide, triangles).unwrap();
    for named in devices() {
        let scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
        let inside = far + 0.005;
        let points = [[inside; 3], [inside, inside, far + 0.011], [far - 0.1; 3]];
        // These triangles are clockwise seen from outside.
        assert_eq!(scene.winding(&points).unwrap().counts, [-1, 0, 0], "{}", named.name);
        // A corner, of which the inside lies in the direction in which it counts as moved.
        assert_eq!(scene.winding(&[[far as f32; 3], [0.0; 3]]).unwrap().counts, [-1, 0], "{}", named.name);
        let through = Ray64::new([inside, inside, far - 1.0], [0.0, 0.0, 1.0]);
        let crossings = scene.crossings(&[through]).unwrap().counts;
        assert_eq!(crossings, [Crossings { leaving: 1, entering: 1 }], "{}", named.name);
        let none = scene.winding(&[[f64::NAN, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0]]).unwrap();
        assert_eq!((none.counts, none.invalid), (vec![0, 0], 2), "{}", named.name);
    }
}

/// Speed of winding numbers against that of closest hits of the same rays, on the last device: run it with `--ignored
/// --nocapture`, twice, since an idle GPU has lower clocks for some seconds. By rays alone it takes as long as their
/// crossings; of the dragon numbers of leaves are kept on a GPU from the seventh time on.
#[test]
#[ignore = "measures, on fetched scenes"]
fn speed_of_winding_numbers() {
    for name in ["dragon_res3", "dragon", "sponza"] {
        let mesh = name.parse::<MeshSource>().unwrap().load().unwrap();
        let scene = Scene::build(raykd_tests::gpu(), &mesh, &BuildOptions::default()).unwrap();
        let (lo, hi) = mesh.bounds();
        let mut random = Random::new(1);
        let point = |random: &mut Random| [0, 1, 2].map(|a| lo[a] + (hi[a] - lo[a]) * random.unit() as f32);
        let points: Vec<Point> = (0..1_000_000).map(|_| point(&mut random)).collect();
        let rays = scene.winding_rays(&points);
        let mut resident = scene.resident(&rays).unwrap();
        let mut exact = scene.clone();
        exact.intersect_by(raykd::Intersector::Exact).unwrap();
        let mut by_exact = exact.resident(&rays).unwrap();
        for _ in 0..8 {
            let closest = resident.trace(raykd::Query::Closest).unwrap();
            let exactly = by_exact.trace(raykd::Query::Closest).unwrap();
            let by_rays = scene.crossings(&rays).unwrap().times.trace;
            let winding = scene.winding(&points).unwrap();
            let inside = winding.counts.iter().filter(|&&n| n != 0).count();
            println!(
                "{name}: closest {closest:?}, exact {exactly:?}, by rays {by_rays:?}, winding {:?} (up {:?} down {:?}), {inside} inside",
                winding.times.trace, winding.times.upload, winding.times.download
            );
        }
    }
}

/// Points of closed meshes by three directions each, half of them at vertices, edges and planes of triangles: run it
/// with `--ignored --nocapture` on a real GPU, or with `RAYKD_POINTS_ON=cpu` on the CPU; `RAYKD_POINTS` is how many.
#[test]
#[ignore = "takes minutes without a real GPU"]
fn no_point_of_a_hundred_million_is_inside_by_one_direction_alone() {
    let count = std::env::var("RAYKD_POINTS").map_or(100_000_000, |n| n.parse::<usize>().unwrap());
    let on_cpu = std::env::var("RAYKD_POINTS_ON").is_ok_and(|device| device == "cpu");
    let device = if on_cpu { raykd_tests::cpu() } else { raykd_tests::gpu() };
    let mut random = Random::new(1);
    let lattice = loose(&closed(0, &mut random));
    let sphere = loose(&outward(&icosphere(4)));
    let dragon = "dragon_res3".parse::<MeshSource>().unwrap().load().unwrap();
    let meshes = [("dragon_res3", dragon), ("sphere", sphere), ("cubes", lattice)];
    for (name, mesh) in &meshes {
        assert!(mesh.edges().are_closed());
        let corners = |t: &[u32; 3]| t.map(|v| mesh.positions()[v as usize]);
        let triangles: Vec<[Point; 3]> = mesh.triangles().iter().map(corners).collect();
        let scene = Scene::build(device, mesh, &BuildOptions::default()).unwrap();
        let (lo, hi) = mesh.bounds();
        let (mut done, mut inside) = (0, 0);
        while done < count / meshes.len() {
            let seed = random.bits();
            let points: Vec<Point> = (0..1u64 << 20)
                .into_par_iter()
                .map(|i| {
                    let mut random = Random::new(seed ^ i.wrapping_mul(0x9E37_79B9_7F4A_7C15));
                    let [a, b, c] = triangles[random.below(triangles.len())];
                    match random.below(6) {
                        0 => a,
                        1 => [0, 1, 2].map(|i| 0.5 * (a[i] + b[i])),
                        2 => [a[0], b[1], c[2]],
                        _ => [0, 1, 2].map(|i| lo[i] + (hi[i] - lo[i]) * random.unit() as f32),
                    }
                })
                .collect();
            let windings = scene.winding(&points).unwrap();
            let to = triangles[random.below(triangles.len())][0];
            for direction in [random.point(), to] {
                let rays: Vec<Ray> = points
                    .par_iter()
                    .map(|&p| {
                        let way = if direction == to { [0, 1, 2].map(|i| to[i] - p[i]) } else { direction };
                        Ray::new(p, if way == [0.0; 3] { direction } else { way })
                    })
                    .collect();
                let crossings = scene.crossings(&rays).unwrap();
                let differs =
                    (0..points.len()).find(|&i| crossings.counts[i].winding() != windings.counts[i]);
                assert_eq!(
                    differs.map(|i| (rays[i], windings.counts[i], crossings.counts[i])),
                    None,
                    "{name}"
                );
            }
            done += points.len();
            inside += windings.counts.iter().filter(|&&winding| winding != 0).count();
        }
        println!("{name}: {done} points, {inside} inside, the same by three directions");
    }
}
