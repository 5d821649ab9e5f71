//! Rays side by side on a CPU: the same bytes as one by one, whatever goes together.

use std::{ops::ControlFlow, sync::OnceLock};

use proptest::prelude::*;
use raykd::{
    BuildOptions, Crossings, Device, Hit, Intersector, Mesh, Query, Ray, Scene,
    rays::{Camera, Random, bounces},
    stress::CASES,
};
use raykd_tests::{
    Failure, cases, cpu,
    meshes::{Family, Recipe, any_mesh, traceable_mesh},
    rays::{of_any_size, rays},
    same,
};

/// From each ray some that are like it, by more or less; every now and then one that is invalid or has another range.
fn crowds(rays: &[Ray], extent: f32, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let mut crowds = Vec::new();
    for ray in rays {
        let size = ray.direction.iter().fold(0.0f32, |most, d| most.max(d.abs()));
        let apart = extent * [0.0, 0.0, 1e-7, 1e-4, 0.02, 0.3][random.below(6)];
        let astray = size * [0.0, 1e-7, 1e-3, 0.1, 0.7, 3.0][random.below(6)];
        // A component that is 0 for all, a range of its own for each.
        let (flat, ranged) = (random.below(6), random.below(3) == 0);
        for _ in 0..1 + random.below(24) {
            let mut other = *ray;
            for axis in 0..3 {
                other.origin[axis] += apart * random.signed();
                other.direction[axis] += astray * random.signed();
            }
            if flat < 3 {
                other.direction[flat] = if random.below(2) == 0 { 0.0 } else { -0.0 };
            }
            if ranged {
                let at = 2.0 * random.unit() as f32;
                (other.t_min, other.t_max) =
                    [(at, f32::INFINITY), (0.0, at), (-at, at), (at, f32::MAX)][random.below(4)];
            }
            if random.below(24) == 0 {
                let odd = [f32::NAN, f32::INFINITY, 0.0, -0.0, 1e-40, 1e-25, 1e25][random.below(7)];
                match random.below(5) {
                    0 => other.direction = [odd; 3],
                    1 => other.origin[random.below(3)] = odd,
                    2 => other.t_min = odd,
                    3 => other.t_max = odd,
                    _ => other.direction[random.below(3)] = odd,
                }
            }
            crowds.push(other);
        }
    }
    crowds
}

/// Rays of as many workgroups go side by side at once as may.
fn one_thread() -> &'static Device {
    static DEVICE: OnceLock<Device> = OnceLock::new();
    DEVICE.get_or_init(|| Device::cpu_with_threads(1).expect("threads can be started"))
}

fn extent(mesh: &Mesh) -> f32 {
    let (lo, hi) = mesh.bounds();
    (0..3).map(|axis| hi[axis] - lo[axis]).fold(0.0, f32::max)
}

/// Compares the hits of a batch with those of its rays one by one, and crossings, too.
fn one_by_one(scene: &mut Scene, rays: &[Ray]) -> Result<(), Failure> {
    by_both_tests(scene, rays, hits_one_by_one)?;
    by_both_tests(scene, rays, all_hits_one_by_one)?;
    crossings_one_by_one(scene, rays)
}

/// By both triangle tests whose rays go side by side.
fn by_both_tests(
    scene: &mut Scene,
    rays: &[Ray],
    compare: impl Fn(&Scene, &[Ray]) -> Result<(), Failure>,
) -> Result<(), Failure> {
    for test in [Intersector::Exact, Intersector::Strict] {
        scene.intersect_by(test)?;
        compare(scene, rays).map_err(|e| Failure(format!("{}: {e}", test.name())))?;
    }
    Ok(())
}

fn hits_one_by_one(scene: &Scene, rays: &[Ray]) -> Result<(), Failure> {
    let tracer = scene.tracer()?;
    let alone = |hit: Option<Hit>| hit.unwrap_or(Hit::NONE);
    let closest: Vec<Hit> = rays.iter().map(|ray| alone(tracer.closest(ray))).collect();
    let any: Vec<Hit> = rays.iter().map(|ray| alone(tracer.any(ray))).collect();
    for (query, expected) in [(Query::Closest, &closest), (Query::Any, &any)] {
        let found = scene.trace(query, rays)?.hits;
        let differs = |i: &usize| bytemuck::bytes_of(&found[*i]) != bytemuck::bytes_of(&expected[*i]);
        let which = (0..rays.len()).find(differs).map(|i| rays[i]);
        same(&format!("{query:?} of {which:?}"), expected, &found)?;
    }
    Ok(())
}

