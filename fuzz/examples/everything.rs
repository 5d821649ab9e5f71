//! Everything that a CPU runs, on several threads: for sanitizers, which slow a program down too much for the tests.
//!
//! ```text
//! export RUSTFLAGS="-Zsanitizer=thread -Cunsafe-allow-abi-mismatch=sanitizer"
//! cargo +nightly run --release --target x86_64-unknown-linux-gnu --example everything
//! ```
//!
//! The same with `address`. ThreadSanitizer does not see how the standard library and rayon make threads wait, so it
//! reports what the host frees or reads after a dispatch. A race of kernels is a report both of whose accesses are
//! kernels'.

use raykd::{
    BuildOptions, Builder, Device, Hit, Intersector, Mesh, Query, Scene, Traversal,
    internals::Cpu,
    rays::{self, Camera},
};
use std::thread;

/// Same bytes?
fn same(what: &str, a: &[Hit], b: &[Hit]) {
    assert!(bytemuck::cast_slice::<_, u8>(a) == bytemuck::cast_slice::<_, u8>(b), "{what}");
}

fn main() {
    let device = &Device::from(Cpu::with_threads(4).expect("threads"));
    // Several chunks in the level loop, several workgroups of rays.
    for mesh in [&Mesh::teapot(5), &Mesh::teapot(1)] {
        let rays = &rays::random(mesh.bounds(), 1000, 1);
        let mut expected = None;
        for &builder in Builder::ALL {
            let options = BuildOptions::default().with_builder(builder);
            let mut scene = Scene::build(device, mesh, &options).expect("it builds");
            let tree = scene.tree().expect("it is read");
            tree.validate().expect("it is valid");
            if builder == Builder::Exact {
                let kernels = Scene::sweep_by_kernels(device, mesh, &options, 5).expect("it builds");
                assert_eq!(kernels.tree().expect("it is read"), tree);
            }
            let expected = &*expected.get_or_insert_with(|| scene.brute(rays).expect("it traces"));
            for &traversal in Traversal::ALL {
                scene.traverse_by(traversal).expect("it fits");
                same(traversal.name(), &scene.closest(rays).expect("it traces"), expected);
            }
            scene.traverse_by(Traversal::Stack).expect("it fits");
            scene.steps(rays).expect("it traces");
            scene.all(rays, 3).expect("it traces");
            scene.trace_except(Query::Any, rays, &vec![3; rays.len()]).expect("it traces");
            for &intersector in Intersector::ALL {
                scene.intersect_by(intersector).expect("it fits");
                same(
                    intersector.name(),
                    &scene.closest(rays).expect("it traces"),
                    &scene.brute(rays).expect("it traces"),
                );
                scene.any(rays).expect("it traces");
            }
            scene.intersect_by(Intersector::Strict).expect("it fits");
            // One scene, asked by several threads.
            let scene = &scene;
            thread::scope(|scope| {
                for _ in 0..3 {
                    scope.spawn(move || same("beside", &scene.closest(rays).expect("it traces"), expected));
                }
            });
            println!("{} triangles, {builder:?}: done", mesh.kept().len());
        }
    }
    many(&Device::from(Cpu::with_threads(1).expect("threads")));
    many(device);
}

/// Enough rays for each thread that they share workgroups and are put in order, of each kind: together, apart, on one
/// another.
fn many(device: &Device) {
    let mesh = &Mesh::teapot(5);
    let scene = Scene::build(device, mesh, &BuildOptions::default()).expect("it builds");
    let primary = Camera::framing(mesh.bounds()).rays(300, 300);
    let hits = scene.closest(&primary).expect("it traces");
    let bounces = rays::bounces(mesh, &primary, &hits, 1);
    let random = rays::random(mesh.bounds(), 70_000, 1);
    for intersector in [Intersector::Strict, Intersector::Exact] {
        let mut scene = scene.clone();
        scene.intersect_by(intersector).expect("it fits");
        for rays in [&primary, &bounces, &random] {
            // Few are asked one by one.
            let (closest, all) =
                (scene.closest(rays).expect("it traces"), scene.all(rays, 9).expect("it traces"));
            for i in (0..rays.len()).step_by(97) {
                same("alone", &closest[i..=i], &scene.closest(&rays[i..=i]).expect("it traces"));
                assert_eq!(all.of(i).first().is_some_and(Hit::is_hit), closest[i].is_hit());
            }
            let except: Vec<u32> = closest.iter().map(|hit| hit.triangle).collect();
            scene.trace_except(Query::Closest, rays, &except).expect("it traces");
            for query in [Query::Closest, Query::Any] {
                scene.resident(rays).expect("it fits").trace(query).expect("it traces");
            }
            scene.any(rays).expect("it traces");
            scene.crossings(rays).expect("it traces");
        }
    }
    let points: Vec<[f32; 3]> = random.iter().map(|ray| ray.origin.map(|x| 0.5 * x)).collect();
    scene.winding(&points).expect("it traces");
    // Enough for winding numbers of cells to pay.
    scene.winding(&points).expect("it traces");
    scene.contacts(mesh).expect("it traces");
    println!("many rays: done");
}
