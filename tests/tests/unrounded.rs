//! The triangle test `exact`: every number of every hit is the exact one, rounded once, on every device.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Hit, Intersector, Mesh, Query, Ray, Scene,
    internals::kernels::math::{exponent, ldexp},
    rays::Random,
    stress::{is_ray, settled},
};
use raykd_oracle::exact::{Corners, Exact};
use raykd_tests::{
    Failure, cases, cpu, gpu,
    meshes::{Family, Recipe, icosphere, loose, small_mesh},
    rays::{of_any_size, rays},
    same, unless_cut, with_doubles,
};

/// Triangles as the kernels know them, in the mesh's own units: tiny coordinates are 0.
fn corners(mesh: &Mesh) -> Vec<Corners> {
    let scaled = mesh.scaled_positions();
    let position = |v: u32| {
        let own = mesh.positions()[v as usize];
        [0, 1, 2].map(|i| if scaled[3 * v as usize + i] == 0.0 { 0.0 } else { own[i] })
    };
    mesh.triangles().iter().map(|t| t.map(position)).collect()
}

/// The ray as kernels know it: without subnormal numbers, and without what would be one in the scaled mesh.
fn known(ray: &Ray, scale: f32) -> Ray {
    let ray = settled(ray);
    Ray { origin: ray.origin.map(|x| if ldexp(x, exponent(scale)) == 0.0 { 0.0 } else { x }), ..ray }
}

/// The exact closest hit, rounded.
fn closest(ray: &Ray, scale: f32, corners: &[Corners]) -> Option<Hit> {
    // Nearer than the least number beside 0, in the scaled mesh, is 0.
    let top = ray.direction.map(exponent).into_iter().max().unwrap();
    let least = 2f64.powi(-126 - exponent(scale) - top);
    let hit = |(triangle, corners)| {
        let exact = Exact::new(ray, corners);
        if !exact.inside() {
            return None;
        }
        let (at, [t, u, v]) = (exact.rounded_t(), exact.rounded());
        let (at, t) = if at.abs() < least { (0.0, 0.0) } else { (at, t) };
        let counts = f64::from(ray.t_min) <= at && at <= f64::from(ray.t_max);
        counts.then_some((at, Hit { t, triangle: triangle as u32, u, v }))
    };
    let hits = corners.iter().enumerate().filter_map(hit);
    let first = hits.min_by(|(a, x), (b, y)| a.total_cmp(b).then(x.triangle.cmp(&y.triangle)));
    first.map(|(_, hit)| hit)
}

/// Compares the answers of every device with the exact ones. How many hits there were.
fn check(mesh: &Mesh, rays: &[Ray]) -> Result<usize, Failure> {
    let corners = corners(mesh);
    let in_range = |ray: &Ray| {
        is_ray(ray) && ray.origin.iter().all(|&x| exponent(ldexp(x, exponent(mesh.scale()))) < 30)
    };
    let rays: Vec<Ray> = rays.iter().filter(|ray| in_range(ray)).copied().collect();
    let scale = mesh.scale();
    let exact: Vec<_> = rays.iter().map(|ray| closest(&known(ray, scale), scale, &corners)).collect();
    for named in with_doubles() {
        let mut scene = Scene::build(&named.device, mesh, &BuildOptions::default())?;
        scene.intersect_by(Intersector::Exact)?;
        // Rays along edges of many triangles need more rounds than llvmpipe grants.
        let Some(found) = unless_cut(scene.closest(&rays))? else { continue };
        for ((ray, exact), found) in rays.iter().zip(&exact).zip(&found) {
            let expected = exact.unwrap_or(Hit::NONE);
            if bytemuck::bytes_of(found) != bytemuck::bytes_of(&expected) {
                return Err(Failure(format!("{}: {found:?} for {expected:?}, {ray:?}", named.name)));
            }
        }
        if let Some(brute) = unless_cut(scene.brute(&rays))? {
            same(&format!("by brute force on {}", named.name), &found, &brute)?;
        }
        let any = scene.trace(Query::Any, &rays)?.hits;
        if any.iter().zip(&found).any(|(any, closest)| any.is_hit() != closest.is_hit()) {
            return Err(Failure(format!("{}: any and closest hits disagree", named.name)));
        }
    }
    Ok(exact.iter().flatten().count())
}

proptest! {
    #![proptest_config(cases(64))]
    #[test]
    fn hits_are_the_exact_ones_rounded_once(recipe in small_mesh(), seed: u64, count in 1usize..100) {
        let mesh = recipe.mesh();
        let tree = Scene::build(cpu(), &mesh, &BuildOptions::default())?.tree()?;
        check(&mesh, &rays(&mesh, tree.view(), count, seed))?;
    }

    #[test]
    fn numbers_of_any_size_are_exact(recipe in small_mesh(), seed: u64, count in 1usize..100) {
        let mesh = recipe.mesh();
        let tree = Scene::build(cpu(), &mesh, &BuildOptions::default())?.tree()?;
        check(&mesh, &of_any_size(&rays(&mesh, tree.view(), count, seed), seed))?;
    }
}

