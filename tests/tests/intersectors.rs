//! The published triangle tests: the same bytes on every device, and right where they should be; where the literature
//! says that they fail, they do.

use proptest::prelude::*;
use raykd::{BuildOptions, Hit, Intersector, Mesh, Query, Ray, Scene, Traversal, rays::Random};
use raykd_tests::{
    cases, cpu, devices, gpu,
    meshes::{Family, Recipe, icosphere, small_mesh},
    rays::{of_any_size, rays},
    same, unless_cut,
};

fn scene(device: &'static raykd::Device, mesh: &Mesh, intersector: Intersector) -> Scene {
    let mut scene = Scene::build(device, mesh, &BuildOptions::default()).unwrap();
    scene.intersect_by(intersector).unwrap();
    scene
}

/// Closest and any hits by the tree, and closest hits by all triangles.
fn trace(scene: &Scene, rays: &[Ray]) -> Result<[Vec<Hit>; 3], raykd::Error> {
    let closest = scene.trace(Query::Closest, rays)?.hits;
    Ok([closest, scene.trace(Query::Any, rays)?.hits, scene.brute(rays)?])
}

proptest! {
    #![proptest_config(cases(64))]
    #[test]
    fn every_test_finds_the_same_on_every_device(recipe in small_mesh(), seed: u64, count in 1usize..200) {
        let mesh = recipe.mesh();
        let tree = Scene::build(cpu(), &mesh, &BuildOptions::default())?.tree()?;
        let mut rays = rays(&mesh, tree.view(), count, seed);
        rays.extend(of_any_size(&rays, seed));
        let mut scenes = Vec::new();
        for named in devices() {
            scenes.push((named.name, Scene::build(&named.device, &mesh, &BuildOptions::default())?));
        }
        for &intersector in Intersector::ALL {
            let mut expected = None;
            for (name, scene) in &mut scenes {
                scene.intersect_by(intersector)?;
                let Some(found) = unless_cut(trace(scene, &rays))? else { continue };
                let expected = expected.get_or_insert_with(|| found.clone());
                for (what, (a, b)) in ["closest", "any", "brute"].iter().zip(expected.iter().zip(&found)) {
                    same(&format!("{what} hits by {intersector} on {name}"), a, b)?;
                }
            }
        }
    }
}

/// Rays from about the middle of a mesh around the origin to points of its triangles: to their insides, and to their
/// corners and edges.
fn aimed(mesh: &Mesh, rounds: usize) -> [Vec<Ray>; 2] {
    let mut random = Random::new(7);
    let mut rays = [Vec::new(), Vec::new()];
    for _ in 0..rounds {
        for triangle in mesh.triangles() {
            let [a, b, c] = triangle.map(|v| mesh.positions()[v as usize]);
            let from = [(); 3].map(|()| (random.unit() - 0.5) as f32);
            let [s, t] = [(); 2].map(|()| random.unit() as f32);
            let to = |[u, v]: [f32; 2]| {
                let point = [0, 1, 2].map(|i| a[i] * (1.0 - u - v) + b[i] * u + c[i] * v);
                Ray::new(from, [0, 1, 2].map(|i| point[i] - from[i]))
            };
            rays[0].push(to([0.1 + 0.4 * s, 0.1 + 0.3 * t]));
            rays[1].extend([to([0.0, 0.0]), to([s, 0.0]), to([s, 1.0 - s]), to([0.5, 0.5])]);
        }
    }
    rays
}

/// Stairs of eight steps, each tread followed by a slope.
fn stairs() -> Mesh {
    let row = |i: u16| {
        (0..9u16).map(move |j| [f32::from(j) * 0.25 - 1.0, f32::from(i) * 0.25 - 2.0, f32::from(i / 2) * 0.1])
    };
    let positions = (0..17).flat_map(row).collect();
    let quads = (0..16u32).flat_map(|i| (0..8u32).map(move |j| 9 * i + j));
    let triangles = quads.flat_map(|at| [[at, at + 1, at + 9], [at + 1, at + 10, at + 9]]).collect();
    Mesh::new(positions, triangles).unwrap()
}

