//! Instances of scenes: what rays find among them is what they find in one mesh of all triangles.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Device, Error, Hit, Intersector, Mesh, Query, Ray, Scene, World, WorldHit,
    rays::{Random, Ray64, random},
};
use raykd_tests::{Failure, cases, cpu, devices, gpu, same};

/// Rows of a transform.
type Rows = [[f32; 4]; 3];

const IDENTITY: Rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

fn moved([x, y, z]: [f32; 3]) -> Rows {
    [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z]]
}

/// A whole number from `-most` to `most`.
fn whole(random: &mut Random, most: usize) -> f32 {
    random.below(2 * most + 1) as f32 - most as f32
}

/// Triangles with corners in a small lattice, so that many meet.
fn lattice(random: &mut Random) -> Mesh {
    let mut point = || [0; 3].map(|_| whole(random, 3));
    let positions: Vec<_> = (0..24).map(|_| point()).collect();
    let triangles = (0..12).map(|_| [0; 3].map(|_| random.below(24) as u32)).collect();
    Mesh::new(positions, triangles).expect("a mesh")
}

/// A transform whose inverse has few digits: whole numbers, times a power of two. Without shears only mirrors and
/// powers.
fn exact_transform(random: &mut Random, shears: bool) -> Rows {
    let mut rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..random.below(5) {
        let (i, j) = (random.below(3), random.below(3));
        match random.below(3) {
            0 => rows[i] = rows[i].map(|x: f32| -x),
            1 if shears => rows.swap(i, j),
            2 if shears && i != j => rows[i] = [0, 1, 2].map(|axis| rows[i][axis] + rows[j][axis]),
            _ => {}
        }
    }
    let scale = whole(random, 2).exp2();
    rows.map(|[x, y, z]| [x * scale, y * scale, z * scale, whole(random, 16) / 4.0])
}

fn transformed(rows: &Rows, p: [f32; 3]) -> [f32; 3] {
    rows.map(|row| {
        let exact = (0..3).map(|i| f64::from(row[i]) * f64::from(p[i])).sum::<f64>() + f64::from(row[3]);
        exact as f32
    })
}

/// All triangles of all instances in their order, and the instance and number of each.
fn flattened(instances: &[(&Mesh, Rows)]) -> (Mesh, Vec<(u32, u32)>) {
    let (mut positions, mut triangles, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for (number, (mesh, rows)) in (0..).zip(instances) {
        let first = positions.len() as u32;
        positions.extend(mesh.positions().iter().map(|&p| transformed(rows, p)));
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|vertex| first + vertex)));
        names.extend((0..mesh.triangles().len() as u32).map(|triangle| (number, triangle)));
    }
    (Mesh::new(positions, triangles).expect("a mesh"), names)
}

fn named(hit: &Hit, names: &[(u32, u32)]) -> WorldHit {
    if !hit.is_hit() {
        return WorldHit::NONE;
    }
    let (instance, triangle) = names[hit.triangle as usize];
    WorldHit { instance, triangle, t: hit.t, u: hit.u, v: hit.v }
}

fn scene(device: &Device, mesh: &Mesh, intersector: Intersector) -> Result<Scene, Error> {
    let mut scene = Scene::build(device, mesh, &BuildOptions::default())?;
    scene.intersect_by(intersector)?;
    Ok(scene)
}

fn world(device: &Device, instances: &[(&Mesh, Rows)], intersector: Intersector) -> Result<World, Error> {
    let mut world = World::new();
    for (mesh, rows) in instances {
        world.add(&scene(device, mesh, intersector)?, *rows)?;
    }
    Ok(world)
}

/// Rays along the lattice, through corners and beside, some of them short.
fn lattice_rays(random: &mut Random, mesh: &Mesh) -> Vec<Ray> {
    let ray = |i: usize| {
        let origin = [0; 3].map(|_| whole(random, 40) / 2.0);
        let to = mesh.positions()[random.below(mesh.positions().len())];
        let direction = match i % 3 {
            0 => [0; 3].map(|_| whole(random, 2)),
            1 => [0, 1, 2].map(|axis| to[axis] - origin[axis]),
            _ => [0, 1, 2].map(|axis| if axis == random.below(3) { whole(random, 1) } else { 0.0 }),
        };
        // Those that start at a corner, and graze boxes from there.
        let origin = if i.is_multiple_of(5) { to } else { origin };
        let (t_min, t_max) =
            if i.is_multiple_of(4) { (whole(random, 4), whole(random, 8)) } else { (0.0, f32::INFINITY) };
        Ray { t_min, t_max, ..Ray::new(origin, direction) }
    };
    (0..200).map(ray).collect()
}

