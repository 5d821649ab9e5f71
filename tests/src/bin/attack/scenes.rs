//! Hostile meshes by every builder, traversal and test, against brute force and an integer oracle.

use crate::harness::{Case, Good, Tally, holds};
use raykd::{
    BuildOptions, Builder, Device, Hit, Intersector, Mesh, Query, Ray, Scene, Traversal,
    internals::Cpu,
    stress::{SLACK, is_ray, settled},
};
use raykd_oracle::{Oracle, exact::Exact};
use raykd_tests::{
    meshes::{RANDOM, Recipe, ZOO},
    rays::rays,
};

/// Meshes of each family.
const SEEDS: u64 = 24;
/// Rays at each.
const RAYS: usize = 40;

pub(crate) fn cases() -> Vec<Case> {
    let families = RANDOM.into_iter().chain(ZOO);
    families
        .flat_map(|family| {
            (0..SEEDS).map(move |seed| Recipe {
                family,
                size: [3, 20, 60, 200][seed as usize % 4],
                seed: 1000 + seed,
            })
        })
        .map(|recipe| Case::many(format!("scene/{recipe:?}"), move |tally| hostile(recipe, tally)))
        .collect()
}

fn hostile(recipe: Recipe, tally: &mut Tally) {
    let device = Device::from(Cpu::with_threads(1).expect("a thread"));
    let mesh = recipe.mesh();
    let build = |builder| Scene::build(&device, &mesh, &BuildOptions::default().with_builder(builder));
    let mut scene = build(Builder::Binned).expect("a CPU builds it");
    let tree = scene.tree().expect("a CPU has it");
    let rays = rays(&mesh, tree.view(), RAYS, recipe.seed);
    let brute = scene.brute(&rays).expect("a CPU traces");
    let same = |hits: Vec<Hit>| {
        let other = hits.iter().zip(&brute).position(|(a, b)| bytemuck::bytes_of(a) != bytemuck::bytes_of(b));
        holds(hits.len() == brute.len() && other.is_none(), || {
            let at = other.unwrap_or(0);
            format!("{:?} where brute force finds {:?}, {:?}", hits.get(at), brute.get(at), rays.get(at))
        })
        .map(|()| Good::Right)
    };
    tally.attempt("brute force against the oracle", || {
        let oracle = Oracle::new(mesh.positions(), mesh.triangles());
        let count = mesh.triangles().len();
        rays.iter().zip(&brute).try_for_each(|(ray, hit)| judge(&oracle, count, ray, hit, mesh.scale()))?;
        Ok(Good::Right)
    });
    for &builder in Builder::ALL {
        tally.attempt(builder.name(), || {
            let scene = build(builder).map_err(|e| e.to_string())?;
            same(scene.closest(&rays).map_err(|e| e.to_string())?)
        });
    }
    for &traversal in Traversal::ALL {
        tally.attempt(traversal.name(), || {
            scene.traverse_by(traversal).map_err(|e| e.to_string())?;
            same(scene.closest(&rays).map_err(|e| e.to_string())?)
        });
    }
    let back = scene.traverse_by(Traversal::Stack).map_err(|e| e.to_string());
    tally.attempt("any", || {
        back?;
        let any = scene.trace(Query::Any, &rays).map_err(|e| e.to_string())?.hits;
        let differs = any.iter().zip(&brute).position(|(a, b)| a.is_hit() != b.is_hit());
        holds(differs.is_none(), || format!("{differs:?}: any and closest hits disagree"))?;
        Ok(Good::Right)
    });
    tally.attempt("all", || {
        let all = scene.all(&rays, 3).map_err(|e| e.to_string())?;
        same((0..rays.len()).map(|i| all.of(i).first().copied().unwrap_or(Hit::NONE)).collect())
    });
    for traversal in [Traversal::Stack, Traversal::Brute] {
        tally.attempt(&format!("exact, {traversal}"), || {
            scene
                .traverse_by(traversal)
                .and_then(|()| scene.intersect_by(Intersector::Exact))
                .map_err(|e| e.to_string())?;
            let hits = scene.closest(&rays).map_err(|e| e.to_string())?;
            for (ray, hit) in rays.iter().zip(&hits) {
                if let Some(expected) = exactly(ray, &mesh) {
                    let right = bytemuck::bytes_of(hit) == bytemuck::bytes_of(&expected);
                    holds(right, || format!("{hit:?} where integers say {expected:?}, {ray:?}"))?;
                }
            }
            Ok(Good::Right)
        });
    }
}

/// Whether a hit of the default test is right; `scale` is what the mesh is multiplied with.
fn judge(oracle: &Oracle, triangles: usize, ray: &Ray, hit: &Hit, scale: f32) -> Result<(), String> {
    let ray = settled(ray);
    let reach = oracle.reach(ray.origin);
    if !is_ray(&ray) || reach * f64::from(scale) >= f64::from(1 << 30) {
        let near = reach * f64::from(scale) < f64::from(1u32 << 31);
        return holds(!hit.is_hit() || (is_ray(&ray) && near), || {
            format!("{ray:?} is invalid and hit {hit:?}")
        });
    }
    let known = !hit.is_hit() || (hit.triangle as usize) < triangles;
    holds(known, || format!("{hit:?} of {triangles} triangles"))?;
    let crossings = oracle.crossings(&ray);
    match oracle.judge(&ray, &crossings, hit, SLACK * reach) {
        None => Ok(()),
        Some(fault) => Err(format!("{fault:?}: {hit:?} for {:?}, {ray:?}", crossings.first())),
    }
}

/// The exact closest hit, rounded; nothing where numbers so large or small are met that the contract has rows for them,
/// or a range ends between `t` and what it is rounded to.
fn exactly(ray: &Ray, mesh: &Mesh) -> Option<Hit> {
    let usual = |x: f32| x == 0.0 || (1e-9..1e9).contains(&x.abs());
    let scaled = |x: &f32| usual(*x * mesh.scale());
    let ends = [ray.t_min, ray.t_max].into_iter().all(|t| usual(t) || t.is_infinite());
    let known =
        is_ray(ray) && ray.origin.iter().all(scaled) && ray.direction.iter().all(|&x| usual(x)) && ends;
    if !known || mesh.repairs().flushed > 0 || !mesh.positions().as_flattened().iter().all(scaled) {
        return None;
    }
    let mut best: Option<Hit> = None;
    for (number, triangle) in mesh.triangles().iter().enumerate() {
        let exact = Exact::new(ray, &triangle.map(|v| mesh.positions()[v as usize]));
        if !exact.inside() {
            continue;
        }
        let [t, u, v] = exact.rounded();
        let within = exact.is_in_range(ray);
        if !usual(t) {
            return None;
        }
        if within && best.is_none_or(|best| t < best.t) {
            best = Some(Hit { t, triangle: number as u32, u, v });
        }
    }
    Some(best.unwrap_or(Hit::NONE))
}