/// Eight neighbours each start at one point and go to a triangle and a near one in turn, most to their insides, one to
/// a corner and one to an edge: of these floats leave several triangles open. A CPU takes them together, but answers
/// each as if it were alone.
#[test]
fn rays_that_go_together_find_what_each_finds_alone() -> Result<(), raykd::Error> {
    let mut random = Random::new(9);
    let from = [0.3, 0.2, 4.0];
    for mesh in [icosphere(2), stairs()] {
        let mut rays = Vec::new();
        for two in mesh.triangles().windows(17) {
            for lane in 0..8 {
                let [a, b, c] = two[16 * (lane & 1)].map(|v| mesh.positions()[v as usize]);
                let [s, t] = [(); 2].map(|()| random.unit() as f32);
                let [u, v] = match lane {
                    2 => [0.0, 0.0],
                    5 => [s, 0.0],
                    _ => [0.1 + 0.4 * s, 0.1 + 0.3 * t],
                };
                let point = [0, 1, 2].map(|i| a[i] * (1.0 - u - v) + b[i] * u + c[i] * v);
                rays.push(Ray::new(from, [0, 1, 2].map(|i| point[i] - from[i])));
            }
        }
        for intersector in [Intersector::Strict, Intersector::Exact] {
            let scene = scene(cpu(), &mesh, intersector);
            for query in [Query::Closest, Query::Any] {
                let together = scene.trace(query, &rays)?.hits;
                assert!(together.iter().filter(|hit| hit.is_hit()).count() > rays.len() / 2);
                for (ray, hit) in rays.iter().zip(&together) {
                    let alone = scene.trace(query, &[*ray])?.hits;
                    assert_eq!(alone, [*hit], "{intersector} {query:?} {ray:?}");
                }
            }
        }
    }
    Ok(())
}

/// Distance in units of the last place.
fn ulps(a: f32, b: f32) -> u32 {
    (a.to_bits() as i32).abs_diff(b.to_bits() as i32)
}

#[test]
fn on_easy_rays_all_find_the_same() {
    let mesh = icosphere(3);
    let [inside, _] = aimed(&mesh, 20);
    let expected = scene(cpu(), &mesh, Intersector::Strict).closest(&inside).unwrap();
    for (i, hit) in expected.iter().enumerate() {
        assert_eq!(hit.triangle as usize, i % mesh.triangles().len());
    }
    for (intersector, most) in [
        (Intersector::Exact, 4),
        (Intersector::Woop, 4),
        (Intersector::Moeller, 8),
        (Intersector::Plane, 8),
        (Intersector::Baldwin, 8),
    ] {
        for [found, brute] in [cpu(), gpu()].map(|device| {
            let scene = scene(device, &mesh, intersector);
            [scene.closest(&inside).unwrap(), scene.brute(&inside).unwrap()]
        }) {
            same(intersector.name(), &found, &brute).unwrap();
            let mut worst = 0;
            for (a, b) in expected.iter().zip(&found) {
                assert_eq!(a.triangle, b.triangle, "{intersector}");
                assert!((a.u - b.u).abs() < 1e-4 && (a.v - b.v).abs() < 1e-4, "{intersector}: {a:?} {b:?}");
                worst = worst.max(ulps(a.t, b.t));
            }
            println!("{intersector}: t within {worst} ULP of the default");
            assert!(worst > 0 && worst <= most, "{intersector}: {worst} ULP");
        }
    }
}

/// Misses per million of rays at seams of a closed mesh, from inside.
fn leaks(mesh: &Mesh, rays: &[Ray], intersector: Intersector) -> f64 {
    let hits = scene(cpu(), mesh, intersector).brute(rays).unwrap();
    hits.iter().filter(|hit| !hit.is_hit()).count() as f64 * 1e6 / rays.len() as f64
}

#[test]
fn only_edge_functions_do_not_leak() {
    let mesh = icosphere(3);
    let [_, seams] = aimed(&mesh, 20);
    for intersector in [Intersector::Strict, Intersector::Exact, Intersector::Woop] {
        assert_eq!(leaks(&mesh, &seams, intersector), 0.0, "{intersector}");
    }
    for intersector in [Intersector::Moeller, Intersector::Plane, Intersector::Baldwin] {
        let rate = leaks(&mesh, &seams, intersector);
        println!("{intersector}: {rate:.0} misses per million of {} rays at edges and vertices", seams.len());
        assert!(rate > 1e3, "{intersector}: {rate} per million");
    }
}