/// Compares a world with one mesh.
fn compare(device: &Device, seed: u64, intersector: Intersector) -> Result<(), Failure> {
    let random = &mut Random::new(seed);
    let meshes = [lattice(random), lattice(random)];
    let count = 1 + random.below(4);
    let shears = intersector == Intersector::Exact;
    let instances: Vec<_> =
        (0..count).map(|_| (&meshes[random.below(2)], exact_transform(random, shears))).collect();
    let (flat, names) = flattened(&instances);
    let rays = lattice_rays(random, &flat);
    let one = scene(cpu(), &flat, intersector)?;
    let world = world(device, &instances, intersector)?;
    let usual: Vec<_> = one.closest(&rays)?.iter().map(|hit| named(hit, &names)).collect();
    same("closest", &usual, &world.closest(&rays)?)?;
    let wide: Vec<Ray64> = rays
        .iter()
        .map(|ray| Ray64 {
            origin: ray.origin.map(f64::from),
            direction: ray.direction.map(f64::from),
            t_min: ray.t_min.into(),
            t_max: ray.t_max.into(),
        })
        .collect();
    same("rays in f64", &usual, &world.closest(&wide)?)?;
    let any = world.any(&rays)?;
    let are_hit = |hits: &[WorldHit]| hits.iter().map(|hit| u8::from(hit.is_hit())).collect::<Vec<_>>();
    same("any", &are_hit(&usual), &are_hit(&any))
}

proptest! {
    #![proptest_config(cases(256))]
    #[test]
    fn a_world_is_the_mesh_of_all_its_triangles(seed: u64) {
        compare(cpu(), seed, Intersector::Exact)?;
    }

    #[test]
    fn mirrors_and_powers_of_two_change_no_byte(seed: u64, which in 0usize..5) {
        compare(&devices()[which].device, seed, Intersector::Strict)?;
    }
}

/// An instance that is small makes numbers of rays larger.
#[test]
fn subnormal_numbers_stay_zeros_in_an_instance() -> Result<(), Failure> {
    let k = 2f32.powi(-20);
    let corners = [[0.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [0.0, 1.0, -1.0]];
    let whole = Mesh::new(corners.to_vec(), vec![[0, 1, 2]]).expect("a triangle");
    let small = corners.map(|corner| corner.map(|x| k * x));
    let small = Mesh::new(small.to_vec(), vec![[0, 1, 2]]).expect("a triangle");
    let rows = [[k, 0.0, 0.0, 0.0], [0.0, k, 0.0, 0.0], [0.0, 0.0, k, 0.0]];
    let tiny = f32::from_bits(70_000);
    let rays = [
        Ray::new([-k * 0.25, k * 0.5, 0.0], [0.0, 0.0, -tiny]),
        Ray::new([tiny, 0.0, 0.0], [0.0, 0.0, -1.0]),
        Ray::new([0.0; 3], [tiny, 0.0, -1.5e-38]),
        Ray { t_min: -0.0, t_max: -tiny, ..Ray::new([0.0, 0.0, -k], [0.0, 0.0, -1.0]) },
    ];
    for intersector in [Intersector::Strict, Intersector::Exact] {
        let one = scene(cpu(), &small, intersector)?.trace(Query::Closest, &rays)?;
        let found = world(cpu(), &[(&whole, rows)], intersector)?.trace(Query::Closest, &rays)?;
        let (expected, hit) = (one.hits.iter().map(|hit| hit.t), one.hits.iter().map(Hit::is_hit));
        assert!(
            found.hits.iter().map(|hit| hit.t).eq(expected),
            "{intersector}: {:?}, {:?}",
            found.hits,
            one.hits
        );
        assert!(found.hits.iter().map(WorldHit::is_hit).eq(hit), "{intersector}");
        assert_eq!((found.invalid, one.invalid), (1, 1), "{intersector}");
    }
    Ok(())
}

#[test]
fn any_transform_gives_the_same_bytes_everywhere() -> Result<(), Failure> {
    let mut numbers = Random::new(3);
    let meshes = [Mesh::teapot(3), Mesh::teapot(4)];
    let rows = || {
        [0; 3].map(|_| {
            let mut number = |by: f32| by * numbers.signed();
            [number(1.0), number(1.0), number(1.0), number(40.0)]
        })
    };
    let instances: Vec<_> =
        std::iter::repeat_with(rows).zip(meshes.iter().cycle()).take(6).map(|(r, m)| (m, r)).collect();
    let (flat, names) = flattened(&instances);
    let rays = random(flat.bounds(), 20_000, 4);
    let found = world(cpu(), &instances, Intersector::Strict)?.closest(&rays)?;
    same("GPU", &found, &world(gpu(), &instances, Intersector::Strict)?.closest(&rays)?)?;
    // Some scenes here, some there.
    let mut mixed = World::new();
    for (i, (mesh, rows)) in instances.iter().enumerate() {
        let device = if i % 2 == 0 { gpu() } else { cpu() };
        mixed.add(&scene(device, mesh, Intersector::Strict)?, *rows)?;
    }
    same("CPU and GPU", &found, &mixed.closest(&rays)?)?;
    // But for rounding these are the hits of one mesh.
    let usual = scene(cpu(), &flat, Intersector::Strict)?.closest(&rays)?;
    let near = |(found, hit): (&WorldHit, &Hit)| {
        let usual = named(hit, &names);
        let apart = (found.t - usual.t).abs() <= 1e-4 * usual.t.abs();
        (found.instance, found.triangle) == (usual.instance, usual.triangle) && apart
    };
    let others = found.iter().zip(&usual).filter(|&pair| !near(pair)).count();
    let hits = usual.iter().filter(|hit| hit.is_hit()).count();
    assert!(hits > 3000 && others < 20, "{others} others of {hits} hits");
    Ok(())
}

/// The lowest instance wins, whatever the order of the devices' answers; so does the lowest triangle of it.
#[test]
fn of_equal_t_the_lowest_instance_wins() -> Result<(), Failure> {
    let mesh = Mesh::new(vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], vec![[0, 1, 2], [0, 1, 2]])
        .map_err(Error::from)?;
    let ray = [Ray::new([1.0, 1.0, 3.0], [0.0, 0.0, -1.0])];
    for named in devices() {
        let above = moved([0.0, 0.0, 1.0]);
        let below = moved([0.0, 0.0, -1.0]);
        let world =
            world(&named.device, &[(&mesh, below), (&mesh, above), (&mesh, above)], Intersector::Strict)?;
        let hit = world.closest(&ray)?[0];
        assert_eq!((hit.instance, hit.triangle, hit.t), (1, 0, 2.0), "{}", named.name);
        assert!(world.any(&ray)?[0].is_hit());
    }
    Ok(())
}