/// Rays exactly through edges and vertices that are no small integers, so that neither floats nor pairs decide.
fn through_edges(corners: &[Corners], count: usize, random: &mut Random) -> Vec<Ray> {
    let mut rays = Vec::new();
    while rays.len() < count {
        let [a, b, _] = corners[random.below(corners.len())];
        // A point half way, or an end, and a direction whose multiples lead there from representable points.
        let at = [0, 1, 2].map(|i| if rays.len() % 3 == 0 { a[i] } else { (a[i] + b[i]) * 0.5 });
        let exact = (0..3).all(|i| f64::from(at[i]) * 2.0 == f64::from(a[i]) + f64::from(b[i])) || at == a;
        let direction = [(); 3].map(|()| (random.signed() * 4096.0).round() / 4096.0);
        let from = [0, 1, 2].map(|i| at[i] - direction[i]);
        let straight = (0..3).all(|i| f64::from(from[i]) + f64::from(direction[i]) == f64::from(at[i]));
        if exact && straight && direction != [0.0; 3] {
            rays.push(Ray::new(from, direction));
        }
    }
    rays
}

#[test]
fn rays_exactly_at_edges_and_vertices_are_decided() {
    for seed in 0..4 {
        // Coordinates of 16 digits: sums and middles are exact, products take more than pairs.
        let coarse = |x: f32| (x * 4096.0).round() / 4096.0;
        let round = |mesh: &Mesh| {
            let positions = mesh.positions().iter().map(|p| p.map(coarse)).collect();
            Mesh::new(positions, mesh.triangles().to_vec()).unwrap()
        };
        let mesh = round(&Recipe { family: Family::Soup, size: 60, seed }.mesh());
        let rays = through_edges(&corners(&mesh), 300, &mut Random::new(seed));
        let hits = check(&mesh, &rays).unwrap();
        assert!(hits > 280, "{hits}");
        let sphere = round(&icosphere(1));
        assert_eq!(
            check(&sphere, &through_edges(&corners(&sphere), 300, &mut Random::new(seed))).unwrap(),
            300
        );
    }
}