#[test]
fn woop_without_doubles_hits_beside_edges_and_misses_nothing() {
    let (mut both, mut beside) = (0, 0);
    for triangle in icosphere(1).triangles() {
        let corners = triangle.map(|v| icosphere(1).positions()[v as usize]);
        let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
        let [_, seams] = aimed(&mesh, 500);
        let [strict, woop] = [Intersector::Strict, Intersector::Woop]
            .map(|intersector| scene(cpu(), &mesh, intersector).closest(&seams).unwrap());
        for (strict, woop) in strict.iter().zip(&woop) {
            assert!(woop.is_hit() || !strict.is_hit());
            both += u32::from(strict.is_hit());
            beside += u32::from(woop.is_hit() && !strict.is_hit());
        }
    }
    println!("rays at edges of single triangles: {both} hit, {beside} more by woop");
    assert!(beside > both / 100);
}

/// A mesh and rays with coordinates, and ranges of `t`, multiplied with a power of two.
fn scaled(mesh: &Mesh, rays: &[Ray], factor: f32) -> (Mesh, Vec<Ray>) {
    let grow = |p: &[f32; 3]| p.map(|x| x * factor);
    let positions = mesh.positions().iter().map(grow).collect();
    let rays = rays.iter().map(|ray| Ray {
        origin: grow(&ray.origin),
        t_min: ray.t_min * factor,
        t_max: ray.t_max * factor,
        ..*ray
    });
    (Mesh::new(positions, mesh.triangles().to_vec()).unwrap(), rays.collect())
}

#[test]
fn small_triangles_vanish_for_moeller_alone() {
    let mesh = icosphere(3);
    let [inside, _] = aimed(&mesh, 1);
    for factor in [2f32.powi(-20), 2f32.powi(20)] {
        let (mesh, rays) = scaled(&mesh, &inside, factor);
        for &intersector in Intersector::ALL {
            let hits = scene(cpu(), &mesh, intersector).closest(&rays).unwrap();
            let vanish = intersector == Intersector::Moeller && factor < 1.0;
            assert!(hits.iter().all(|hit| hit.is_hit() != vanish), "{intersector} at {factor:e}");
        }
    }
}

#[test]
fn scale_changes_no_digit_but_for_moeller() {
    for family in [Family::Soup, Family::Slivers, Family::Lattice] {
        let mesh = Recipe { family, size: 300, seed: 5 }.mesh();
        let tree = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap().tree().unwrap();
        // Numbers that stay what they are at any of the scales below.
        let usual = |x: f32| x == 0.0 || x.is_infinite() || (1e-15..1e15).contains(&x.abs());
        let plain = |ray: &Ray| ray.origin.into_iter().chain([ray.t_min, ray.t_max]).all(usual);
        let rays: Vec<Ray> = rays(&mesh, tree.view(), 1000, 6).into_iter().filter(plain).collect();
        for &intersector in Intersector::ALL {
            if intersector == Intersector::Moeller {
                continue;
            }
            let expected = scene(cpu(), &mesh, intersector).brute(&rays).unwrap();
            let hits = expected.iter().filter(|hit| hit.is_hit()).count();
            assert!(hits > 30, "{intersector}, {family:?}: {hits}");
            // Within and beyond the sizes that kernels see as they are.
            for k in [-7, 9, -60, 50] {
                let factor = 2f32.powi(k);
                let (mesh, rays) = scaled(&mesh, &rays, factor);
                let found = scene(cpu(), &mesh, intersector).brute(&rays).unwrap();
                let expected: Vec<Hit> = expected.iter().map(|h| Hit { t: h.t * factor, ..*h }).collect();
                same(&format!("{intersector}, {family:?} times 2^{k}"), &expected, &found).unwrap();
            }
        }
    }
}

#[test]
fn only_what_keeps_the_contract_loses_nothing_to_the_tree() {
    let mut lost = [0; Intersector::ALL.len()];
    let mut asked = 0;
    for seed in 0..20 {
        for family in [Family::Soup, Family::Slivers, Family::Sticks, Family::Far, Family::Lattice] {
            let mesh = Recipe { family, size: 300, seed }.mesh();
            let mut scene = scene(cpu(), &mesh, Intersector::Strict);
            let rays = rays(&mesh, scene.tree().unwrap().view(), 2000, seed);
            asked += rays.len();
            for (lost, &intersector) in lost.iter_mut().zip(Intersector::ALL) {
                scene.intersect_by(intersector).unwrap();
                let [closest, _, brute] = trace(&scene, &rays).unwrap();
                *lost += closest.iter().zip(&brute).filter(|(a, b)| a != b).count();
            }
        }
    }
    println!("hits that differ from brute force, of {asked} rays: {:?} {lost:?}", Intersector::ALL);
    assert_eq!(lost[..2], [0, 0]);
    // The least of them by the last one, whose `t` are about right wherever it finds a hit.
    assert!(lost[2..5].iter().all(|&n| n > 0), "{lost:?}");
}

