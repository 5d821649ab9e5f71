//! Rays that leave a surface: what they hit if nothing is done, if the triangle they start on is left out, and if their
//! origin is moved.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Hit, Mesh, Query, Ray, Scene,
    rays::{Random, facing_normal, offset_origin},
    shared::MISS,
};
use raykd_tests::{
    cases, cpu, devices,
    meshes::{icosphere, small_mesh},
    one_by_one::OneByOne,
    rays::rays,
    same,
};

proptest! {
    #![proptest_config(cases(64))]
    #[test]
    fn leaving_one_out_finds_the_best_of_the_others(recipe in small_mesh(), seed: u64, count in 1usize..200) {
        let mesh = recipe.mesh();
        let scene = Scene::build(cpu(), &mesh, &BuildOptions::default())?;
        let rays = rays(&mesh, scene.tree()?.view(), count, seed);
        // Mostly the one that would be hit, so that it matters.
        let closest = scene.closest(&rays)?;
        let excluded: Vec<u32> = closest
            .iter()
            .enumerate()
            .map(|(i, hit)| if i % 5 == 0 { (i % mesh.triangles().len()) as u32 } else { hit.triangle })
            .collect();
        let oracle = OneByOne::new(&mesh, scene.header());
        let others = |i: usize| {
            let mut hits = oracle.all(&rays[i]);
            hits.retain(|hit| hit.triangle != excluded[i]);
            hits
        };
        let expected: Vec<Hit> =
            (0..count).map(|i| others(i).first().copied().unwrap_or(Hit::NONE)).collect();
        let mut any_hits = None;
        for named in devices() {
            let scene = Scene::build(&named.device, &mesh, &BuildOptions::default())?;
            let found = scene.trace_except(Query::Closest, &rays, &excluded)?;
            same(&format!("closest hits by {}", named.name), &expected, &found.hits)?;
            let any = scene.trace_except(Query::Any, &rays, &excluded)?.hits;
            same(&format!("any hits by {}", named.name), any_hits.get_or_insert(any.clone()), &any)?;
            for (i, hit) in any.iter().enumerate() {
                let others = others(i);
                let right = others.contains(hit) || (!hit.is_hit() && others.is_empty());
                prop_assert!(right, "{hit:?} of {others:?}");
            }
            let nothing = vec![MISS; count];
            same("none left out", &closest, &scene.trace_except(Query::Closest, &rays, &nothing)?.hits)?;
        }
    }
}

#[test]
fn as_many_triangles_as_rays_are_asked_for() {
    let mesh = Mesh::teapot(1);
    let scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
    let rays = raykd::rays::random(mesh.bounds(), 3, 1);
    let error = scene.trace_except(Query::Any, &rays, &[0]).unwrap_err().to_string();
    assert!(error.contains("3 rays with 1 triangles"), "{error}");
}

/// A ray that left a convex mesh, and where it started.
struct Start {
    ray: Ray,
    triangle: u32,
    normal: [f32; 3],
    /// Where it was aimed: 0 inside the triangle, 1 at an edge, 2 at a vertex.
    kind: usize,
    /// Not within a hundredth of an edge, and not nearly along the surface.
    clear: bool,
}

/// Rays from points of a convex mesh outward, in all directions of the hemisphere; the points are hits, rounded. A
/// third of them lies on edges, a third on vertices.
fn starts(mesh: &Mesh, rounds: usize) -> Vec<Start> {
    let scene = Scene::build(cpu(), mesh, &BuildOptions::default()).unwrap();
    let (lo, hi) = mesh.bounds();
    let centre: [f32; 3] = [0, 1, 2].map(|i| f32::midpoint(lo[i], hi[i]));
    let size = hi[0] - lo[0];
    let mut random = Random::new(3);
    let mut seen = Vec::new();
    for _ in 0..rounds {
        for triangle in mesh.triangles() {
            let corners = triangle.map(|v| mesh.positions()[v as usize]);
            let [s, t] = [(); 2].map(|()| random.unit() as f32);
            for [u, v] in [[s * (1.0 - t), t], [s, 0.0], [0.0, 0.0]] {
                let point =
                    [0, 1, 2].map(|i| corners[0][i] * (1.0 - u - v) + corners[1][i] * u + corners[2][i] * v);
                let from = [0, 1, 2].map(|i| centre[i] + 3.0 * size * (random.unit() as f32 - 0.5));
                seen.push(Ray::new(from, [0, 1, 2].map(|i| point[i] - from[i])));
            }
        }
    }
    let hits = scene.closest(&seen).unwrap();
    let mut starts = Vec::new();
    for (i, (ray, hit)) in seen.iter().zip(&hits).enumerate().filter(|(_, (_, hit))| hit.is_hit()) {
        let normal = facing_normal(mesh, ray, hit).unwrap().map(f64::from);
        let corner = mesh.positions()[mesh.triangles()[hit.triangle as usize][0] as usize];
        let outward = (0..3).map(|i| normal[i] * f64::from(corner[i] - centre[i])).sum::<f64>() > 0.0;
        // Rays from inside see the mesh from there.
        let normal = normal.map(|x| if outward { x } else { -x });
        let way = [(); 3].map(|()| random.unit() - 0.5);
        let rise: f64 = (0..3).map(|i| normal[i] * way[i]).sum();
        let direction = way.map(|x| (if rise < 0.0 { -x } else { x }) as f32);
        let length = way.map(|x| x * x).iter().sum::<f64>().sqrt();
        let margin = hit.u.min(hit.v).min(1.0 - hit.u - hit.v);
        let origin = [0, 1, 2].map(|i| ray.origin[i] + hit.t * ray.direction[i]);
        starts.push(Start {
            ray: Ray::new(origin, direction),
            triangle: hit.triangle,
            normal: normal.map(|x| x as f32),
            kind: i % 3,
            clear: margin > 0.01 && rise.abs() > 0.1 * length,
        });
    }
    starts
}

