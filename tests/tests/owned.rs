//! Devices, scenes and rays at home in other people's programs: in structs, statics and threads.

use raykd::{
    BuildOptions, Builder, Device, Error, Hit, KdTree, Mesh, Query, Ray, ResidentRays, Scene, Tracer,
    Traversal, World, internals::watch::watching, rays,
};
use raykd_tests::{devices, same};
use std::{sync::OnceLock, thread};

/// As a program would keep them: beside each other, and a scene for whoever asks.
struct App {
    device: Device,
    scene: Scene,
    rays: ResidentRays,
}

static ANYWHERE: OnceLock<Scene> = OnceLock::new();

fn mesh() -> Mesh {
    Mesh::teapot(3)
}

fn some_rays() -> Vec<Ray> {
    rays::random(mesh().bounds(), 2000, 5)
}

fn app(device: &Device) -> App {
    let scene = Scene::build(device, &mesh(), &BuildOptions::default()).unwrap();
    // Its mesh, and the borrow of the device, end here.
    App { device: device.clone(), rays: scene.resident(&some_rays()).unwrap(), scene }
}

fn expected() -> Vec<Hit> {
    Scene::build(&Device::cpu(), &mesh(), &BuildOptions::default()).unwrap().brute(&some_rays()).unwrap()
}

#[test]
fn everything_may_go_to_other_threads_and_be_seen_by_several() {
    fn check<T: Send + Sync + 'static>() {}
    check::<Device>();
    check::<Scene>();
    check::<ResidentRays>();
    check::<KdTree>();
    check::<Mesh>();
    check::<World>();
    check::<raykd::Error>();
}

/// On the CPU; tests of build_on do the same on a GPU.
#[test]
fn memory_used_again_shows_in_no_scene_and_no_tracer() {
    let fresh = Device::cpu();
    let device = fresh.recycling();
    let rays = some_rays();
    for builder in [Builder::Median, Builder::Zhou, Builder::Binned, Builder::Exact] {
        let options = BuildOptions::default().with_builder(builder);
        let mut old: Option<(Tracer, Vec<Option<Hit>>)> = None;
        for size in [5, 2, 6, 3, 1, 4, 4] {
            let mesh = Mesh::teapot(size);
            // On memory that starts as garbage, used again or not.
            let scene = watching(Box::new(|_, _| Ok(())), || Scene::build(&device, &mesh, &options)).unwrap();
            let usual = Scene::build(&fresh, &mesh, &options).unwrap();
            assert!(scene.tree().unwrap() == usual.tree().unwrap(), "{builder}, teapot {size}");
            let hits = scene.closest(&rays).unwrap();
            same(&format!("{builder}, teapot {size}"), &usual.brute(&rays).unwrap(), &hits).unwrap();
            // A tracer keeps the memory of a scene that is gone.
            let tracer = scene.tracer().unwrap();
            let found = |tracer: &Tracer| rays.iter().map(|ray| tracer.closest(ray)).collect();
            let now = found(&tracer);
            if let Some((tracer, before)) = old.replace((tracer, now)) {
                let after: Vec<_> = found(&tracer);
                assert!(after == before, "{builder}: the scene before teapot {size} changed");
            }
        }
    }
}

#[test]
fn a_scene_lives_beside_its_device_and_outlives_it() {
    let expected = expected();
    for named in devices() {
        let App { device, scene, mut rays } = thread::scope(|scope| {
            let made = scope.spawn(|| app(&named.device));
            made.join().unwrap()
        });
        drop(device);
        let hits = thread::spawn(move || scene.closest(&some_rays())).join().unwrap().unwrap();
        same(named.name, &expected, &hits).unwrap();
        // The scene is gone, but for what these rays keep of it.
        rays.trace(Query::Closest).unwrap();
        same(named.name, &expected, &rays.hits().unwrap()).unwrap();
    }
    let scene = ANYWHERE.get_or_init(|| app(&Device::cpu()).scene);
    same("static", &expected, &scene.closest(&some_rays()).unwrap()).unwrap();
}

#[test]
fn one_scene_is_traced_by_many_threads() {
    let expected = &expected();
    for named in devices() {
        let scene = &app(&named.device).scene;
        thread::scope(|scope| {
            for number in 0..4 {
                scope.spawn(move || {
                    // A clone goes its own way through the same tree.
                    let mut own = scene.clone();
                    own.traverse_by(Traversal::ALL[number]).unwrap();
                    let mut resident = own.resident(&some_rays()).unwrap();
                    for _ in 0..5 {
                        same(named.name, expected, &scene.closest(&some_rays()).unwrap()).unwrap();
                        resident.trace(Query::Closest).unwrap();
                        same(named.name, expected, &resident.hits().unwrap()).unwrap();
                    }
                });
            }
        });
    }
}

#[test]
fn rays_have_no_hits_before_they_are_traced() {
    for named in devices() {
        let mut rays = app(&named.device).rays;
        assert!(matches!(rays.hits(), Err(Error::Untraced)), "{}", named.name);
        assert!(matches!(rays.invalid(), Err(Error::Untraced)), "{}", named.name);
        rays.trace(Query::Any).unwrap();
        assert_eq!((rays.hits().unwrap().len(), rays.invalid().unwrap()), (2000, 0));
    }
}
