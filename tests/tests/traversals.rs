//! Every traversal and every query: the same bytes on CPU and GPU, and what brute force finds.

use proptest::prelude::*;
use raykd::{BuildOptions, Hit, Intersector, Mesh, Query, Ray, RaySteps, Scene, Stepped, Traversal};
use raykd_tests::{
    Failure, cases, cpu, gpu,
    meshes::{Family, RANDOM, Recipe, ZOO, icosphere, small_mesh, traceable_mesh},
    one_by_one::OneByOne,
    rays::rays,
    same, unless_cut,
};

/// Scenes of the same mesh on CPU and GPU.
fn both(mesh: &Mesh, options: &BuildOptions) -> Result<[Scene; 2], Failure> {
    Ok([Scene::build(cpu(), mesh, options)?, Scene::build(gpu(), mesh, options)?])
}

/// Traces by every traversal on CPU and GPU, and compares with brute force.
fn traverse_everywhere(mesh: &Mesh, options: &BuildOptions, seed: u64, count: usize) -> Result<(), Failure> {
    let mut scenes = both(mesh, options)?;
    let rays = rays(mesh, scenes[0].tree()?.view(), count, seed);
    let expected = scenes[0].brute(&rays)?;
    let oracle = OneByOne::new(mesh, scenes[0].header());
    for &traversal in Traversal::ALL {
        let (mut any_hits, mut counts) = (None, None);
        for scene in &mut scenes {
            scene.traverse_by(traversal)?;
            let device = scene.device().kind();
            let tell = |what: &str, found: &[Hit]| {
                let mut pairs = expected.iter().zip(found);
                let first = pairs.position(|(a, b)| bytemuck::bytes_of(a) != bytemuck::bytes_of(b));
                format!("{what} by {traversal} on the {device}, for {:?}", first.map(|i| rays[i]))
            };
            let Some(Stepped { hits, steps, .. }) = unless_cut(scene.steps(&rays))? else { continue };
            same(&tell("closest hits", &hits), &expected, &hits)?;
            same(&format!("steps of {traversal}"), counts.get_or_insert(steps.clone()), &steps)?;
            let closest = scene.trace(Query::Closest, &rays)?.hits;
            same(&tell("closest hits, uncounted,", &closest), &expected, &closest)?;
            let any = scene.trace(Query::Any, &rays)?.hits;
            same(&format!("any hits of {traversal}"), any_hits.get_or_insert(any.clone()), &any)?;
        }
        for ((ray, closest), any) in rays.iter().zip(&expected).zip(any_hits.iter().flatten()) {
            let right = if any.is_hit() { oracle.alone(ray, any.triangle) == Some(*any) } else { true };
            if any.is_hit() != closest.is_hit() || !right {
                let what =
                    format!("any hit {any:?} of {traversal}, the closest being {closest:?}, for {ray:?}");
                return Err(Failure(what));
            }
        }
    }
    Ok(())
}