/// False hits per million rays that leave a convex mesh, which hit nothing: from inside triangles, from edges, and from
/// vertices.
fn false_hits(starts: &[Start], hits: &[Hit]) -> [f64; 3] {
    let mut counts = [[0u32; 2]; 3];
    for (start, hit) in starts.iter().zip(hits) {
        let [all, wrong] = &mut counts[start.kind];
        *all += 1;
        *wrong += u32::from(hit.is_hit());
    }
    counts.map(|[all, wrong]| f64::from(wrong) * 1e6 / f64::from(all))
}

#[test]
fn a_ray_that_leaves_a_convex_mesh_hits_nothing_but_neighbours() {
    for (name, by, size) in
        [("icosphere", 0.0, 1.0), ("icosphere, moved by 100", 100.0, 1.0), ("large", 0.0, 1000.0)]
    {
        let plain = icosphere(3);
        let moved = plain.positions().iter().map(|p| p.map(|x| x * size + by)).collect();
        let mesh = Mesh::new(moved, plain.triangles().to_vec()).unwrap();
        let scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
        let starts = starts(&mesh, 40);
        let rays: Vec<Ray> = starts.iter().map(|start| start.ray).collect();
        let own: Vec<u32> = starts.iter().map(|start| start.triangle).collect();
        let lifted = starts.iter().map(|s| Ray { origin: offset_origin(s.ray.origin, s.normal), ..s.ray });
        let lifted: Vec<Ray> = lifted.collect();
        let plain = scene.closest(&rays).unwrap();
        let except = scene.trace_except(Query::Closest, &rays, &own).unwrap().hits;
        let offset = scene.closest(&lifted).unwrap();
        for (start, hit) in starts.iter().zip(&except).filter(|(_, hit)| hit.is_hit()) {
            assert_ne!(hit.triangle, start.triangle);
            let corners = |t: u32| mesh.triangles()[t as usize];
            let neighbours = corners(hit.triangle).iter().any(|v| corners(start.triangle).contains(v));
            assert!(neighbours && !start.clear, "{name}: {hit:?} from {:?}", start.ray);
        }
        let told = [plain, except, offset].map(|hits| false_hits(&starts, &hits));
        println!(
            "{name}, {} rays, false hits per million from faces, edges, vertices: {told:.0?}",
            rays.len()
        );
        let [plain, except, offset] = told;
        assert!(plain[0] > 4e5, "{name}: {plain:?}");
        assert!(except[0] < plain[0] / 1e3, "{name}: {except:?}");
        assert!((1..3).all(|kind| except[kind] > 0.0 && except[kind] < plain[kind]), "{name}: {except:?}");
        assert!(offset == [0.0; 3], "{name}: {offset:?}");
    }
}

#[test]
fn a_moved_origin_passes_over_what_is_near_and_a_left_out_triangle_does_not() {
    // Two walls a millionth apart.
    let wall = |z: f32| [[-2.0, -2.0, z], [2.0, -2.0, z], [0.0, 2.0, z]];
    let mesh = Mesh::new([wall(1.0), wall(1.000_001)].concat(), vec![[0, 1, 2], [3, 4, 5]]).unwrap();
    let scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
    let up = Ray::new([0.1, 0.2, 1.0], [0.0, 0.0, 1.0]);
    let ids = |hits: Vec<Hit>| hits[0].triangle;
    assert_eq!(ids(scene.closest(&[up]).unwrap()), 0);
    assert_eq!(ids(scene.trace_except(Query::Closest, &[up], &[0]).unwrap().hits), 1);
    let moved = Ray { origin: offset_origin(up.origin, [0.0, 0.0, 1.0]), ..up };
    assert_eq!(ids(scene.closest(&[moved]).unwrap()), MISS);
}

#[test]
fn origins_move_to_the_side_of_the_normal() {
    let mut random = Random::new(8);
    for _ in 0..10_000 {
        let point = [(); 3].map(|()| ((random.unit() - 0.5) * 10f64.powf(random.unit() * 12.0 - 6.0)) as f32);
        let normal = random.point();
        let moved = offset_origin(point, normal);
        for i in 0..3 {
            let (way, most) = (moved[i] - point[i], point[i].abs() * 2f32.powi(-15) + 2f32.powi(-16));
            assert!(way * normal[i] >= 0.0 && way.abs() <= most, "{point:?} {normal:?} {moved:?}");
            assert!(way != 0.0 || normal[i].abs() < 0.004 || point[i].abs() < 2f32.powi(-5), "{moved:?}");
        }
    }
}