/// The ray starts in an edge of all triangles but the last, too early to count, and passes through one of the last: no
/// stage but integers decides any. A driver that ends loops after so many rounds must not pass off what it has by then
/// as an answer, be it within the last triangle.
#[test]
fn what_a_driver_cuts_short_is_an_error() {
    let mut cut = 0;
    for seed in 0..16 {
        let mut random = Random::new(seed);
        // Of more and more digits, for which integers take more rounds.
        let fine = 2f32.powi(12 + seed as i32 % 8);
        let mut coarse = || [(); 3].map(|()| (random.signed() * fine).round() / fine);
        let way = coarse();
        let mut corners = Vec::new();
        for _ in 0..89 {
            let half = coarse();
            corners.push([half, half.map(|x| -x), coarse()]);
        }
        let half = coarse();
        let last = [1.0, -1.0].map(|sign| [0, 1, 2].map(|i| 0.5 * way[i] + sign * 0.5 * half[i]));
        let last = [last[0], last[1], coarse()];
        let ray = Ray { t_min: 1e-20, ..Ray::new([0.0; 3], way) };
        for n in 30..90 {
            let positions = [&corners[..n], &[last]].concat().concat();
            let mesh = Mesh::new(positions, (0..=n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
                .unwrap();
            // No tree is asked.
            let leaf = BuildOptions::default().with_max_depth(0);
            let brute = |device| {
                let mut scene = Scene::build(device, &mesh, &leaf).unwrap();
                scene.intersect_by(Intersector::Exact).unwrap();
                unless_cut(scene.brute(&[ray])).unwrap()
            };
            let expected = brute(cpu()).unwrap();
            assert_eq!((expected[0].triangle, expected[0].t), (n as u32, 0.5));
            match brute(gpu()) {
                Some(found) => same(&format!("{n} triangles, seed {seed}"), &expected, &found).unwrap(),
                None => cut += 1,
            }
        }
    }
    println!("cut short: {cut} of {}", 16 * 60);
    assert!(cut > 0 || !gpu().name().contains("llvmpipe"), "llvmpipe takes more than that");
}

#[test]
fn t_is_the_nearest_float() {
    let mesh = icosphere(2);
    let mut random = Random::new(3);
    let rays: Vec<Ray> = (0..2000).map(|_| Ray::new([0.1, 0.2, -0.3], random.point())).collect();
    assert_eq!(check(&mesh, &rays).unwrap(), rays.len());
    // The default's is not: or else this shows nothing.
    let corners = corners(&mesh);
    let scene = Scene::build(gpu(), &mesh, &BuildOptions::default()).unwrap();
    let found = scene.closest(&rays).unwrap();
    let off =
        rays.iter().zip(&found).filter(|(ray, hit)| closest(ray, 1.0, &corners).unwrap().t != hit.t).count();
    assert!(off > 100, "{off}");
}

/// Closest hits of a scene's rays by the tree, the same by brute force and on every device.
fn by_all(mesh: &Mesh, intersector: Intersector, rays: &[Ray]) -> Vec<Hit> {
    let mut hits: Option<Vec<Hit>> = None;
    for named in with_doubles() {
        let mut scene = Scene::build(&named.device, mesh, &BuildOptions::default()).unwrap();
        scene.intersect_by(intersector).unwrap();
        for found in [scene.closest(rays), scene.brute(rays)] {
            let Some(found) = unless_cut(found).unwrap() else { continue };
            same(named.name, hits.get_or_insert_with(|| found.clone()), &found).unwrap();
        }
    }
    hits.unwrap()
}

const CORNER: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

#[test]
fn the_range_is_that_of_t_as_returned() {
    // Hits at n/d: where that is rounded, the real `t` is just outside a range that begins or ends at the float.
    let mesh = loose(&[CORNER]);
    let mut rays = Vec::new();
    for n in 1..6u8 {
        rays.extend((7..40u8).map(|d| Ray::new([1.0, 1.0, n.into()], [0.0, 0.0, -f32::from(d)])));
    }
    for &intersector in Intersector::ALL {
        let found = by_all(&mesh, intersector, &rays);
        let mut rounded = [0; 2];
        for (ray, hit) in rays.iter().zip(&found) {
            let (n, d) = (ray.origin[2], -ray.direction[2]);
            if intersector == Intersector::Exact {
                assert_eq!(hit.t, n / d);
            }
            let real = f64::from(n) / f64::from(d);
            rounded[0] += u32::from(f64::from(hit.t) > real);
            rounded[1] += u32::from(f64::from(hit.t) < real);
        }
        assert!(rounded.iter().all(|&n| n > 5), "{intersector}: {rounded:?}");
        let narrow = |change: fn(&mut Ray, f32)| {
            let mut changed = rays.clone();
            changed.iter_mut().zip(&found).for_each(|(ray, hit)| change(ray, hit.t));
            by_all(&mesh, intersector, &changed)
        };
        let inside: [fn(&mut Ray, f32); 3] =
            [|ray, t| ray.t_min = t, |ray, t| ray.t_max = t, |ray, t| (ray.t_min, ray.t_max) = (t, t)];
        for change in inside {
            same(intersector.name(), &found, &narrow(change)).unwrap();
        }
        let outside: [fn(&mut Ray, f32); 2] =
            [|ray, t| ray.t_min = t.next_up(), |ray, t| ray.t_max = t.next_down()];
        for change in outside {
            assert!(narrow(change).iter().all(|hit| !hit.is_hit()), "{intersector}");
        }
    }
}

#[test]
fn of_hits_whose_t_has_no_room_the_closest_wins() {
    // Of what is met from above, the nearest has the highest numbers.
    let at = |z: f32| CORNER.map(|[x, y, _]| [x, y, z]);
    let mesh = loose(&[at(-2.0), at(-1.0), at(0.0), at(0.0)]);
    let down = |height: f32, length: f32| Ray::new([1.0, 1.0, height], [0.0, 0.0, -length]);
    let up = |height: f32, length: f32| Ray::new([1.0, 1.0, height], [0.0, 0.0, length]);
    let (most, least, no_end) = (f32::MAX, f32::MIN_POSITIVE, f32::INFINITY);
    let [long, short] = [down(2.0, most), down(4.0, least)];
    let cases = [
        (long, Some((2, 0.0))),
        (up(-4.0, most), Some((0, 0.0))),
        (short, Some((2, no_end))),
        (up(-6.0, least), Some((0, no_end))),
        // So are they compared with the range: a `t` that is 0 as returned is more than 0, or less.
        (Ray { t_max: 0.0, ..long }, None),
        (Ray { t_max: least, ..long }, Some((2, 0.0))),
        (Ray { t_min: -1.0, t_max: -0.0, ..up(2.0, most) }, Some((0, -4.0 / most))),
        (Ray { t_min: -least, ..up(2.0, most) }, Some((1, 0.0))),
        (Ray { t_min: least, ..long }, Some((0, 4.0 / most))),
        (Ray { t_max: most, ..short }, None),
        (Ray { t_min: most, ..short }, Some((2, no_end))),
    ];
    let rays: Vec<Ray> = cases.iter().map(|(ray, _)| *ray).collect();
    // Seen along so short a direction, all triangles are too small for `moeller`.
    for intersector in Intersector::ALL.iter().copied().filter(|&test| test != Intersector::Moeller) {
        for ((ray, expected), hit) in cases.iter().zip(by_all(&mesh, intersector, &rays)) {
            let found = hit.is_hit().then_some((hit.triangle, hit.t));
            assert_eq!(&found, expected, "{intersector}: {ray:?}");
        }
    }
}

#[test]
fn exact_sees_numbers_of_any_size() {
    let mesh = loose(&[CORNER]);
    let least = f32::MIN_POSITIVE;
    let beside = |x: f32| Ray::new([x, 1.0, 1.0], [0.0, 0.0, -1.0]);
    let aslant = |x: f32, length: f32| Ray::new([0.0, 1.0, 1.0], [x, 0.0, -length]);
    let rays = [
        beside(least),
        aslant(least, 1.0),
        aslant(least, f32::MAX),
        beside(-least),
        aslant(-least, 1.0),
        aslant(-least, f32::MAX),
    ];
    let hits = |intersector| by_all(&mesh, intersector, &rays).iter().map(Hit::is_hit).collect::<Vec<_>>();
    assert_eq!(hits(Intersector::Exact), [true, true, true, false, false, false]);
    // What is that small is 0 for the default.
    assert_eq!(hits(Intersector::Strict), [true; 6]);
    check(&mesh, &rays).unwrap();
}

#[test]
fn where_numbers_end_they_are_rounded_as_elsewhere() {
    // In the plane `x + z = 0`; `t` is the least number divided by a little more than 1.
    let mesh = loose(&[[[-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [0.0, 1.0, 0.0]]]);
    let from = |x: f32| Ray::new([0.0, 0.0, -f32::MIN_POSITIVE], [x, 0.0, 1.0]);
    let rays = [from(0.0), from(2f32.powi(-26)), from(2f32.powi(-23))];
    let found = by_all(&mesh, Intersector::Exact, &rays);
    assert_eq!(
        found.iter().map(|hit| hit.t).collect::<Vec<_>>(),
        [f32::MIN_POSITIVE, f32::MIN_POSITIVE, 0.0]
    );
    check(&mesh, &rays).unwrap();
    // Hits as near as hits can be, along short directions: ends of ranges that are nearer still keep to their side.
    let mut rays = Vec::new();
    let [t, nearer] = [2f32.powi(-116), 2f32.powi(-120)];
    for (z, side) in [(f32::MIN_POSITIVE, 1.0), (-f32::MIN_POSITIVE, -1.0)] {
        let ray = Ray::new([0.25, 0.25, z], [0.0, 0.0, -2f32.powi(-10)]);
        for (near, far) in
            [(0.0, 1.0), (0.0, t), (0.0, nearer), (nearer, 1.0), (t, t), (2.0 * t, 1.0), (-1.0, nearer)]
        {
            let (a, b) = (side * near, side * far);
            rays.push(Ray { t_min: a.min(b), t_max: a.max(b), ..ray });
        }
    }
    let found = by_all(&loose(&[CORNER]), Intersector::Exact, &rays);
    let hits: Vec<bool> = found.iter().map(Hit::is_hit).collect();
    assert_eq!(hits, [[true, true, false, true, true, false, false]; 2].concat());
    assert!(found.iter().all(|hit| !hit.is_hit() || hit.t.abs() == t));
}

#[test]
fn a_flat_mesh_may_be_far_away() {
    let distance = 2f32.powi(50).next_down();
    // With coordinates that make integers as long as they get.
    let small = 2f32.powi(-57);
    let mesh = loose(&[[[small, 0.0, distance], [4.0, 0.0, distance], [small, 4.0, distance]]]);
    let mut random = Random::new(1);
    let mut rays = Vec::new();
    for _ in 0..500 {
        let least = f32::MIN_POSITIVE;
        let x = [0.0, least, -least, small, small + 2.0 * least, random.signed(), 1.0][random.below(7)];
        let y = [0.0, least, -least, 1.0, random.signed() * 4.0][random.below(5)];
        let slant = [0.0, least, -least, small / distance, 1.0 / distance][random.below(5)];
        rays.push(Ray::new([x, y, [0.0, -least][random.below(2)]], [slant, -0.0, 1.0]));
    }
    let hits = check(&mesh, &rays).unwrap();
    assert!((100..400).contains(&hits), "{hits}");
}
