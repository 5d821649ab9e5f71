//! One ray at a time: the same bytes as the batch, by nothing but the ray's own thread.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Device, Hit, Intersector, Mesh, Query, Ray, Scene, Tracer,
    rays::{Random, Ray64},
    single::{LeafTriangle, Tree, lay_out},
};
use raykd_tests::{Failure, cases, cpu, devices, gpu, meshes::traceable_mesh, rays::rays, same};
use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
    ops::ControlFlow,
};

thread_local! {
    static ALLOCATIONS: Cell<u32> = const { Cell::new(0) };
}

/// Counts what each thread takes.
struct Counting;

// SAFETY: all is the system's; counting takes no memory.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: as for the caller.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: as for the caller.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn closest(tracer: &Tracer, rays: &[Ray]) -> Vec<Hit> {
    rays.iter().map(|ray| tracer.closest(ray).unwrap_or(Hit::NONE)).collect()
}

fn some(tracer: &Tracer, rays: &[Ray]) -> Vec<Hit> {
    rays.iter().map(|ray| tracer.any(ray).unwrap_or(Hit::NONE)).collect()
}

/// Every hit of every ray.
fn all(tracer: &Tracer, rays: &[Ray]) -> Vec<Vec<Hit>> {
    let of = |ray: &Ray| {
        let mut hits = Vec::new();
        let end = tracer.for_each_hit(ray, |hit| {
            hits.push(hit);
            ControlFlow::<()>::Continue(())
        });
        assert!(end.expect("it finds all hits").is_continue());
        hits
    };
    rays.iter().map(of).collect()
}

/// By [`Scene::tracer`], and by `raykd-shared` and `raykd-kernels` alone.
fn as_the_batch(mesh: &Mesh, seed: u64) -> Result<(), Failure> {
    let scene = Scene::build(cpu(), mesh, &BuildOptions::default())?;
    let tree = scene.tree()?;
    let view = tree.view();
    let rays = rays(mesh, view, 300, seed);
    let tracer = scene.tracer()?;
    let expected = scene.closest(&rays)?;
    same("closest", &expected, &closest(&tracer, &rays))?;
    same("any", &scene.any(&rays)?, &some(&tracer, &rays))?;
    let few = &rays[..rays.len().min(60)];
    let batch = scene.all(few, u32::MAX)?;
    for (i, hits) in all(&tracer, few).iter().enumerate() {
        same("all", batch.of(i), hits)?;
    }

    let mut leaves = vec![LeafTriangle::default(); view.refs.len()];
    lay_out(view, mesh.positions(), mesh.triangles(), &mut leaves).expect("a valid tree");
    let walker = Tree::new(view, &leaves).expect("a valid tree");
    let found: Vec<Hit> = rays.iter().map(|ray| walker.closest(ray).unwrap_or(Hit::NONE)).collect();
    same("without the library", &expected, &found)?;
    if let Some((_, fewer)) = leaves.split_last_mut() {
        assert!(Tree::new(view, fewer).is_none() && lay_out(view, &[], mesh.triangles(), fewer).is_none());
        assert!(lay_out(view, &[], mesh.triangles(), &mut leaves).is_none());
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(96))]

    #[test]
    fn single_rays_find_the_bytes_of_the_batch(recipe in traceable_mesh(), seed in any::<u64>()) {
        as_the_batch(&recipe.mesh(), seed)?;
    }
}

#[test]
fn every_triangle_test_goes_for_single_rays() -> Result<(), Failure> {
    let mesh = Mesh::teapot(4);
    let mut scene = Scene::build(cpu(), &mesh, &BuildOptions::default())?;
    let rays = rays(&mesh, scene.tree()?.view(), 300, 8);
    for &test in Intersector::ALL {
        scene.intersect_by(test)?;
        let tracer = scene.tracer()?;
        same(test.name(), &scene.closest(&rays)?, &closest(&tracer, &rays))?;
        same(test.name(), &scene.any(&rays)?, &some(&tracer, &rays))?;
    }
    Ok(())
}