#[test]
fn transforms_that_cannot_be_undone_are_refused() -> Result<(), Failure> {
    let teapot = Scene::build(cpu(), &Mesh::teapot(1), &BuildOptions::default())?;
    let mut world = World::new();
    world.add(&teapot, IDENTITY)?;
    let with = |row: usize, column: usize, x: f32| {
        let mut rows = IDENTITY;
        rows[row][column] = x;
        rows
    };
    let same_rows = [[0.1, 0.7, 0.3, 0.0], [0.2, 1.4, 0.6, 0.0], [0.0, 0.0, 1.0, 0.0]];
    for (rows, word) in [
        (with(1, 3, f32::NAN), "infinite or NaN"),
        (with(0, 0, f32::INFINITY), "infinite or NaN"),
        (with(2, 2, 0.0), "singular"),
        (same_rows, "singular"),
        ([[0.0; 4]; 3], "singular"),
    ] {
        let error = world.add(&teapot, rows).unwrap_err().to_string();
        assert!(error.contains("instance 1") && error.contains(word), "{error}");
    }
    // As near to that as can be, very large and very small: these can be undone.
    for rows in [
        [[1.0, 1.0, 0.0, 0.0], [1.0, 1.0f32.next_up(), 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        with(0, 0, f32::MAX),
        with(0, 0, f32::from_bits(1)),
    ] {
        world.add(&teapot, rows)?;
    }
    assert_eq!((world.len(), world.is_empty()), (4, false));
    Ok(())
}

#[test]
fn worlds_of_nothing_and_rays_that_are_none() -> Result<(), Failure> {
    let nothing = World::new();
    let rays = random(([-1.0; 3], [1.0; 3]), 10, 1);
    assert_eq!(nothing.closest(&rays)?, [WorldHit::NONE; 10]);
    assert!(nothing.is_empty() && nothing.any(&rays[..0])?.is_empty());
    let teapot = world(cpu(), &[(&Mesh::teapot(2), IDENTITY)], Intersector::Strict)?;
    for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for field in 0..8 {
            let mut words = bytemuck::cast::<Ray, [f32; 8]>(Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0]));
            words[field] = odd;
            let ray = [bytemuck::cast::<[f32; 8], Ray>(words)];
            let scene = Scene::build(cpu(), &Mesh::teapot(2), &BuildOptions::default())?;
            let expected = scene.closest(&ray)?[0];
            let found = teapot.closest(&ray)?[0];
            assert_eq!((found.triangle, found.t), (expected.triangle, expected.t), "{ray:?}");
        }
    }
    Ok(())
}