/// Finds all hits on CPU and GPU, and compares with those of all triangles one by one; also closest hits with counts of
/// steps, and those that are left when the closest triangle is left out.
fn all_everywhere(mesh: &Mesh, seed: u64, count: usize, test: Intersector) -> Result<(), Failure> {
    let mut scenes = both(mesh, &BuildOptions::default())?;
    scenes.iter_mut().try_for_each(|scene| scene.intersect_by(test))?;
    let rays = rays(mesh, scenes[0].tree()?.view(), count, seed);
    let oracle = OneByOne::new(mesh, scenes[0].header()).by(test);
    let expected: Vec<Vec<Hit>> = rays.iter().map(|ray| oracle.all(ray)).collect();
    let totals: Vec<u32> = expected.iter().map(|hits| hits.len() as u32).collect();
    for scene in &scenes {
        let device = scene.device().kind();
        for limit in [0, 1, 3, 8, 9, 40, u32::MAX] {
            let Some(found) = unless_cut(scene.all(&rays, limit))? else { continue };
            same(&format!("numbers of hits on the {device}"), &totals, &found.totals)?;
            let first: Vec<Hit> =
                expected.iter().flat_map(|hits| hits.iter().copied().take(limit as usize)).collect();
            same(&format!("the first {limit} hits on the {device}"), &first, &found.hits)?;
            let of: Vec<&[Hit]> = (0..rays.len()).map(|i| found.of(i)).collect();
            let whose = expected.iter().map(|hits| &hits[..hits.len().min(limit as usize)]);
            assert!(whose.eq(of), "whose are the first {limit} hits on the {device}");
        }
        let nth = |n: usize| -> Vec<Hit> {
            expected.iter().map(|hits| hits.get(n).copied().unwrap_or(Hit::NONE)).collect()
        };
        let closest = nth(0);
        if let Some(Stepped { hits: found, steps, .. }) = unless_cut(scene.steps(&rays))? {
            same(&format!("closest hits with steps on the {device}"), &closest, &found)?;
            let tests = |(hit, steps): (&Hit, &RaySteps)| !hit.is_hit() || steps.tests > 0;
            assert!(found.iter().zip(&steps).all(tests), "a hit without a test on the {device}");
        }
        let excluded: Vec<u32> = closest.iter().map(|hit| hit.triangle).collect();
        if let Some(found) = unless_cut(scene.trace_except(Query::Closest, &rays, &excluded))? {
            same(&format!("hits of other triangles on the {device}"), &nth(1), &found.hits)?;
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(64))]
    #[test]
    fn every_traversal_finds_what_brute_force_finds(
        recipe in traceable_mesh(), seed: u64, count in 1usize..300, max_depth in prop::sample::select(vec![3, 48]),
        cost_step in prop::sample::select(vec![0.0, 1.0]),
    ) {
        // Free steps give the deepest trees and the thinnest leaves.
        let options = BuildOptions::default().with_max_depth(max_depth).with_cost_step(cost_step);
        traverse_everywhere(&recipe.mesh(), &options, seed, count)?;
    }

    #[test]
    fn all_hits_are_those_of_all_triangles(recipe in small_mesh(), seed: u64, count in 1usize..200) {
        all_everywhere(&recipe.mesh(), seed, count, Intersector::Strict)?;
    }

    #[test]
    fn all_exact_hits_are_those_of_all_triangles(recipe in small_mesh(), seed: u64, count in 1usize..100) {
        all_everywhere(&recipe.mesh(), seed, count, Intersector::Exact)?;
    }
}

#[test]
fn every_traversal_agrees_on_closed_meshes() {
    let lattice = Recipe { family: Family::Cubes, size: 300, seed: 4 }.mesh();
    for mesh in [icosphere(3), lattice, Mesh::teapot(3)] {
        traverse_everywhere(&mesh, &BuildOptions::default(), 7, 3000).unwrap();
        for test in [Intersector::Strict, Intersector::Exact] {
            all_everywhere(&mesh, 8, 500, test).unwrap();
        }
    }
}

#[test]
fn every_traversal_finds_nothing_where_nothing_is() {
    let mesh = Mesh::new(vec![[0.0; 3]; 3], vec![[0, 1, 2]]).unwrap();
    let mut scenes = both(&mesh, &BuildOptions::default()).unwrap();
    let rays = [Ray::new([0.0; 3], [1.0; 3]), Ray::new([f32::NAN; 3], [0.0; 3])];
    for &traversal in Traversal::ALL {
        for scene in &mut scenes {
            scene.traverse_by(traversal).unwrap();
            for query in [Query::Closest, Query::Any] {
                let traced = scene.trace(query, &rays).unwrap();
                assert_eq!((traced.hits, traced.invalid), (vec![Hit::NONE; 2], 1), "{traversal}");
            }
            assert_eq!(scene.steps(&rays).unwrap().hits, [Hit::NONE; 2], "{traversal}");
        }
    }
}

/// What a ray may cost at most: it goes forward in the order of leaves, and into each once.
#[test]
fn no_traversal_visits_a_leaf_twice() {
    for family in RANDOM.into_iter().chain(ZOO) {
        let mesh = Recipe { family, size: 200, seed: 9 }.mesh();
        let mut scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
        let tree = scene.tree().unwrap();
        let report = tree.validate().unwrap();
        let rays = rays(&mesh, tree.view(), 2000, 10);
        let mut most = 0;
        for traversal in Traversal::ALL.iter().copied().filter(|&t| t != Traversal::Brute) {
            scene.traverse_by(traversal).unwrap();
            let steps = scene.steps(&rays).unwrap().steps;
            // `wide` has leaves of its own, and lists each triangle once.
            let (leaves, tests) = match traversal {
                Traversal::Wide => (mesh.kept().len() as u32, mesh.kept().len() as u32),
                _ => (report.leaves, tree.view().header.refs),
            };
            for (ray, steps) in rays.iter().zip(steps) {
                assert!(steps.leaves <= leaves, "{family:?} by {traversal}: {steps:?}, {ray:?}");
                assert!(steps.tests <= tests, "{family:?} by {traversal}: {steps:?}, {ray:?}");
                most = most.max(steps.leaves);
            }
            if traversal == Traversal::Stack {
                let steps = scene.steps(&rays).unwrap().steps;
                assert!(steps.iter().all(|steps| steps.inner <= report.inner), "{family:?}");
            }
        }
        assert!(most > 1 || report.leaves == 1, "{family:?}: {most} leaves of {}", report.leaves);
    }
}

