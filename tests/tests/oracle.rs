//! The kernels against exact arithmetic on the numbers as given.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Device, Hit, Mesh, Ray, Scene,
    stress::{SLACK, is_ray, settled},
};
use raykd_oracle::{Oracle, judge::Fault};
use raykd_tests::{
    Failure, cases, cpu, gpu,
    meshes::{Family, RANDOM, Recipe, ZOO, icosphere, small_mesh, traceable_mesh},
    rays::{of_any_size, rays},
    same,
};

/// The first answer that is not exact for triangles moved by what [`SLACK`] allows.
fn judge(mesh: &Mesh, rays: &[Ray], hits: &[Hit], slack: f64) -> Result<(), (Fault, String)> {
    // By their numbers, which those without area keep.
    let oracle = Oracle::new(mesh.positions(), mesh.triangles());
    for (ray, hit) in rays.iter().zip(hits) {
        let ray = settled(ray);
        if is_ray(&ray) {
            let crossings = oracle.crossings(&ray);
            let reach = oracle.reach(ray.origin);
            // Farther away than raykd takes rays.
            if reach * f64::from(mesh.scale()) < f64::from(1 << 30)
                && let Some(fault) = oracle.judge(&ray, &crossings, hit, slack * reach)
            {
                return Err((fault, format!("{ray:?}: {hit:?}, exactly {:?}", crossings.first())));
            }
        } else if hit.is_hit() {
            return Err((Fault::Invented, format!("{ray:?}: {hit:?}")));
        }
    }
    Ok(())
}

/// Traces rays of all kinds and judges what they hit.
fn judge_hits(device: &Device, recipe: &Recipe, seed: u64) -> Result<(), Failure> {
    let mesh = recipe.mesh();
    let scene = Scene::build(device, &mesh, &BuildOptions::default())?;
    let mut rays = rays(&mesh, scene.tree()?.view(), 300, seed);
    rays.extend(of_any_size(&rays, seed));
    let hits = scene.closest(&rays)?;
    same("by brute force", &hits, &scene.brute(&rays)?)?;
    judge(&mesh, &rays, &hits, SLACK)
        .map_err(|(fault, told)| Failure(format!("{recipe:?}: {fault:?}, {told}")))
}

proptest! {
    #![proptest_config(cases(256))]
    /// Whatever the mesh and the ray.
    #[test]
    fn hits_are_exact_but_for_rounding(recipe in small_mesh(), seed: u64) {
        judge_hits(cpu(), &recipe, seed)?;
    }
}

proptest! {
    #![proptest_config(cases(16))]
    #[test]
    fn hits_of_a_gpu_too(recipe in traceable_mesh(), seed: u64) {
        judge_hits(gpu(), &recipe, seed)?;
    }
}

/// The judge sees every kind of wrong answer, in every family that has hits.
#[test]
fn planted_faults_are_seen() {
    for family in RANDOM.into_iter().chain(ZOO) {
        let mesh = Recipe { family, size: 100, seed: 3 }.mesh();
        let scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
        let rays = rays(&mesh, scene.tree().unwrap().view(), 1000, 4);
        let hits = scene.closest(&rays).unwrap();
        judge(&mesh, &rays, &hits, SLACK).unwrap();
        if !hits.iter().any(Hit::is_hit) {
            continue;
        }
        type Plant = fn(&Hit) -> Hit;
        let plants: [(Fault, Plant); 2] = [
            (Fault::Missed, |_| Hit::NONE),
            (Fault::Misplaced, |hit| Hit { t: hit.t * 1.01 + 1e-30, ..*hit }),
        ];
        for (fault, plant) in plants {
            // Narrower than rounding: a miss may be right.
            if family == Family::Slivers && fault == Fault::Missed {
                continue;
            }
            let plant = |hit: &Hit| if hit.is_hit() { plant(hit) } else { *hit };
            let wrong: Vec<Hit> = hits.iter().map(plant).collect();
            let seen = rays.iter().zip(&wrong).filter(|(ray, hit)| {
                judge(&mesh, &[**ray], &[**hit], SLACK).is_err_and(|(found, _)| found == fault)
            });
            assert!(seen.count() > 0, "{family:?}: {fault:?} is never seen");
        }
    }
}

/// The bound of frame.rs is not idle: with a thirtieth of it there are answers outside.
#[test]
fn rounding_is_there() {
    let mesh = icosphere(2);
    let scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
    let rays = rays(&mesh, scene.tree().unwrap().view(), 20_000, 4);
    let hits = scene.closest(&rays).unwrap();
    judge(&mesh, &rays, &hits, SLACK).unwrap();
    judge(&mesh, &rays, &hits, SLACK / 30.0).unwrap_err();
}

/// From outside a closed mesh a ray that touches no edge hits an even number of triangles.
#[test]
fn parity_of_closed_meshes() {
    let mesh = icosphere(3);
    for device in [cpu(), gpu()] {
        let scene = Scene::build(device, &mesh, &BuildOptions::default()).unwrap();
        let rays: Vec<Ray> = raykd::rays::random(mesh.bounds(), 4000, 7);
        let all = scene.all(&rays, 4).unwrap();
        let mut counted = 0;
        for (i, (ray, &total)) in rays.iter().zip(&all.totals).enumerate() {
            let w = |hit: &Hit| 1.0 - hit.u - hit.v;
            let inside = |hit: &&Hit| [hit.u, hit.v, w(hit)].iter().all(|&x| x > 1e-6);
            if all.of(i).iter().filter(inside).count() == total as usize {
                assert_eq!(total % 2, 0, "{ray:?}");
                counted += usize::from(total > 0);
            }
        }
        assert!(counted > 2000, "{counted}");
    }
}
