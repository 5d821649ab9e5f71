//! The whole trace: the same bytes on every device, and what brute force finds.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Builder, Hit, Intersector, Mesh, Query, Ray, Scene, Stepped,
    internals::kernels::math::ldexp, mesh::MeshSource,
};
use raykd_tests::{
    Failure, cases, cpu, devices, gpu,
    meshes::{Family, Recipe, traceable_mesh},
    one_by_one::OneByOne,
    rays::rays,
    same, unless_cut,
};

/// Traces on every device and compares with brute force.
fn trace_everywhere(mesh: &Mesh, options: &BuildOptions, seed: u64, count: usize) -> Result<(), Failure> {
    let reference = Scene::build(cpu(), mesh, options)?;
    let rays = rays(mesh, reference.tree()?.view(), count, seed);
    let expected = reference.brute(&rays)?;
    let name = |what: &str, device: &str, found: &[Hit]| {
        let first =
            expected.iter().zip(found).position(|(a, b)| bytemuck::bytes_of(a) != bytemuck::bytes_of(b));
        format!("{what} by {device}, for {:?}", first.map(|i| rays[i]))
    };
    let mut invalid = None;
    let mut any_hits = None;
    for named in devices() {
        let scene = Scene::build(&named.device, mesh, options)?;
        let closest = scene.trace(Query::Closest, &rays)?;
        same(&name("closest hits", named.name, &closest.hits), &expected, &closest.hits)?;
        let any = scene.trace(Query::Any, &rays)?;
        same(&format!("any hits by {}", named.name), any_hits.get_or_insert(any.hits.clone()), &any.hits)?;
        let counts = [closest.invalid, any.invalid];
        same(&format!("invalid rays by {}", named.name), invalid.get_or_insert(counts).as_slice(), &counts)?;
    }
    let brute = Scene::build(gpu(), mesh, options)?.brute(&rays)?;
    same(&name("brute force", "GPU", &brute), &expected, &brute)?;

    let oracle = OneByOne::new(mesh, reference.header());
    for ((ray, closest), any) in rays.iter().zip(&expected).zip(any_hits.iter().flatten()) {
        let fail =
            |what: &str| Err(Failure(format!("{what}: {any:?}, the closest being {closest:?}, for {ray:?}")));
        if any.is_hit() != closest.is_hit() {
            return fail("one of any and closest hits, the other misses");
        }
        if !any.is_hit() {
            continue;
        }
        if oracle.alone(ray, any.triangle) != Some(*any) {
            return fail("any hit is no hit of its triangle");
        }
        // Subnormal limits count as zero.
        let [t_min, t, t_max, closest_t] = [ray.t_min, any.t, ray.t_max, closest.t].map(|t| ldexp(t, 0));
        if !(t_min <= t && t <= t_max && closest_t <= t) {
            return fail("any hit is out of range");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(96))]
    #[test]
    fn every_device_finds_what_brute_force_finds(recipe in traceable_mesh(), seed: u64, count in 1usize..400) {
        trace_everywhere(&recipe.mesh(), &BuildOptions::default(), seed, count)?;
    }
}

proptest! {
    #![proptest_config(cases(64))]
    #[test]
    fn hits_do_not_depend_on_the_tree(
        recipe in traceable_mesh(), seed: u64, max_depth in 0u32..=48,
        cost_step in prop::sample::select(vec![0.0, 0.1, 1.0, 30.0]),
        cost_test in prop::sample::select(vec![0.1, 1.0, 30.0]),
        builder in prop::sample::select(vec![Builder::Median, Builder::Binned, Builder::Zhou]),
        clip: bool,
    ) {
        let mesh = recipe.mesh();
        let plain = Scene::build(cpu(), &mesh, &BuildOptions::default().with_clip(false))?;
        let rays = rays(&mesh, plain.tree()?.view(), 400, seed);
        let options = BuildOptions::default().with_cost_step(cost_step).with_cost_test(cost_test);
        let options = options.with_max_depth(max_depth).with_builder(builder).with_clip(clip);
        let other = Scene::build(cpu(), &mesh, &options)?;
        let hits = |scene: &Scene| scene.closest(&rays);
        same(&format!("hits with {options:?}"), &hits(&plain)?, &hits(&other)?)?;
    }

    #[test]
    fn counting_steps_changes_no_hit(recipe in traceable_mesh(), seed: u64) {
        let mesh = recipe.mesh();
        let mut counts = None;
        for named in devices() {
            let scene = Scene::build(&named.device, &mesh, &BuildOptions::default())?;
            let rays = rays(&mesh, scene.tree()?.view(), 200, seed);
            let Stepped { hits, steps, .. } = scene.steps(&rays)?;
            same(named.name, &scene.closest(&rays)?, &hits)?;
            same(&format!("steps by {}", named.name), counts.get_or_insert(steps.clone()), &steps)?;
        }
    }
}