/// Mean inner nodes a ray of a traversal, and mean restarts.
fn mean_steps(scene: &mut Scene, traversal: Traversal, rays: &[raykd::Ray]) -> [f64; 2] {
    scene.traverse_by(traversal).unwrap();
    let steps = scene.steps(rays).unwrap().steps;
    let mean = |pick: fn(&raykd::RaySteps) -> u32| {
        steps.iter().map(|s| f64::from(pick(s))).sum::<f64>() / rays.len() as f64
    };
    [mean(|s| s.inner), mean(|s| s.turns)]
}

#[test]
fn steps_are_as_the_literature_says() {
    let mesh = Mesh::teapot(16);
    let mut scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
    let rays = raykd::rays::random(mesh.bounds(), 20_000, 3);
    let mut mean = |traversal| mean_steps(&mut scene, traversal, &rays);
    let [stack, _] = mean(Traversal::Stack);
    let [restart, _] = mean(Traversal::Restart);
    let [pushdown, _] = mean(Traversal::Pushdown);
    let [sequential, _] = mean(Traversal::Sequential);
    assert!(stack < pushdown && pushdown < restart && restart < sequential);
    let short =
        [Traversal::ShortStack1, Traversal::ShortStack2, Traversal::ShortStack4, Traversal::ShortStack8]
            .map(&mut mean);
    assert!(short.is_sorted_by(|a, b| a[0] >= b[0]), "{short:?}");
    assert!(short[2][0] <= stack * 1.03 + short[2][1], "{stack} {short:?}");
    let [optimised, _] = mean_steps(&mut scene, Traversal::OptimisedRopes, &rays);
    assert!(optimised < stack, "{optimised} {stack}");
}

#[test]
fn what_a_traversal_needs_is_made_once_and_counted() {
    let mesh = Mesh::teapot(2);
    let mut scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
    let nodes = u64::from(scene.header().nodes);
    let plain = scene.tree_bytes();
    let mut more = |traversal| {
        scene.traverse_by(traversal).unwrap();
        scene.tree_bytes() - plain
    };
    for _ in 0..2 {
        assert_eq!(more(Traversal::Restart), 0);
        assert_eq!(more(Traversal::Backtrack), nodes * 32);
        assert_eq!(more(Traversal::Ropes), nodes * 48 + (nodes * 2).next_multiple_of(16));
        assert_eq!(more(Traversal::OptimisedRopes), more(Traversal::Ropes));
        assert_eq!(more(Traversal::Stack), 0);
    }
}

#[test]
fn a_driver_that_ends_loops_early_gives_an_error_and_no_wrong_hit() {
    let flat = Recipe { family: Family::Flat, size: 3169, seed: 233_791_990_276_647_821 }.mesh();
    let one_leaf = Recipe { family: Family::Identical, size: 70_000, seed: 1 }.mesh();
    for mesh in [flat, one_leaf] {
        let mut scene = Scene::build(gpu(), &mesh, &BuildOptions::default()).unwrap();
        let reference = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
        let rays = rays(&mesh, reference.tree().unwrap().view(), 200, 3_075_607_215_347_662_595);
        let expected = reference.closest(&rays).unwrap();
        // By the other two, `hits.rs` traces the same rays at the same meshes.
        let others = |traversal: &&Traversal| ![Traversal::Stack, Traversal::Brute].contains(traversal);
        for &traversal in Traversal::ALL.iter().filter(others) {
            scene.traverse_by(traversal).unwrap();
            if let Some(found) = unless_cut(scene.closest(&rays)).unwrap() {
                same(traversal.name(), &expected, &found).unwrap();
            }
        }
    }
}