#[test]
fn the_contracts_rules_hold_for_all() {
    let corner = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
    let turned = [corner[0], corner[2], corner[1]];
    let above = corner.map(|[x, y, z]: [f32; 3]| [x, y, z + 1.0]);
    let positions = [above, turned, corner, corner].concat();
    let mesh = Mesh::new(positions, (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()).unwrap();
    let ray = Ray::new([1.0, 1.0, 0.5], [0.0, 0.0, -1.0]);
    let range = |t_min, t_max| Ray { t_min, t_max, ..ray };
    let at = |x: f32, y: f32| Ray { origin: [x, y, 0.5], ..ray };
    let found =
        [ray, range(0.5, 0.5), range(-1.0, 0.0), at(0.0, 0.0), at(4.0, 0.0), at(2.0, 2.0), at(0.0, 1.0)];
    let missed = [
        range(0.5f32.next_up(), 9.0),
        range(-0.25, 0.5f32.next_down()),
        at(-0.001, 1.0),
        at(2.001, 2.0),
        Ray::new([-1.0, 1.0, 0.0], [1.0, 0.0, 0.0]),
        Ray { direction: [0.0; 3], ..ray },
        Ray { direction: [f32::NAN, 0.0, 1.0], ..ray },
    ];
    for &intersector in Intersector::ALL {
        for device in [cpu(), gpu()] {
            let scene = scene(device, &mesh, intersector);
            let ids = |rays: &[Ray]| {
                let [closest, _, brute] = trace(&scene, rays).unwrap();
                same(intersector.name(), &closest, &brute).unwrap();
                closest.iter().map(|hit| hit.triangle).collect::<Vec<_>>()
            };
            assert_eq!(ids(&found), [1, 1, 0, 1, 1, 1, 1], "{intersector}");
            assert!(ids(&missed).iter().all(|&id| id == raykd::shared::MISS), "{intersector}");
            let hit = scene.closest(&[Ray { origin: [1.0, 2.0, 0.5], ..ray }]).unwrap()[0];
            assert_eq!((hit.t, hit.u, hit.v), (0.5, 0.5, 0.25), "{intersector}");
        }
    }
}

#[test]
fn tests_that_do_not_go_together_with_a_query_are_refused() {
    let mesh = Mesh::teapot(1);
    let rays = raykd::rays::random(mesh.bounds(), 10, 1);
    let told = |error: raykd::Error| {
        let message = error.to_string();
        assert!(message.contains("works with the traversals stack and brute"), "{message}");
    };
    let mut scene = scene(cpu(), &mesh, Intersector::Woop);
    told(scene.traverse_by(Traversal::Ropes).unwrap_err());
    assert_eq!(scene.traversal(), Traversal::Stack);
    told(scene.all(&rays, 1).unwrap_err());
    told(scene.steps(&rays).unwrap_err());
    told(scene.trace_except(Query::Closest, &rays, &[0; 10]).unwrap_err());
    scene.traverse_by(Traversal::Brute).unwrap();
    let brute = scene.closest(&rays).unwrap();
    same("brute force", &brute, &scene.brute(&rays).unwrap()).unwrap();
    scene.intersect_by(Intersector::Strict).unwrap();
    scene.traverse_by(Traversal::Ropes).unwrap();
    told(scene.intersect_by(Intersector::Baldwin).unwrap_err());
    assert_eq!(scene.intersector(), Intersector::Strict);
}

#[test]
fn a_test_taken_for_another_is_found() {
    let mesh = icosphere(2);
    let [_, seams] = aimed(&mesh, 10);
    let on_gpu = |&intersector: &Intersector| scene(gpu(), &mesh, intersector).closest(&seams).unwrap();
    let all: Vec<_> = Intersector::ALL.iter().map(on_gpu).collect();
    for (i, a) in all.iter().enumerate() {
        for b in &all[..i] {
            same("hits", a, b).unwrap_err();
        }
    }
}
