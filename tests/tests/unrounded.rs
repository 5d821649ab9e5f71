//! The triangle test `exact`: every number of every hit is the exact one, rounded once, on every device.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Hit, Intersector, Mesh, Query, Ray, Scene,
    kernels::math::{exponent, ldexp},
    rays::Random,
    stress::{is_ray, settled},
};
use raykd_oracle::exact::{Corners, Exact};
use raykd_tests::{
    Failure, cases, cpu, devices, gpu,
    meshes::{Family, Recipe, icosphere, small_mesh},
    rays::rays,
    same, unless_cut,
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

/// The ray without what counts as 0.
fn known(ray: &Ray, scale: f32) -> Ray {
    let ray = settled(ray);
    let top = ray.direction.map(exponent).into_iter().max().unwrap();
    Ray {
        origin: ray.origin.map(|x| if ldexp(x, exponent(scale)).abs() < 2f32.powi(-70) { 0.0 } else { x }),
        direction: ray.direction.map(|x| if exponent(x) < top - 126 { 0.0 } else { x }),
        ..ray
    }
}

/// The exact closest hit, rounded.
fn closest(ray: &Ray, corners: &[Corners]) -> Option<Hit> {
    let hit = |(triangle, corners)| {
        let exact = Exact::new(ray, corners);
        let [t, u, v] = if exact.inside() { exact.rounded() } else { return None };
        (ray.t_min <= t && t <= ray.t_max).then_some(Hit { t, triangle: triangle as u32, u, v })
    };
    let hits = corners.iter().enumerate().filter_map(hit);
    hits.min_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)))
}

/// Whether a distance keeps its digits when scaled.
fn usual(t: f32) -> bool {
    t == 0.0 || t.is_infinite() || (1e-15..1e15).contains(&t.abs())
}

/// Compares the answers of every device with the exact ones. How many hits there were.
fn check(mesh: &Mesh, rays: &[Ray]) -> Result<usize, Failure> {
    let corners = corners(mesh);
    let in_range = |ray: &Ray| {
        let sizes = ray.origin.map(|x| (x * mesh.scale()).abs());
        // Neither are lengths along the ray lost below the range of floats, nor beyond it.
        let length = ray.direction.iter().fold(0.0, |most: f32, x| most.max(x.abs()));
        is_ray(ray)
            && [length, ray.t_min, ray.t_max].into_iter().all(usual)
            && sizes.iter().all(|&x| x < 2f32.powi(30))
    };
    let rays: Vec<Ray> = rays.iter().filter(|ray| in_range(ray)).copied().collect();
    let exact: Vec<_> = rays.iter().map(|ray| closest(&known(ray, mesh.scale()), &corners)).collect();
    for named in devices() {
        let mut scene = Scene::build(&named.device, mesh, &BuildOptions::default())?;
        scene.intersect_by(Intersector::Exact)?;
        // Rays along edges of many triangles need more rounds than llvmpipe grants.
        let Some(found) = unless_cut(scene.closest(&rays))? else { continue };
        for ((ray, exact), found) in rays.iter().zip(&exact).zip(&found) {
            let expected = exact.unwrap_or(Hit::NONE);
            if usual(expected.t) && bytemuck::bytes_of(found) != bytemuck::bytes_of(&expected) {
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
            let brute = |device| {
                let mut scene = Scene::build(device, &mesh, &BuildOptions::default()).unwrap();
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
    let off = rays.iter().zip(&found).filter(|(ray, hit)| closest(ray, &corners).unwrap().t != hit.t).count();
    assert!(off > 100, "{off}");
}