#[test]
fn rays_that_are_none_in_a_world_are_counted_once() -> Result<(), Failure> {
    let ray = Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0]);
    let everywhere = [
        Ray { t_min: f32::NAN, ..ray },
        Ray::new([f32::INFINITY, 0.0, 0.0], [1.0; 3]),
        Ray::new([0.0, 0.0, 50.0], [0.0, -0.0, 0.0]),
    ];
    let rays = [&[ray][..], &everywhere, &[ray]].concat();
    let mesh = Mesh::teapot(2);
    let small = IDENTITY.map(|row| row.map(|x| x * 2f32.powi(-60)));
    for named in devices() {
        for query in [Query::Closest, Query::Any] {
            let asked = |instances: &[(&Mesh, Rows)]| {
                let traced = world(&named.device, instances, Intersector::Strict)?.trace(query, &rays)?;
                assert!(traced.hits[1..4].iter().all(|hit| !hit.is_hit()), "{}", named.name);
                Ok::<_, Error>((traced.hits[0].is_hit(), traced.invalid))
            };
            assert_eq!(asked(&[])?, (false, 3), "{}", named.name);
            let usual = (&mesh, IDENTITY);
            assert_eq!(asked(&[usual, usual, usual])?, (true, 3), "{}", named.name);
            // Beside this one all origins are too far away.
            assert_eq!(asked(&[(&mesh, small), (&mesh, small)])?, (false, 5), "{}", named.name);
            let both = if query == Query::Any { 3 } else { 5 };
            assert_eq!(asked(&[usual, (&mesh, small)])?, (true, both), "{}", named.name);
        }
    }
    Ok(())
}

/// Rays are rounded, and so is what they hit: at the corners of a box, of which each triangle has some, a ray may hit
/// by rounding that passes beside the box. And a range may be just the `t` of a hit.
#[test]
fn no_box_hides_a_hit() -> Result<(), Failure> {
    let numbers = &mut Random::new(9);
    let mut hits = 0;
    for round in 0..100 {
        let flat = |axis: usize| axis == round % 4;
        let mut point = || [0, 1, 2].map(|axis| if flat(axis) { 0.3 } else { numbers.signed() });
        let positions = vec![point(), point(), point()];
        let mesh = Mesh::new(positions.clone(), vec![[0, 1, 2]]).map_err(Error::from)?;
        let alone = scene(cpu(), &mesh, Intersector::Strict)?;
        let world = world(cpu(), &[(&mesh, IDENTITY)], Intersector::Strict)?;
        let mut ray = |i: usize| {
            let origin = [0; 3].map(|_| numbers.signed() * (2.0 + 30.0 * (i % 7) as f32));
            let (a, b, by) = (positions[i % 3], positions[i / 3 % 3], numbers.unit() as f32);
            Ray::new(origin, [0, 1, 2].map(|axis| a[axis] + (b[axis] - a[axis]) * by - origin[axis]))
        };
        let mut rays: Vec<Ray> = (0..300).map(&mut ray).collect();
        let found = alone.closest(&rays)?;
        let again = rays.iter().zip(&found).filter(|(_, hit)| hit.is_hit());
        let again: Vec<Ray> = again.map(|(ray, hit)| Ray { t_min: hit.t, t_max: hit.t, ..*ray }).collect();
        hits += again.len();
        rays.extend(again);
        let usual: Vec<_> = alone.closest(&rays)?.iter().map(|hit| named(hit, &[(0, 0)])).collect();
        same("hits", &usual, &world.closest(&rays)?)?;
    }
    assert!(hits > 10_000, "{hits} hits");
    Ok(())
}

/// A mesh far from 0 keeps the digits that its own rays in `f64` have.
#[test]
fn meshes_far_off_keep_their_digits() -> Result<(), Failure> {
    let far = 4.5e6 + 0.1;
    let positions =
        Mesh::teapot(4).positions().iter().map(|p| p.map(|x| f64::from(x) / 64.0 + far)).collect();
    let mesh = Mesh::from_f64(positions, Mesh::teapot(4).triangles().to_vec()).map_err(Error::from)?;
    assert_ne!(mesh.translation(), [0.0; 3]);
    let rays: Vec<Ray64> = random(([-0.3; 3], [0.3; 3]), 2000, 2)
        .iter()
        .map(|ray| Ray64::new(ray.origin.map(|x| f64::from(x) + far), ray.direction.map(f64::from)))
        .collect();
    let scene = Scene::build(cpu(), &mesh, &BuildOptions::default())?;
    let mut world = World::new();
    world.add(&scene, IDENTITY)?;
    let names: Vec<_> = (0..mesh.triangles().len() as u32).map(|i| (0, i)).collect();
    let usual: Vec<_> = scene.closest(&rays)?.iter().map(|hit| named(hit, &names)).collect();
    assert!(usual.iter().filter(|hit| hit.is_hit()).count() > 100);
    same("far", &usual, &world.closest(&rays)?)
}
