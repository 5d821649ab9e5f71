//! Scenes that are asked by tasks of rayon, whose threads take up other tasks while they wait.

use raykd::{BuildOptions, Device, Hit, Mesh, Ray, Scene};
use raykd_tests::gpu;
use rayon::{ThreadPoolBuilder, prelude::*};
use std::{
    sync::{LazyLock, mpsc::channel},
    thread,
    time::Duration,
};

/// A scene of one triangle, and rays that hit it. From now on rayon has two threads, but for pools of one's own.
fn on_few_threads(device: impl FnOnce() -> Device, rays: usize) -> (Scene, Vec<Ray>) {
    static POOL: LazyLock<()> =
        LazyLock::new(|| ThreadPoolBuilder::new().num_threads(2).build_global().expect("nobody has used it"));
    LazyLock::force(&POOL);
    let mesh = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]).unwrap();
    let ray = Ray::new([0.1, 0.1, 1.0], [0.0, 0.0, -1.0]);
    (Scene::build(&device(), &mesh, &BuildOptions::default()).unwrap(), vec![ray; rays])
}

/// Fails if `work` takes more than a minute: it hangs.
fn within_a_minute(work: impl FnOnce() + Send + 'static) {
    let (done, told) = channel();
    thread::spawn(move || {
        work();
        done.send(()).unwrap();
    });
    told.recv_timeout(Duration::from_secs(60)).expect("it hangs, or has failed");
}

#[test]
fn tasks_ask_a_gpu() {
    let (scene, rays) = on_few_threads(|| gpu().clone(), 100_000);
    within_a_minute(move || {
        ThreadPoolBuilder::new().num_threads(4).build().unwrap().install(|| {
            for _ in 0..400 {
                (0..5).into_par_iter().with_max_len(1).for_each(|_| drop(scene.resident(&rays).unwrap()));
            }
            (0..20).into_par_iter().with_max_len(1).for_each(|_| {
                assert!(scene.closest(&rays).unwrap().iter().all(Hit::is_hit));
            });
        });
    });
}

/// Many rays are moved by two threads, of which one is a task's own.
#[test]
fn tasks_ask_a_gpu_for_many_hits() {
    let (scene, rays) = on_few_threads(|| gpu().clone(), 3 << 20);
    within_a_minute(move || {
        (0..2).into_par_iter().with_max_len(1).for_each(|_| {
            assert!(scene.closest(&rays).unwrap().iter().all(Hit::is_hit));
        });
    });
}

/// If a thread that waits took up the next task, each would lie on its stack on top of the one before.
#[test]
fn tasks_ask_threads_of_a_devices_own() {
    let (scene, rays) = on_few_threads(|| Device::cpu_with_threads(2).unwrap(), 3000);
    within_a_minute(move || {
        rayon::scope(|scope| {
            for _ in 0..2000 {
                scope.spawn(|_| assert!(scene.closest(&rays).unwrap().iter().all(Hit::is_hit)));
            }
        });
    });
}

/// To start as many as rayon can would keep a machine busy for minutes.
#[test]
fn more_threads_than_any_machine_has_are_refused() {
    for threads in [1 << 16, usize::MAX] {
        let error = Device::cpu_with_threads(threads).unwrap_err().to_string();
        assert!(error.contains(&threads.to_string()) && error.contains("ask for"), "{error}");
    }
}