proptest! {
    #![proptest_config(cases(24))]
    #[test]
    fn few_rays_lie_apart_and_get_the_same_answers(recipe in traceable_mesh(), seed: u64, count in 1usize..70) {
        let mesh = recipe.mesh();
        let build = |device| Scene::build(device, &mesh, &BuildOptions::default());
        let (mut on_cpu, mut on_gpu) = (build(cpu())?, build(gpu())?);
        for test in [Intersector::Strict, Intersector::Exact] {
            on_cpu.intersect_by(test)?;
            on_gpu.intersect_by(test)?;
            let rays = rays(&mesh, on_cpu.tree()?.view(), count, seed);
            let from: Vec<u32> = on_cpu.closest(&rays)?.iter().map(|hit| hit.triangle).collect();
            let ways: [(&str, Way<'_>); 6] = [
                ("closest", &|scene| scene.trace(Query::Closest, &rays).map(|t| (t.invalid, bytes(&t.hits)))),
                ("any", &|scene| scene.trace(Query::Any, &rays).map(|t| (t.invalid, bytes(&t.hits)))),
                ("except", &|scene| {
                    scene.trace_except(Query::Closest, &rays, &from).map(|t| (t.invalid, bytes(&t.hits)))
                }),
                ("all", &|scene| scene.all(&rays, 3).map(|all| (all.invalid, bytes(&all.hits)))),
                ("steps", &|scene| scene.steps(&rays).map(|found| (found.invalid, bytes(&found.steps)))),
                ("crossings", &|scene| scene.crossings(&rays).map(|c| (c.invalid, bytes(&c.counts)))),
            ];
            for (name, way) in ways {
                let (invalid, expected) = way(&on_cpu)?;
                if let Some((found_invalid, found)) = unless_cut(way(&on_gpu))? {
                    same(&format!("{name} by {test}"), &expected, &found)?;
                    prop_assert_eq!(invalid, found_invalid, "invalid rays, {} by {}", name, test);
                }
            }
        }
    }
}

/// Asks a scene something of some rays: how many were invalid, and the answers' bytes.
type Way<'a> = &'a dyn Fn(&Scene) -> Result<(u64, Vec<u8>), raykd::Error>;

fn bytes(answers: &[impl bytemuck::Pod]) -> Vec<u8> {
    bytemuck::cast_slice(answers).to_vec()
}

#[test]
fn random_rays_at_the_teapot_agree_everywhere() {
    let mesh = Mesh::teapot(8);
    let rays = raykd::rays::random(mesh.bounds(), 5000, 1);
    let mut expected = None;
    for named in devices() {
        let scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
        let hits = scene.closest(&rays).unwrap();
        same(named.name, expected.get_or_insert_with(|| scene.brute(&rays).unwrap()), &hits).unwrap();
        assert!(hits.iter().filter(|hit| hit.is_hit()).count() > 1000);
    }
}

/// A GPU traces a million rays at a time, by two threads of the host.
#[test]
fn a_gpu_traces_millions_of_rays_in_their_order() {
    const RAYS: usize = (2 << 20) + 12_345;
    // A square, folded along its diagonal: nearly every ray hits, and no two alike.
    let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.1], [0.0, 1.0, 0.0]];
    let mesh = Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
    let some = raykd::rays::random(mesh.bounds(), 9973, 5);
    let none = Ray { direction: [0.0; 3], ..some[0] };
    // A length that no part is a multiple of, so each part has other rays.
    let rays: Vec<Ray> =
        (0..RAYS).map(|i| if i % 1_000_003 == 7 { none } else { some[i % some.len()] }).collect();
    let scene = |device| Scene::build(device, &mesh, &BuildOptions::default()).unwrap();
    let (by_cpu, by_gpu) = (scene(cpu()), scene(gpu()));
    for query in [Query::Closest, Query::Any] {
        let [cpu, gpu] = [&by_cpu, &by_gpu].map(|scene| scene.trace(query, &rays).unwrap());
        same("hits", &cpu.hits, &gpu.hits).unwrap();
        assert_eq!([cpu.invalid, gpu.invalid], [3, 3]);
        assert!(cpu.hits.iter().filter(|hit| hit.is_hit()).count() > RAYS / 2);
    }
    // Fewer come back at once, but in more than one piece of a transfer.
    let fewer = &rays[..600_000];
    let [cpu, gpu] = [&by_cpu, &by_gpu].map(|scene| scene.closest(fewer).unwrap());
    same("hits of fewer rays", &cpu, &gpu).unwrap();
    let excluded: Vec<u32> = (0..RAYS as u32).map(|i| i % 7).collect();
    let [cpu, gpu] =
        [&by_cpu, &by_gpu].map(|scene| scene.trace_except(Query::Closest, &rays, &excluded).unwrap());
    same("hits of other triangles", &cpu.hits, &gpu.hits).unwrap();
}

