//! The contract of a trace, one test a sentence. Every answer is asked of every device and of brute force.

use raykd::{
    BuildOptions, Hit, Intersector, KdTree, Mesh, Query, Ray, Scene,
    internals::kernels::math::ldexp,
    rays::Random,
    shared::{Content, MISS},
};
use raykd_tests::{
    cpu, devices,
    meshes::{Family, RANDOM, Recipe, Welded, ZOO, icosphere, loose, moved},
    rays::rays,
    same,
};

/// The closest hits: the same on every device and, if asked for, by brute force.
fn trace(mesh: &Mesh, rays: &[Ray], brute: bool) -> Vec<Hit> {
    let mut hits: Option<Vec<Hit>> = None;
    for named in devices() {
        let scene = Scene::build(&named.device, mesh, &BuildOptions::default()).unwrap();
        let found = scene.closest(rays).unwrap();
        same(named.name, hits.get_or_insert_with(|| found.clone()), &found).unwrap();
        if brute {
            same(&format!("brute force by {}", named.name), &found, &scene.brute(rays).unwrap()).unwrap();
        }
        for (i, any) in scene.any(rays).unwrap().iter().enumerate() {
            assert_eq!(any.is_hit(), found[i].is_hit(), "any hit of {:?} by {}", rays[i], named.name);
        }
    }
    hits.unwrap()
}

fn hits(mesh: &Mesh, rays: &[Ray]) -> Vec<Hit> {
    trace(mesh, rays, true)
}

fn ids(mesh: &Mesh, rays: &[Ray]) -> Vec<u32> {
    hits(mesh, rays).iter().map(|hit| hit.triangle).collect()
}

/// One right triangle in the plane `z = 0`.
const CORNER: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

/// A ray straight down on `CORNER`'s plane.
fn down(x: f32, y: f32) -> Ray {
    Ray::new([x, y, 2.0], [0.0, 0.0, -1.0])
}

fn build(mesh: &Mesh) -> Scene {
    Scene::build(cpu(), mesh, &BuildOptions::default()).unwrap()
}

fn tree(mesh: &Mesh) -> KdTree {
    build(mesh).tree().unwrap()
}

fn every_recipe(size: u32) -> impl Iterator<Item = Recipe> {
    RANDOM.into_iter().chain(ZOO).map(move |family| Recipe { family, size, seed: 11 })
}

#[test]
fn triangles_are_closed_at_edges_and_vertices() {
    let mesh = loose(&[CORNER]);
    let on = [(0.0, 0.0), (4.0, 0.0), (0.0, 4.0), (1.0, 0.0), (0.0, 3.0), (2.0, 2.0), (1.0, 3.0), (1.0, 1.0)];
    assert_eq!(ids(&mesh, &on.map(|(x, y)| down(x, y))), [0; 8]);
    let off = [(-1e-6, 1.0), (1.0, -1e-6), (2.0, 2.000_001), (4.000_001, 0.0), (-1e-6, -1e-6)];
    assert_eq!(ids(&mesh, &off.map(|(x, y)| down(x, y))), [MISS; 5]);
}

