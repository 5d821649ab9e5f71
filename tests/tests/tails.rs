//! What a single ray may cost, and a build that cannot part its triangles.

use raykd::{
    BuildOptions, Builder, Mesh, Ray, Scene,
    rays::{Random, random},
    stress::{
        cases::CASES,
        shapes::{Point, loose},
    },
};
use raykd_tests::{Failure, cpu};

/// Builders that go by the surface area heuristic.
const BY_COST: [Builder; 2] = [Builder::Binned, Builder::Exact];

fn built(mesh: &Mesh, builder: Builder) -> Result<Scene<'static>, Failure> {
    Ok(Scene::build(cpu(), mesh, &BuildOptions { builder, ..BuildOptions::default() })?)
}

/// A teapot about a unit large in the middle of a box and a few triangles so many times larger.
fn stadium(ratio: f32) -> Mesh {
    let teapot = Mesh::teapot(8);
    let corners = |t: &[u32; 3]| t.map(|v| teapot.positions()[v as usize]);
    let mut triangles: Vec<[Point; 3]> = teapot.triangles().iter().map(corners).collect();
    let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|bit| (2.0 * bit as f32 - 1.0) * ratio);
    for [a, b, c, d] in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
        triangles.extend([[a, b, c].map(corner), [a, c, d].map(corner)]);
    }
    let mut random = Random::new(1);
    let far = |r: &mut Random| r.point().map(|x| x * ratio);
    triangles.extend((0..8).map(|_| [far(&mut random), far(&mut random), [0.0, -ratio, 0.0]]));
    loose(&triangles)
}

/// From the stadium's box at points of the teapot, and all around it.
fn looking(mesh: &Mesh, ratio: f32, n: usize) -> Vec<Ray> {
    let mut r = Random::new(2);
    let mut rays = random(mesh.bounds(), n / 2, 3);
    rays.extend((0..n / 2).map(|i| {
        let from = r.point().map(|x| x * if i % 2 == 0 { ratio } else { 4.0 });
        let at = r.point().map(|x| x * 1.5);
        Ray::new(from, [0, 1, 2].map(|k| at[k] - from[k]))
    }));
    rays
}

/// Half, 99, 99.9 and 99.99 % of the counts are at most so large, and all.
fn percentiles(counts: &mut [u32]) -> [u32; 5] {
    counts.sort_unstable();
    [0.5, 0.99, 0.999, 0.9999, 1.0].map(|share| counts[((counts.len() - 1) as f64 * share) as usize])
}

#[test]
fn meshes() -> Result<(), Failure> {
    for builder in [Builder::Binned, Builder::Exact, Builder::Zhou] {
        for path in std::env::var("MESHES").unwrap_or_default().split(' ').filter(|p| !p.is_empty()) {
            let recipe = |family, size: &str| raykd_tests::meshes::Recipe { family, size: size.parse().unwrap(), seed: 7 }.mesh();
            let mesh = if path == "teapot" { Mesh::teapot(10) } else if let Some(n) = path.strip_prefix("slivers:") { recipe(raykd_tests::meshes::Family::Slivers, n) } else if let Some(n) = path.strip_prefix("sticks:") { recipe(raykd_tests::meshes::Family::Sticks, n) } else if let Some(n) = path.strip_prefix("fan:") { recipe(raykd_tests::meshes::Family::Fan, n) } else { Mesh::load(path.as_ref()).expect("a mesh") };
            let start = std::time::Instant::now();
            let scene = built(&mesh, builder)?;
            let wall = start.elapsed();
            let tree = scene.tree()?;
            let report = tree.validate()?;
            println!(
                "{} {} {} {} {:.4} tests {:.4} {} {} {} {:.1?} wall {wall:.1?} retries {} peak {}",
                path.rsplit('/').next().unwrap(), builder.name(), tree.view().header.nodes, tree.view().header.refs, report.sah_cost,
                report.expected_tests, report.depth, report.largest_leaf, &tree.digest()[..10],
                scene.times().build, scene.times().retries, scene.times().peak_bytes
            );
        }
    }
    Ok(())
}

#[test]
fn measure() -> Result<(), Failure> {
    for builder in BY_COST {
        for ratio in [1.0e2, 1.0e4, 1.0e6, 1.0e10] {
            let mesh = stadium(ratio);
            let scene = built(&mesh, builder)?;
            let report = scene.tree()?.validate()?;
            let (_, steps) = scene.steps(&looking(&mesh, ratio, 50_000))?;
            let mut tests: Vec<u32> = steps.iter().map(|s| s.tests).collect();
            println!(
                "{builder:?} stadium {ratio:e}: {} tris, leaf {}, depth {}, refs {}, tests {:?}",
                mesh.kept().len(),
                report.largest_leaf,
                report.depth,
                scene.header().refs,
                percentiles(&mut tests)
            );
        }
        let (mut all, mut all_steps) = (Vec::new(), Vec::new());
        for case in &CASES {
            for part in case.parts(4000) {
                let scene = built(&part.mesh, builder)?;
                let report = scene.tree()?.validate()?;
                let (_, steps) = scene.steps(&part.rays)?;
                let mut tests: Vec<u32> = steps.iter().map(|s| s.tests).collect();
                let mut inner: Vec<u32> = steps.iter().map(|s| s.inner + s.leaves).collect();
                all.extend_from_slice(&tests);
                all_steps.extend_from_slice(&inner);
                if tests.is_empty() { continue; }
                println!(
                    "{builder:?} {} {}: {} tris, leaf {}, depth {}, refs {:.2}, tests {:?} steps {:?}",
                    case.name,
                    part.name,
                    part.mesh.kept().len(),
                    report.largest_leaf,
                    report.depth,
                    f64::from(scene.header().refs) / part.mesh.kept().len().max(1) as f64,
                    percentiles(&mut tests),
                    percentiles(&mut inner),
                );
            }
        }
        println!("{builder:?} ALL: {} rays, tests {:?}, steps {:?}", all.len(), percentiles(&mut all), percentiles(&mut all_steps));
    }
    Ok(())
}
