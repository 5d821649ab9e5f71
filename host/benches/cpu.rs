//! Builds and traces of small scenes on the CPU: `cargo bench --bench cpu`; `-- --save-baseline NAME` and
//! `-- --baseline NAME` compare two commits.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use raykd::{BuildOptions, Builder, Device, Mesh, Query, Scene, Traversal, internals::usual_rays};

fn builds(criterion: &mut Criterion) {
    let (device, mesh) = (Device::cpu(), Mesh::teapot(16));
    let mut group = criterion.benchmark_group("build");
    group.throughput(Throughput::Elements(mesh.triangles().len() as u64));
    for &builder in Builder::ALL {
        let options = BuildOptions::default().with_builder(builder);
        group.bench_function(builder.name(), |bench| {
            bench.iter(|| Scene::build(&device, &mesh, &options).expect("a small build"));
        });
    }
    group.finish();
}

fn traces(criterion: &mut Criterion) {
    let (device, mesh) = (Device::cpu(), Mesh::teapot(16));
    let mut scene = Scene::build(&device, &mesh, &BuildOptions::default()).expect("a small build");
    let rays = usual_rays(&mesh, 1 << 14, |rays| scene.closest(rays)).expect("a small picture");
    let mut group = criterion.benchmark_group("trace");
    group.throughput(Throughput::Elements(rays.len() as u64));
    for traversal in Traversal::ALL.iter().copied().filter(|&traversal| traversal != Traversal::Brute) {
        scene.traverse_by(traversal).expect("a small tree");
        let mut resident = scene.resident(&rays).expect("few rays");
        group.bench_function(BenchmarkId::new("closest", traversal), |bench| {
            bench.iter(|| resident.trace(Query::Closest).expect("a trace"));
        });
    }
    group.finish();
}

criterion_group! {
    name = cpu;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_secs(2));
    targets = builds, traces
}
criterion_main!(cpu);