#[test]
fn weights_of_the_corners_are_those_of_the_point() {
    let mesh = loose(&[CORNER]);
    let found = hits(&mesh, &[down(0.0, 0.0), down(4.0, 0.0), down(0.0, 4.0), down(1.0, 2.0)]);
    let weights: Vec<_> = found.iter().map(|hit| (hit.t, hit.u, hit.v)).collect();
    assert_eq!(weights, [(2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (2.0, 0.0, 1.0), (2.0, 0.25, 0.5)]);
}

#[test]
fn both_sides_of_a_triangle_are_hit() {
    let mesh = loose(&[CORNER]);
    assert_eq!(ids(&mesh, &[down(1.0, 1.0), Ray::new([1.0, 1.0, -2.0], [0.0, 0.0, 1.0])]), [0, 0]);
}

#[test]
fn t_min_and_t_max_are_inclusive() {
    let mesh = loose(&[CORNER]);
    let range = |t_min, t_max| Ray { t_min, t_max, ..down(1.0, 1.0) };
    let inf = f32::INFINITY;
    let inside = [(2.0, inf), (0.0, 2.0), (2.0, 2.0), (-inf, inf), (-1.0, f32::MAX)];
    assert_eq!(ids(&mesh, &inside.map(|(a, b)| range(a, b))), [0; 5]);
    let (above, below) = (2f32.next_up(), 2f32.next_down());
    let outside = [(above, inf), (0.0, below), (above, below), (3.0, 1.0), (inf, inf), (-inf, -inf)];
    assert_eq!(ids(&mesh, &outside.map(|(a, b)| range(a, b))), [MISS; 6]);
}

#[test]
fn the_smallest_range_that_leaves_out_zero_does() {
    // Scaled by the direction's exponent the limit would underflow; found on an H200 by random rays.
    let mesh = loose(&[CORNER]);
    let touching = Ray { origin: [1.0, 1.0, 0.0], direction: [0.0, 0.0, -0.25], ..down(1.0, 1.0) };
    let tiny = f32::MIN_POSITIVE;
    let ranges = [(0.0, 1.0), (tiny, 1.0), (-1.0, -tiny), (-1.0, 0.0)];
    let rays = ranges.map(|(t_min, t_max)| Ray { t_min, t_max, ..touching });
    assert_eq!(ids(&mesh, &rays), [0, MISS, MISS, 0]);
}

#[test]
fn a_range_that_ends_or_begins_at_a_hit_finds_it_again() {
    for recipe in every_recipe(300) {
        let mesh = recipe.mesh();
        let scene = build(&mesh);
        let rays = rays(&mesh, scene.tree().unwrap().view(), 2000, 5);
        let found = scene.closest(&rays).unwrap();
        let narrow = |change: fn(&mut Ray, f32)| {
            let changed = rays.iter().zip(&found).map(|(ray, hit)| {
                let mut ray = *ray;
                if hit.is_hit() {
                    change(&mut ray, hit.t);
                }
                ray
            });
            scene.closest(&changed.collect::<Vec<_>>()).unwrap()
        };
        same(&format!("{recipe:?}, up to the hit"), &found, &narrow(|ray, t| ray.t_max = t)).unwrap();
        same(&format!("{recipe:?}, from the hit on"), &found, &narrow(|ray, t| ray.t_min = t)).unwrap();
        // Numbers next to zero are so small that they count as zero.
        let short = narrow(|ray, t| ray.t_max = if t == 0.0 { -1.0 } else { t.next_down() });
        let again = short.iter().position(Hit::is_hit);
        assert_eq!(again, None, "{recipe:?}: {:?}", again.map(|i| (rays[i], found[i], short[i])));
    }
}

#[test]
fn negative_t_counts_if_the_range_says_so() {
    let mesh = loose(&[CORNER]);
    let back = Ray { t_min: -5.0, ..Ray::new([1.0, 1.0, 2.0], [0.0, 0.0, 1.0]) };
    assert_eq!(hits(&mesh, &[back])[0].t, -2.0);
}

#[test]
fn a_ray_in_the_plane_of_a_triangle_misses_it() {
    let mesh = loose(&[CORNER]);
    let along = [
        Ray::new([-1.0, 1.0, 0.0], [1.0, 0.0, 0.0]),
        Ray::new([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
        Ray::new([1.0, 1.0, 0.0], [1.0, 0.5, -0.0]),
        Ray::new([5.0, -1.0, 0.0], [-1.0, 1.0, 0.0]),
    ];
    assert_eq!(ids(&mesh, &along), [MISS; 4]);
    let leaning = loose(&[[[0.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 0.0, 4.0]]]);
    assert_eq!(ids(&leaning, &[Ray::new([-1.0, -1.0, 1.0], [1.0, 1.0, 0.0])]), [MISS]);
}

#[test]
fn a_ray_in_the_face_of_a_cube_hits_the_edges_of_its_sides() {
    let mut cube = Welded::default();
    cube.cube([0.0; 3]);
    let mesh = cube.mesh();
    let found = hits(&mesh, &[Ray::new([-1.0, 0.25, 0.0], [1.0, 0.0, 0.0])]);
    assert_eq!(found[0].t, 1.0);
}

#[test]
fn triangles_without_area_are_never_hit() {
    let needle = [[0.0, 0.0, 1.0], [2.0, 2.0, 1.0], [4.0, 4.0, 1.0]];
    let point = [[1.0, 1.0, 1.0]; 3];
    let mesh = loose(&[needle, point, CORNER]);
    assert_eq!(ids(&mesh, &[down(1.0, 1.0), down(2.0, 2.0)]), [2, 2]);
    let nothing = Recipe { family: Family::Nothing, size: 500, seed: 1 }.mesh();
    let rays = rays(&nothing, tree(&nothing).view(), 500, 1);
    assert!(ids(&nothing, &rays).iter().all(|&id| id == MISS));
}

#[test]
fn of_equal_t_the_lowest_number_wins() {
    // The same triangle three times, one turned around, between triangles elsewhere.
    let turned = [CORNER[0], CORNER[2], CORNER[1]];
    let above = CORNER.map(|[x, y, z]| [x, y, z + 5.0]);
    let mesh = loose(&[above, turned, CORNER, CORNER]);
    assert_eq!(ids(&mesh, &[down(1.0, 1.0), down(0.0, 0.0), down(2.0, 2.0)]), [1; 3]);
    // Different triangles in one plane, over each other.
    let flat = |x: f32, y: f32| [[x, y, 0.0], [x + 4.0, y, 0.0], [x, y + 4.0, 0.0]];
    let mesh = loose(&[flat(1.0, 1.0), flat(0.0, 0.0), flat(1.0, 0.0)]);
    assert_eq!(ids(&mesh, &[down(1.0, 1.0), down(0.5, 0.5), down(2.0, 0.5), down(1.0, 0.0)]), [0, 1, 1, 1]);
}

#[test]
fn at_a_shared_edge_or_vertex_the_lowest_number_wins() {
    // Four triangles around a vertex.
    let (o, e, n, w, s) = ([0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [-2.0, 0.0], [0.0, -2.0]);
    let flat = |t: [[f32; 2]; 3]| t.map(|[x, y]| [x, y, 0.0]);
    let mesh = loose(&[flat([o, n, w]), flat([o, e, n]), flat([o, w, s]), flat([o, s, e])]);
    let rays = [down(0.0, 0.0), down(0.0, 1.0), down(1.0, 0.0), down(0.0, -1.0), down(-1.0, 0.0)];
    assert_eq!(ids(&mesh, &rays), [0, 0, 1, 2, 0]);
}

#[test]
fn renumbering_triangles_renumbers_hits() {
    for family in [Family::Soup, Family::Slivers, Family::Lattice] {
        let mesh = Recipe { family, size: 500, seed: 4 }.mesh();
        let mut order: Vec<usize> = (0..500).collect();
        let mut random = Random::new(9);
        for i in 0..500 {
            order.swap(i, i + (random.bits() % (500 - i as u64)) as usize);
        }
        let shuffled: Vec<_> = order.iter().map(|&i| mesh.triangles()[i]).collect();
        let shuffled = Mesh::new(mesh.positions().to_vec(), shuffled).unwrap();
        let rays = rays(&mesh, tree(&mesh).view(), 1000, 2);
        for (a, b) in hits(&mesh, &rays).iter().zip(hits(&shuffled, &rays)) {
            assert_eq!((a.is_hit(), a.t), (b.is_hit(), b.t));
            if a.is_hit() && family != Family::Lattice {
                assert_eq!(a.triangle as usize, order[b.triangle as usize]);
            }
        }
    }
}

#[test]
fn the_sign_of_a_zero_direction_component_does_not_matter() {
    let mesh = Recipe { family: Family::Cubes, size: 12 * 40, seed: 2 }.mesh();
    let mut random = Random::new(3);
    let mut rays = Vec::new();
    for _ in 0..500 {
        // From half-integer points: inside faces, in splitting planes, on edges.
        let origin = [(); 3].map(|()| (random.bits() % 12) as f32 * 0.5 - 0.5);
        for axis in 0..3 {
            for bits in 0..4u32 {
                let zero = |bit: u32| if bits >> bit & 1 == 0 { 0.0 } else { -0.0 };
                let mut direction = [zero(0), zero(1), zero(0)];
                direction[axis] = 1.0;
                direction[(axis + 1) % 3] = zero(1);
                rays.push(Ray::new(origin, direction));
            }
        }
    }
    let found = hits(&mesh, &rays);
    for four in found.chunks(4) {
        assert!(four.iter().all(|hit| hit == &four[0]), "{four:?}");
    }
    assert!(found.iter().filter(|hit| hit.is_hit()).count() > 1000);
}

#[test]
fn an_origin_on_a_splitting_plane_sees_both_sides() {
    for recipe in every_recipe(400) {
        let mesh = recipe.mesh();
        let tree = tree(&mesh);
        let scale = tree.view().header.scale;
        let mut random = Random::new(6);
        let mut on_planes = Vec::new();
        for node in tree.view().nodes {
            if let Content::Inner { axis, split, .. } = node.content() {
                let triangle = mesh.triangles()[(random.bits() % mesh.triangles().len() as u64) as usize];
                let target = mesh.positions()[triangle[0] as usize];
                let mut origin = mesh.positions()[triangle[1] as usize];
                origin[axis as usize] = split / scale;
                let mut direction = [0, 1, 2].map(|i| target[i] - origin[i]);
                on_planes.push(Ray::new(origin, direction));
                direction[axis as usize] = 0.0;
                on_planes.push(Ray::new(origin, direction));
                direction[axis as usize] = -0.0;
                on_planes.push(Ray { t_min: f32::NEG_INFINITY, ..Ray::new(origin, direction) });
            }
        }
        on_planes.truncate(1500);
        hits(&mesh, &on_planes);
    }
}

#[test]
fn an_origin_on_a_surface_hits_it_unless_t_min_says_otherwise() {
    let floor = CORNER.map(|[x, y, _]| [x, y, -3.0]);
    let mesh = loose(&[CORNER, floor]);
    let on = Ray::new([1.0, 1.0, 0.0], [0.0, 0.0, -1.0]);
    let found = hits(&mesh, &[on, Ray { t_min: f32::MIN_POSITIVE, ..on }]);
    assert_eq!(found.iter().map(|hit| (hit.triangle, hit.t)).collect::<Vec<_>>(), [(0, 0.0), (1, 3.0)]);
}

#[test]
fn t_counts_in_lengths_of_the_direction() {
    for family in [Family::Soup, Family::Lattice, Family::Wild] {
        let mesh = Recipe { family, size: 300, seed: 8 }.mesh();
        let unit: Vec<Ray> = raykd::rays::random(mesh.bounds(), 500, 3);
        let expected = hits(&mesh, &unit);
        // The longest and the shortest directions of most families leave no room for `t`.
        for k in if family == Family::Wild { [-40, -3, 1, 20] } else { [-100, -3, 20, 125] } {
            let longer: Vec<Ray> = unit
                .iter()
                .map(|ray| Ray { direction: ray.direction.map(|d| ldexp(d, k)), ..*ray })
                .collect();
            let scaled: Vec<Hit> = expected.iter().map(|hit| Hit { t: ldexp(hit.t, -k), ..*hit }).collect();
            same(&format!("{family:?}, 2^{k}"), &scaled, &hits(&mesh, &longer)).unwrap();
        }
    }
}

#[test]
fn rays_that_are_none_miss_and_are_counted() {
    let mesh = loose(&[CORNER]);
    let good = down(1.0, 1.0);
    let mut bad = Vec::new();
    for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -f32::NAN] {
        for axis in 0..3 {
            let (mut from, mut to) = (good, good);
            from.origin[axis] = odd;
            to.direction[axis] = odd;
            bad.extend([from, to]);
        }
        if odd.is_nan() {
            bad.extend([Ray { t_min: odd, ..good }, Ray { t_max: odd, ..good }]);
        }
    }
    bad.push(Ray::new(good.origin, [0.0, -0.0, 0.0]));
    // Too far away for any digit of the mesh to be left.
    bad.push(Ray::new([1.0, 1.0, 1e30], good.direction));
    for named in devices() {
        let scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
        let mixed: Vec<Ray> = bad.iter().flat_map(|&ray| [good, ray]).collect();
        for query in [Query::Closest, Query::Any] {
            let traced = scene.trace(query, &mixed).unwrap();
            assert_eq!(traced.invalid as usize, bad.len(), "{}", named.name);
            for (i, pair) in traced.hits.chunks(2).enumerate() {
                assert!(pair[0].triangle == 0 && pair[1] == Hit::NONE, "{:?} by {}", bad[i], named.name);
            }
        }
    }
}

/// Rays from around the origin at every corner and at points of every edge of a mesh around it.
fn at_seams(mesh: &Mesh, count: usize) -> Vec<Ray> {
    let mut random = Random::new(12);
    let mut rays = Vec::new();
    while rays.len() < count {
        for triangle in mesh.triangles() {
            let [a, b, c] = triangle.map(|v| mesh.positions()[v as usize]);
            let from = [(); 3].map(|()| (random.unit() - 0.5) as f32 * 0.9);
            let s = random.unit() as f32;
            for target in
                [a, [0, 1, 2].map(|i| b[i] + (c[i] - b[i]) * s), [0, 1, 2].map(|i| (a[i] + b[i]) * 0.5)]
            {
                rays.push(Ray::new(from, [0, 1, 2].map(|i| target[i] - from[i])));
            }
        }
    }
    rays
}

#[test]
fn closed_meshes_do_not_leak_at_edges_and_vertices() {
    let mut cube = Welded::default();
    cube.cube([-0.5; 3]);
    // Around the origin, and moved to where few digits are left; once more stretched into needles.
    let moved = |mesh: &Mesh, stretch: [f32; 3], by: f32| {
        let positions = mesh.positions().iter().map(|p| [0, 1, 2].map(|i| p[i] * stretch[i] + by)).collect();
        Mesh::new(positions, mesh.triangles().to_vec()).unwrap()
    };
    for mesh in [icosphere(4), icosphere(1), cube.mesh()] {
        let rays = at_seams(&mesh, 70_000);
        for (stretch, by) in [([1.0; 3], 0.0), ([1.0; 3], 100.0), ([1e-3, 1.0, 1e3], 0.0)] {
            let rays: Vec<Ray> = rays
                .iter()
                .map(|ray| {
                    // The direction's digits are as few as the mesh's then; what counts is that it is inside.
                    Ray {
                        origin: [0, 1, 2].map(|i| ray.origin[i] * stretch[i] + by),
                        direction: [0, 1, 2].map(|i| ray.direction[i] * stretch[i]),
                        ..*ray
                    }
                })
                .collect();
            let found = trace(&moved(&mesh, stretch, by), &rays, false);
            let leaks = found.iter().filter(|hit| !hit.is_hit()).count();
            assert_eq!(leaks, 0, "of {} rays", rays.len());
        }
    }
}

#[test]
fn a_thousand_triangles_around_a_vertex_do_not_leak() {
    let hub = [0.1, 0.2, 0.3];
    let rim = |i: usize| {
        let angle = (i % 1000) as f32 * (std::f32::consts::TAU / 1000.0);
        [angle.cos(), angle.sin(), 0.0]
    };
    let mesh = loose(&(0..1000).map(|i| [hub, rim(i), rim(i + 1)]).collect::<Vec<_>>());
    let mut random = Random::new(1);
    let mut ray = || {
        let from = [(); 3].map(|()| random.unit() as f32 - 0.5);
        let from = [from[0], from[1], from[2] + 2.0];
        Ray::new(from, [0, 1, 2].map(|i| hub[i] - from[i]))
    };
    let rays: Vec<Ray> = (0..2000).map(|_| ray()).collect();
    assert!(hits(&mesh, &rays).iter().all(Hit::is_hit));
}

#[test]
fn scenes_of_any_size_give_the_same_triangles() {
    let mesh = Recipe { family: Family::Soup, size: 400, seed: 5 }.mesh();
    let rays = rays(&mesh, tree(&mesh).view(), 2000, 6);
    let expected = hits(&mesh, &rays);
    assert!(expected.iter().filter(|hit| hit.is_hit()).count() > 300);
    // 2^-66 is about 1e-20, 2^63 about 1e19.
    for k in [-66, -20, 30, 63] {
        let factor = 2f32.powi(k);
        let grow = |p: &[f32; 3]| p.map(|x| x * factor);
        let larger =
            Mesh::new(mesh.positions().iter().map(grow).collect(), mesh.triangles().to_vec()).unwrap();
        let far: Vec<Ray> = rays
            .iter()
            .map(|ray| Ray {
                origin: grow(&ray.origin),
                t_min: ray.t_min * factor,
                t_max: ray.t_max * factor,
                ..*ray
            })
            .collect();
        let scaled: Vec<Hit> = expected.iter().map(|hit| Hit { t: hit.t * factor, ..*hit }).collect();
        same(&format!("2^{k}"), &scaled, &hits(&larger, &far)).unwrap();
    }
}

#[test]
fn parallel_walls_are_told_apart() {
    // A ray through 2000 walls that all miss it but the last, and through walls a millionth apart.
    let mut walls: Vec<_> = (0..2000).map(|i| CORNER.map(|[x, y, _]| [x, y, -(i as f32)])).collect();
    walls.push([[-9.0, -9.0, -2000.0], [9.0, -9.0, -2000.0], [0.0, 9.0, -2000.0]]);
    let mesh = loose(&walls);
    assert_eq!(ids(&mesh, &[down(-1.0, -1.0), down(1.0, 1.0)]), [2000, 0]);
    let near = [1.000_001f32, 1.0].map(|z| CORNER.map(|[x, y, _]| [x, y, z]));
    assert_eq!(ids(&loose(&near), &[down(1.0, 1.0), Ray::new([1.0; 3], [0.0, 0.0, 1.0])]), [0, 1]);
}

/// A soup of corners at multiples of 1/64 from -1 to 1, which two triangles fill: exact at every scale.
fn lattice_soup() -> Mesh {
    let mut random = Random::new(77);
    let mut corner = || [(); 3].map(|()| (random.bits() % 129) as f32 / 64.0 - 1.0);
    let mut triangles: Vec<_> = (0..100).map(|_| [corner(), corner(), corner()]).collect();
    triangles.push([[-1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0]]);
    loose(&triangles)
}

#[test]
fn scales_are_exact_to_the_ends_of_their_range() {
    let mesh = lattice_soup();
    let mut random = Random::new(3);
    let directions: Vec<[f32; 3]> = (0..500).map(|_| [(); 3].map(|()| random.unit() as f32 - 0.5)).collect();
    let rays = |factor: f32| -> Vec<Ray> {
        directions.iter().map(|d| Ray::new([0.0; 3], d.map(|x| x * factor))).collect()
    };
    let expected = hits(&mesh, &rays(1.0));
    assert!(expected.iter().filter(|hit| hit.is_hit()).count() > 400);
    // Extents of twice that: the first and last there are, and those on either side of where scaling begins.
    for (k, scaled) in [
        (-138, true),
        (-137, true),
        (-12, true),
        (-11, false),
        (19, false),
        (20, true),
        (126, true),
        (127, true),
    ] {
        // In steps, for the powers themselves are subnormal at one end.
        let half = 2f32.powi(k / 2);
        let rest = 2f32.powi(k - k / 2);
        let grown = moved(&mesh, |p| p.map(|x| x * half * rest));
        assert_eq!(grown.scale() != 1.0, scaled, "2^{k}");
        // So that neither `t` nor directions are subnormal.
        let same_hits: Vec<Hit> = expected.iter().map(|hit| Hit { t: hit.t * rest, ..*hit }).collect();
        same(&format!("2^{k}"), &same_hits, &hits(&grown, &rays(half))).unwrap();
    }
    let positions = mesh.positions().iter().map(|p| p.map(|x| x * 2f32.powi(-70) * 2f32.powi(-69))).collect();
    let error = Mesh::new(positions, mesh.triangles().to_vec()).unwrap_err().to_string();
    assert!(error.contains("less than 2^-137"), "{error}");
}

#[test]
fn origins_count_as_long_as_digits_of_the_mesh_are_left() {
    let mesh = lattice_soup();
    for k in [0, 63, -63] {
        let factor = 2f32.powi(k);
        let grown = moved(&mesh, |p| p.map(|x| x * factor));
        // In units of the mesh as the kernels see it.
        let limit = 2f32.powi(30) / grown.scale();
        let from = |x: f32| Ray::new([x, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        for named in devices() {
            let scene = Scene::build(&named.device, &grown, &BuildOptions::default()).unwrap();
            let invalid = |x: f32| scene.trace(Query::Closest, &[from(x)]).unwrap().invalid;
            let found = [limit.next_down(), -limit.next_down(), limit, -limit].map(invalid);
            assert_eq!(found, [0, 0, 1, 1], "2^{k} by {}", named.name);
        }
    }
}

/// As far is only what is flat across an axis: else it would be large, and scaled.
#[test]
fn meshes_count_as_long_as_products_of_lengths_have_room() {
    for (distance, counted) in [(2f32.powi(50), 1), (2f32.powi(50).next_down(), 0), (2f32.powi(120), 1)] {
        let mesh = moved(&loose(&[CORNER]), |[x, y, _]| [x, y, -distance]);
        let rays = [Ray::new([1.0, 1.0, 0.0], [0.0, 0.0, -1.0])];
        let found = hits(&mesh, &rays)[0];
        assert_eq!((found.is_hit(), found.t), if counted == 0 { (true, distance) } else { (false, 0.0) });
        assert_eq!(build(&mesh).trace(Query::Closest, &rays).unwrap().invalid, counted);
    }
}

#[test]
fn subnormal_numbers_in_rays_are_zeros() {
    let mesh = lattice_soup();
    let tiny = f32::from_bits(0x007F_FFFF);
    let smallest = f32::MIN_POSITIVE;
    let with = |x: f32| {
        let ray = |origin, direction| Ray::new(origin, direction);
        [
            ray([x, 0.3, 0.1], [0.3, 0.2, 1.0]),
            ray([0.1, -x, 0.1], [1.0, 0.2, 0.4]),
            ray([0.1, 0.2, 0.1], [x, 0.7, 0.4]),
            ray([0.1, 0.2, 0.1], [0.5, 0.7, -x]),
            ray([0.0, 0.0, 0.0], [x, -x, x]),
            Ray { t_min: x, ..ray([0.5, 0.3, 0.1], [0.3, 0.2, 1.0]) },
            Ray { t_max: x, ..ray([0.5, 0.3, 0.1], [0.3, 0.2, 1.0]) },
        ]
    };
    same("subnormal", &hits(&mesh, &with(0.0)), &hits(&mesh, &with(tiny))).unwrap();
    // The next larger number is one: of a direction it makes a ray.
    let found = hits(&mesh, &with(smallest));
    assert!(found[4].is_hit() && !hits(&mesh, &with(tiny))[4].is_hit());
}

#[test]
fn dust_of_a_mesh_is_zero_and_counted() {
    let down = [down(0.0, 1.0), down(-2f32.powi(-58), 1.0)];
    // Of an extent of 4, and of one that is scaled.
    for k in [0, 60] {
        let factor = 2f32.powi(k);
        let rays = down.map(|ray| Ray { origin: ray.origin.map(|x| x * factor), ..ray });
        for (x, flushed) in [(2f32.powi(-58), 0), (2f32.powi(-58).next_down(), 2)] {
            let mesh = loose(&[[[x, 0.0, 0.0], CORNER[1], [x, 4.0, 0.0]].map(|p| p.map(|x| x * factor))]);
            assert_eq!(mesh.repairs().flushed, flushed);
            for named in devices() {
                let mut scene = Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap();
                scene.intersect_by(Intersector::Exact).unwrap();
                let hits = [scene.closest(&rays), scene.brute(&rays)].map(Result::unwrap);
                for hits in hits {
                    let found: Vec<bool> = hits.iter().map(Hit::is_hit).collect();
                    assert_eq!(found, [flushed > 0, false], "2^{k}, {x:e} by {}", named.name);
                }
            }
        }
    }
}