#[test]
fn no_rays_give_no_hits() {
    for named in devices() {
        let mesh = Mesh::teapot(1);
        let scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
        assert!(scene.closest(&[] as &[Ray]).unwrap().is_empty());
        assert!(scene.brute(&[] as &[Ray]).unwrap().is_empty());
    }
}

/// Mesa's software rasteriser ends all loops of an invocation after 65,535 rounds in total.
#[test]
fn a_driver_that_ends_loops_early_gives_an_error_and_no_wrong_hit() {
    let teapot = Mesh::teapot(33);
    assert!(teapot.kept().len() > 65_535);
    let flat = Recipe { family: Family::Flat, size: 3169, seed: 233_791_990_276_647_821 }.mesh();
    let one_leaf = Recipe { family: Family::Identical, size: 70_000, seed: 1 }.mesh();
    for mesh in [teapot, flat, one_leaf] {
        let scenes =
            [cpu(), gpu()].map(|device| Scene::build(device, &mesh, &BuildOptions::default()).unwrap());
        let tree = scenes[0].tree().unwrap();
        let rays = rays(&mesh, tree.view(), 200, 3_075_607_215_347_662_595);
        let Stepped { hits: expected, steps: counts, .. } = scenes[0].steps(&rays).unwrap();
        let error = |e: raykd::Error| assert!(e.to_string().contains("cut a long loop short"), "{e}");
        let check = |what, found: Result<Vec<Hit>, _>| {
            found.map_or_else(error, |f| same(what, &expected, &f).unwrap())
        };
        check("brute force", scenes[1].brute(&rays));
        check("closest", scenes[1].closest(&rays));
        scenes[1].steps(&rays).map_or_else(error, |Stepped { hits, steps, .. }| {
            check("hits with steps", Ok(hits));
            same("steps", &counts, &steps).unwrap();
        });
    }
}

/// Prints what tracing takes by the clock on the wall, from rays of the host to hits of the host, on the scene that
/// `RAYKD_SCENE` names, else on the dragon.
#[test]
#[ignore = "a measurement: cargo test --release --workspace --test hits times_ -- --ignored --nocapture"]
fn times_of_few_rays() {
    const ROUNDS: usize = 41;
    let name = std::env::var("RAYKD_SCENE").unwrap_or_else(|_| "dragon".to_owned());
    let mesh = name.parse::<MeshSource>().unwrap().load().unwrap();
    let scene = Scene::build(gpu(), &mesh, &BuildOptions::default()).unwrap();
    println!("{name}, {}; random rays, medians of {ROUNDS}", gpu().name());
    for count in [1, 1000, 30_000, 300_000] {
        let rays = raykd::rays::random(mesh.bounds(), count, 5);
        // The first rounds wake the card.
        let times = (0..ROUNDS + 10).map(|_| {
            let start = std::time::Instant::now();
            let hits = scene.closest(&rays).unwrap();
            assert_eq!(hits.len(), count);
            start.elapsed()
        });
        let mut times: Vec<_> = times.skip(10).collect();
        times.sort_unstable();
        println!("{count:8} rays {:6.3} ms", times[ROUNDS / 2].as_secs_f64() * 1e3);
    }
}