/// Wherever the scene is, and whichever threads ask.
#[test]
fn scenes_of_all_devices_give_the_same_tracer() -> Result<(), Failure> {
    let mesh = Mesh::teapot(6);
    let rays = raykd::rays::random(mesh.bounds(), 4000, 3);
    let expected = Scene::build(cpu(), &mesh, &BuildOptions::default())?.closest(&rays)?;
    assert!(expected.iter().any(Hit::is_hit) && !expected.iter().all(Hit::is_hit));
    for named in devices() {
        let tracer = Scene::build(&named.device, &mesh, &BuildOptions::default())?.tracer()?;
        let parts: Vec<Vec<Hit>> = std::thread::scope(|scope| {
            let of = |part| {
                scope.spawn({
                    let tracer = tracer.clone();
                    move || closest(&tracer, part)
                })
            };
            let threads: Vec<_> = rays.chunks(1000).map(of).collect();
            threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
        });
        same(named.name, &expected, &parts.concat())?;
    }
    Ok(())
}

#[test]
fn a_single_ray_takes_no_memory() -> Result<(), Failure> {
    let mesh = Mesh::teapot(6);
    let tracer = Scene::build(cpu(), &mesh, &BuildOptions::default())?.tracer()?;
    let rays = raykd::rays::random(mesh.bounds(), 1000, 3);
    let before = ALLOCATIONS.with(Cell::get);
    let mut hits = 0;
    for ray in &rays {
        hits += u32::from(tracer.closest(ray).is_some()) + u32::from(tracer.any(ray).is_some());
        let _ = tracer.for_each_hit(ray, |_| {
            hits += 1;
            ControlFlow::<()>::Continue(())
        });
    }
    assert_eq!(ALLOCATIONS.with(Cell::get), before, "{hits} hits");
    assert!(hits > 1000);
    drop(vec![1u8; 100]);
    assert!(ALLOCATIONS.with(Cell::get) > before, "counts what is taken");
    Ok(())
}

#[test]
fn single_rays_are_moved_with_the_mesh() -> Result<(), Failure> {
    let far = [4.5e6, -2.25e6, 1.0e6];
    let teapot = Mesh::teapot(4);
    let at = |p: &[f32; 3]| [0, 1, 2].map(|k| f64::from(p[k]) + far[k]);
    let mesh = Mesh::from_f64(teapot.positions().iter().map(at).collect(), teapot.triangles().to_vec())
        .map_err(raykd::Error::from)?;
    let scene = Scene::build(cpu(), &mesh, &BuildOptions::default())?;
    let tracer = scene.tracer()?;
    let mut random = Random::new(5);
    let rays: Vec<Ray64> = (0..500)
        .map(|_| {
            let (from, to) = (random.point().map(|x| f64::from(x) * 8.0), random.point().map(f64::from));
            Ray64::new([0, 1, 2].map(|k| from[k] + far[k]), [0, 1, 2].map(|k| to[k] - from[k]))
        })
        .collect();
    let single: Vec<Hit> = rays.iter().map(|ray| tracer.closest(ray).unwrap_or(Hit::NONE)).collect();
    let batch = scene.trace(Query::Closest, &rays)?.hits;
    assert!(batch.iter().any(Hit::is_hit));
    same("moved", &batch, &single)
}

#[test]
fn all_hits_are_for_tests_that_keep_the_contract() {
    let mut scene =
        Scene::build(&Device::cpu(), &Mesh::teapot(2), &BuildOptions::default()).expect("a scene");
    scene.intersect_by(Intersector::Moeller).expect("it goes");
    let tracer = scene.tracer().expect("a tracer");
    let mut called = false;
    let refused = tracer.for_each_hit(&Ray::new([0.0; 3], [1.0; 3]), |_| {
        called = true;
        ControlFlow::Break(())
    });
    let told = refused.expect_err("it does not keep the contract").to_string();
    assert!(told.contains("a query for all hits needs exact or the default, strict"), "{told}");
    assert!(!called);
}

#[test]
fn a_tracer_outlives_its_scene() -> Result<(), Failure> {
    let (mesh, ray) = (Mesh::teapot(4), Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0]));
    for device in [cpu(), gpu()] {
        let scene = Scene::build(device, &mesh, &BuildOptions::default())?;
        let expected = scene.closest(&[ray])?[0];
        let tracer = scene.tracer()?;
        drop(scene);
        assert_eq!(tracer.closest(&ray), Some(expected));
    }
    Ok(())
}