/// Fewer than one walk finds, more, and all. A ray through thousands of equal triangles takes half a second: of those
/// with over 500 hits the first three.
fn all_hits_one_by_one(scene: &Scene, rays: &[Ray]) -> Result<(), Failure> {
    let tracer = scene.tracer()?;
    let (mut some, mut long) = (Vec::new(), 0);
    for ray in rays {
        let mut left = 500;
        let whole = tracer.for_each_hit(ray, |_| {
            left -= 1;
            if left < 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        long += u32::from(whole.is_break());
        if whole.is_continue() || long <= 3 {
            some.push(*ray);
        }
    }
    let rays = &some[..];
    let mut expected = vec![Vec::new(); rays.len()];
    for (ray, hits) in rays.iter().zip(&mut expected) {
        let _ = tracer.for_each_hit(ray, |hit| {
            hits.push(hit);
            ControlFlow::<()>::Continue(())
        })?;
    }
    let totals: Vec<u32> = expected.iter().map(|hits| hits.len() as u32).collect();
    for limit in [3, 11, u32::MAX] {
        let found = scene.all(rays, limit)?;
        same("how many hits rays have", &totals, &found.totals)?;
        let first = |hits: &[Hit]| hits[..hits.len().min(limit as usize)].to_vec();
        let differs = |i: &usize| first(&expected[*i]) != found.of(*i);
        let which = (0..rays.len()).find(differs).map(|i| rays[i]);
        let expected: Vec<Hit> = expected.iter().flat_map(|hits| first(hits)).collect();
        same(&format!("up to {limit} hits of {which:?}"), &expected, &found.hits)?;
    }
    Ok(())
}

fn crossings_one_by_one(scene: &Scene, rays: &[Ray]) -> Result<(), Failure> {
    let tracer = scene.tracer()?;
    let crossings: Vec<Crossings> = rays.iter().map(|ray| tracer.crossings(ray)).collect();
    let found = scene.crossings(rays)?.counts;
    let which = (0..rays.len()).find(|&i| found[i] != crossings[i]).map(|i| rays[i]);
    same(&format!("crossings of {which:?}"), &crossings, &found)
}

fn of_recipe(recipe: Recipe, seed: u64, count: usize) -> Result<(), Failure> {
    let mesh = recipe.mesh();
    let mut scene = Scene::build(one_thread(), &mesh, &BuildOptions::default())?;
    let bases = rays(&mesh, scene.tree()?.view(), count, seed);
    let crowds = crowds(&bases, extent(&mesh), seed);
    one_by_one(&mut scene, &crowds)?;
    one_by_one(&mut scene, &of_any_size(&crowds, seed))
}

proptest! {
    #![proptest_config(cases(256))]
    #[test]
    fn crowds_find_what_each_ray_finds(recipe in traceable_mesh(), seed: u64, count in 1usize..60) {
        of_recipe(recipe, seed, count)?;
    }
}

proptest! {
    #![proptest_config(cases(64))]
    #[test]
    fn crowds_in_any_mesh_find_what_each_ray_finds(recipe in any_mesh(), seed: u64) {
        of_recipe(recipe, seed, 20)?;
    }
}

/// Here any hits of the exact test were lost where a closer look, after a leaf, looked beyond the ray's end.
#[test]
fn crowds_whose_range_ends_at_their_origin_find_what_each_ray_finds() -> Result<(), Failure> {
    let cubes = Recipe { family: Family::Cubes, size: 25, seed: 15_463_236_057_447_235_726 };
    of_recipe(cubes, 11_744_356_560_266_184_006, 27)
}

/// Here an interval that began elsewhere than a single ray's showed in any hits.
#[test]
fn crowds_begin_in_far_children_where_single_rays_do() -> Result<(), Failure> {
    let far = Recipe { family: Family::Far, size: 4581, seed: 17_202_576_479_215_195_980 };
    of_recipe(far, 8_954_388_402_308_631_604, 6)?;
    let fan = Recipe { family: Family::Fan, size: 323, seed: 2_861_387_129_697_534_365 };
    of_recipe(fan, 5_442_200_541_861_752_951, 20)?;
    // And behind an empty leaf.
    let fan = Recipe { family: Family::Fan, size: 118, seed: 1_782_415_870_333_155_629 };
    of_recipe(fan, 13_333_680_396_026_225_962, 2)?;
    let wild = Recipe { family: Family::Wild, size: 226, seed: 9_976_298_145_784_343_851 };
    of_recipe(wild, 1_470_896_805_091_175_230, 20)
}

#[test]
fn crowds_in_stress_scenes_find_what_each_ray_finds() -> Result<(), Failure> {
    for case in CASES {
        for part in case.parts(150) {
            let mut scene = Scene::build(one_thread(), &part.mesh, &BuildOptions::default())?;
            let named = |e: Failure| Failure(format!("{} {}: {e}", case.name, part.name));
            let crowds = crowds(&part.rays, extent(&part.mesh), 7);
            // A ray that crosses thousands of equal triangles takes half a second.
            let some = if part.mesh.triangles().len() > 1000 { 8 } else { usize::MAX };
            for rays in [&part.rays, &crowds] {
                by_both_tests(&mut scene, rays, hits_one_by_one).map_err(named)?;
                let some = &rays[..rays.len().min(some)];
                by_both_tests(&mut scene, some, all_hits_one_by_one).map_err(named)?;
                crossings_one_by_one(&scene, some).map_err(named)?;
            }
        }
    }
    Ok(())
}

/// A picture, whose rays go side by side, and what bounces off, of which some do.
#[test]
fn pictures_are_the_same_as_pixel_by_pixel() -> Result<(), Failure> {
    let (teapot, ball) = (Mesh::teapot(6), raykd_tests::meshes::icosphere(4));
    for (device, mesh) in [(cpu(), &teapot), (one_thread(), &teapot), (one_thread(), &ball)] {
        let mut scene = Scene::build(device, mesh, &BuildOptions::default())?;
        let picture = Camera::framing(mesh.bounds()).rays(601, 397);
        one_by_one(&mut scene, &picture)?;
        let bounced = bounces(mesh, &picture, &scene.closest(&picture)?, 1);
        one_by_one(&mut scene, &bounced)?;
        // One thread puts so many in order.
        assert!(bounced.len() > 1 << 14, "{}", bounced.len());
        by_both_tests(&mut scene, &bounced, except_in_parts)?;
    }
    Ok(())
}

/// Compares hits but of a triangle each with those of few rays at a time.
fn except_in_parts(scene: &Scene, rays: &[Ray]) -> Result<(), Failure> {
    let excluded: Vec<u32> = scene.closest(rays)?.iter().map(|hit| hit.triangle).collect();
    for query in [Query::Closest, Query::Any] {
        let mut expected = Vec::new();
        for (rays, excluded) in rays.chunks(1000).zip(excluded.chunks(1000)) {
            expected.extend(scene.trace_except(query, rays, excluded)?.hits);
        }
        let found = scene.trace_except(query, rays, &excluded)?.hits;
        same(&format!("{query:?} but of a triangle each"), &expected, &found)?;
    }
    Ok(())
}

/// Corners and origins that are the same but for next to nothing, distances near 0, and numbers near the ends of what
/// goes side by side.
#[test]
fn crowds_at_the_ends_of_the_range_find_what_each_ray_finds() -> Result<(), Failure> {
    let mut random = Random::new(5);
    let mut near = move |size: i32| match random.below(4) {
        0 => 0.0,
        1 => [-1.0, 1.0, 0.5, -0.0][random.below(4)],
        _ => 2f32.powi(-(random.below(size as usize) as i32)) * random.signed(),
    };
    for seed in 0..40 {
        for power in [0, 39, -39, 24, -60] {
            let size = 2f32.powi(power);
            let mesh = Recipe { family: Family::Lattice, size: 12, seed }.mesh();
            let points: Vec<_> = mesh.positions().iter().map(|p| p.map(|x| x * size)).collect();
            let mesh = Mesh::new(points, mesh.triangles().to_vec()).unwrap();
            let mut scene = Scene::build(one_thread(), &mesh, &BuildOptions::default())?;
            let mut rays = Vec::new();
            for _ in 0..60 {
                let axis = rays.len() / 8 % 3;
                let mut origin = [near(60), near(80), near(80)].map(|x| x * size);
                let mut direction =
                    [1.0, near(50), near(50)].map(|x| x * 2f32.powi([0, 59, -59, 40][seed as usize % 4]));
                origin.rotate_left(axis);
                direction.rotate_left(axis);
                for _ in 0..8 {
                    origin[(axis + 1) % 3] = near(80) * size;
                    let t_min = if axis == 0 { f32::NEG_INFINITY } else { 0.0 };
                    rays.push(Ray { t_min, ..Ray::new(origin, direction) });
                }
            }
            one_by_one(&mut scene, &rays)?;
        }
    }
    Ok(())
}

/// At their origins: `t` is 0, which could be negative.
#[test]
fn crowds_that_start_on_a_triangle_find_what_each_ray_finds() -> Result<(), Failure> {
    let corners = [[0.0f32, 0.0, 0.0], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0]];
    for triangle in [[0, 1, 2], [0, 2, 1]] {
        for turn in 0..3 {
            let turned = |mut p: [f32; 3]| {
                p.rotate_left(turn);
                p
            };
            let mesh = Mesh::new(corners.iter().map(|&p| turned(p)).collect(), vec![triangle]).unwrap();
            let mut scene = Scene::build(one_thread(), &mesh, &BuildOptions::default())?;
            for way in [1.0, -1.0] {
                let ray = |i: u16| {
                    let at = 0.25 + 0.001 * f32::from(i);
                    Ray::new(turned([at, at, 0.0]), turned([0.01, 0.02, way]))
                };
                let rays: Vec<Ray> = (0..64).map(ray).collect();
                one_by_one(&mut scene, &rays)?;
                assert!(scene.closest(&rays)?.iter().all(|hit| hit.is_hit() && hit.t.to_bits() == 0));
            }
        }
    }
    Ok(())
}
