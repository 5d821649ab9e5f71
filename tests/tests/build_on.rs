//! Scenes of meshes that lie on the device: the same bytes as of meshes of the host, and nothing of them on the bus.

use num_traits::Zero as _;
use proptest::prelude::*;
use raykd::{
    BuildOptions, BuildTimes, Builder, Device, Error, Hit, Intersector, KdTree, Mesh, Query, Scene,
    Traversal,
    internals::{
        Gpu,
        kernels::{
            build::{
                State,
                survey::{Found, area::has_area},
            },
            glam::UVec3,
        },
    },
    mesh::MeshSource,
    rays::{Random, random},
    shared::{Node, TreeHeader},
    single::LeafTriangle,
    stress::CASES,
    wgpu,
};
use raykd_tests::{
    Failure, any_options, cases, cpu, devices,
    exact::rational,
    gpu,
    meshes::{Family, RANDOM, Recipe, ZOO, any_mesh, small_mesh},
    same,
};
use std::{
    sync::LazyLock,
    time::{Duration, Instant},
};
use wgpu::{BufferUsages as Use, util::DeviceExt as _};

/// Vertices and triangles.
type Arrays = (Vec<[f32; 3]>, Vec<[u32; 3]>);

fn arrays(mesh: &Mesh) -> Arrays {
    (mesh.positions().to_vec(), mesh.triangles().to_vec())
}

/// Builds from buffers of any device.
fn built_from(device: &Device, arrays: &Arrays, options: &BuildOptions) -> Result<Scene, Error> {
    raykd_tests::built_from(device, &arrays.0, &arrays.1, options)
}

fn built(device: &Device, (positions, triangles): &Arrays, options: &BuildOptions) -> Result<Scene, Error> {
    Scene::build(device, &Mesh::new(positions.clone(), triangles.clone())?, options)
}

/// Compares trees, digests and headers with those of the host's path, or the errors.
fn compare(device: &Device, arrays: &Arrays, options: &BuildOptions) -> Result<(), Failure> {
    agree(&built(cpu(), arrays, options), &built_from(device, arrays, options))
}

/// Compares trees, digests and headers, or the errors.
fn agree(expected: &Result<Scene, Error>, found: &Result<Scene, Error>) -> Result<(), Failure> {
    let (expected, found) = match (expected, found) {
        (Ok(expected), Ok(found)) => (expected.tree()?, found.tree()?),
        (Err(expected), Err(found)) if expected.to_string() == found.to_string() => return Ok(()),
        (expected, found) => {
            let [expected, found] = [expected, found].map(|scene| scene.as_ref().err());
            return Err(Failure(format!("expected {expected:?}, found {found:?}")));
        }
    };
    let (a, b) = (expected.view(), found.view());
    same::<TreeHeader>("header", &[*a.header], &[*b.header])?;
    same::<Node>("nodes", a.nodes, b.nodes)?;
    same("references", a.refs, b.refs)
}

/// A mesh with what meshes of other people have: -0, dust, coordinates at the ends of the range, corners on a line,
/// vertices that nobody uses.
fn worn((mut positions, mut triangles): Arrays, seed: u64) -> Arrays {
    let mut random = Random::new(seed);
    let random = &mut random;
    let scale = if random.unit() < 0.5 { 1.0 } else { (230.0 * random.unit() - 140.0).floor().exp2() };
    let (few, flat) = (random.unit().powi(3), random.unit().powi(3));
    let largest = positions.as_flattened().iter().fold(0f32, |most, x| most.max(x.abs()));
    let dust =
        |random: &mut Random| f64::from(largest) * (-90.0 * random.unit()).exp2() * random.signed() as f64;
    for x in positions.as_flattened_mut() {
        let mut y = f64::from(*x);
        if random.unit() < few {
            y = match random.bits() % 4 {
                0 => -0.0,
                1 => 0.0,
                _ => dust(random),
            };
        }
        *x = ((y * scale) as f32).clamp(f32::MIN, f32::MAX);
    }
    for t in &mut triangles {
        if random.unit() < 0.3 * flat {
            match random.bits() % 2 {
                0 => t[2] = t[1],
                _ => {
                    let [a, b] = [t[0], t[1]].map(|v| positions[v as usize]);
                    t[2] = positions.len() as u32;
                    positions.push([0, 1, 2].map(|i| 2.0 * (b[i] / 4.0) - a[i] / 2.0));
                }
            }
        }
    }
    let last = (random.bits() % 3) as usize;
    positions.extend([[f32::MAX; 3], [-0.0, 1e-44, -1e38], [1.0; 3]].iter().take(last));
    (positions, triangles)
}

proptest! {
    #![proptest_config(cases(256))]
    #[test]
    fn worn_meshes_of_the_device_make_the_trees_of_the_hosts(recipe in small_mesh(), seed: u64, which in 0usize..5) {
        let arrays = worn(arrays(&recipe.mesh()), seed);
        compare(&devices()[which].device, &arrays, &BuildOptions::default())?;
    }
}

/// A triangle on a line that has area once dust is 0: it takes part, but not where it would make the mesh so large that
/// more is dust.
#[test]
fn dust_of_a_mesh_of_the_device_is_that_of_the_hosts() -> Result<(), Failure> {
    let power = |e: i32| 2f32.powi(e);
    let mut positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    positions.push([power(-61), 0.5, 0.0]);
    let small = [[power(-60), 1.0, 0.0], [power(-61), 0.5, 0.0]];
    let large = [[power(29), 0.0, power(-61)], [power(50), 0.0, power(-40)]];
    for (line, kept) in [(small, &[0, 1, 2, 3][..]), (large, &[0, 1, 2])] {
        let positions = [positions.as_slice(), &line].concat();
        let arrays = (positions.clone(), vec![[0, 1, 2], [0, 1, 3], [2, 3, 4], [0, 5, 6]]);
        assert_eq!(Mesh::new(positions, arrays.1.clone()).expect("a mesh").kept(), kept);
        for named in devices() {
            compare(&named.device, &arrays, &BuildOptions::default())?;
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(64))]
    #[test]
    fn all_builders_do(
        recipe in any_mesh(), builder in prop::sample::select(Builder::ALL.to_vec()), depth in 0u32..=48,
    ) {
        let options = BuildOptions::default().with_builder(builder).with_max_depth(depth);
        compare(gpu(), &arrays(&recipe.mesh()), &options)?;
    }
}

/// Small ones of all kinds, and such as take several blocks.
#[test]
fn meshes_of_all_families_do() -> Result<(), Failure> {
    for family in RANDOM.into_iter().chain(ZOO) {
        for size in [1, 33, 1025, 3000] {
            let arrays = arrays(&Recipe { family, size, seed: 7 }.mesh());
            for device in [gpu(), cpu()] {
                let compared = compare(device, &arrays, &BuildOptions::default());
                compared.map_err(|e| Failure(format!("{family:?} of {size}: {e}")))?;
            }
        }
    }
    Ok(())
}

#[test]
fn stress_scenes_and_the_teapot_do() -> Result<(), Failure> {
    let parts =
        CASES.iter().flat_map(|case| case.parts(1).into_iter().map(move |part| (case.name, part.mesh)));
    for (name, mesh) in parts.chain([("teapot", Mesh::teapot(12))]) {
        // Those that were moved are not of `f32`. The largest take a software rasteriser long.
        if mesh.translation() == [0.0; 3] && mesh.triangles().len() < 20_000 {
            let compared = compare(gpu(), &arrays(&mesh), &BuildOptions::default());
            compared.map_err(|e| Failure(format!("{name}: {e}")))?;
        }
    }
    Ok(())
}

/// More blocks than the workgroup has lanes that says where each begins.
#[test]
fn many_blocks_do() -> Result<(), Failure> {
    let mut arrays = arrays(&Mesh::teapot(96));
    let number = arrays.1.len() as u32;
    // Triangles without area in places of no pattern.
    let mut random = Random::new(3);
    for t in &mut arrays.1 {
        if random.unit() < 0.3 {
            t[1] = t[0];
        }
    }
    assert!(number > 256 * 1024, "{number} triangles");
    compare(cpu(), &arrays, &BuildOptions::default().with_builder(Builder::Median))
}

/// Whether corners lie on no line, in numbers without rounding.
fn has_area_exactly(t: [[f32; 3]; 3]) -> bool {
    let [a, b, c] = t.map(|p| p.map(rational));
    (0..3).any(|i| {
        let j = (i + 1) % 3;
        let det = (&a[i] - &c[i]) * (&b[j] - &c[j]) - (&a[j] - &c[j]) * (&b[i] - &c[i]);
        !det.is_zero()
    })
}

fn area_of_bits(t: [[f32; 3]; 3]) -> bool {
    let [a, b, c] = t.map(|p| UVec3::from_array(p.map(f32::to_bits)));
    has_area(a, b, c, 1)
}

/// Any finite number, small integers times a power of two, or a neighbour of such.
fn coordinate(random: &mut Random, exponent: i32) -> f32 {
    let bits = random.bits();
    let whole = (bits >> 32) as i64 % 9;
    let number = (whole as f64 * f64::from(exponent).exp2()) as f32;
    match bits % 16 {
        0 => f32::from_bits((bits >> 8) as u32 & 0xBFFF_FFFF),
        1 => number.next_up(),
        2 => -0.0,
        3 => f32::from_bits((bits >> 40) as u32 & 0x8000_00FF),
        _ => number,
    }
}

#[test]
fn area_is_told_exactly() {
    let mut random = Random::new(5);
    let (mut flat, mut number) = (0, 0);
    for i in 0..60_000 {
        let exponent = i % 270 - 148;
        let mut t = [(); 3].map(|()| [(); 3].map(|()| coordinate(&mut random, exponent)));
        if i % 3 == 0 {
            // On a line, or next to it where the multiple is rounded.
            let (a, d, times) = (t[0], t[1], (random.bits() % 5) as f32);
            t[1] = [0, 1, 2].map(|k| a[k] + d[k]);
            t[2] = [0, 1, 2].map(|k| a[k] + times * d[k]);
        }
        if t.as_flattened().iter().all(|x| x.is_finite()) {
            let expected = has_area_exactly(t);
            assert_eq!(area_of_bits(t), expected, "{t:?}");
            flat += u32::from(!expected);
            number += 1;
        }
    }
    assert!(number > 40_000 && flat > 5000 && flat < number - 5000, "{flat} of {number} without area");
}

/// Neighbours of a line, which rounded products take for points on it, and the other way round.
#[test]
fn needles_have_area() {
    for (t, expected) in [
        ([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1f32.next_up(), 0.0]], true),
        ([[1.0, 1.0, 1.0], [3.0, 3.0, 3.0], [2.0, 2.0, 2f32.next_down()]], true),
        ([[0.0, 0.0, 0.0], [1e-45, 0.0, 0.0], [0.0, 0.0, 1e-45]], true),
        ([[f32::MAX, 0.0, 0.0], [f32::MIN, 0.0, 0.0], [0.0, 1e-45, 0.0]], true),
        ([[f32::MAX, 0.0, 0.0], [f32::MIN, 0.0, 0.0], [0.0, -0.0, 0.0]], false),
        ([[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.4, 0.4, 0.4]], false),
        ([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [7.0, 8.0, 9.5]], false),
    ] {
        assert_eq!((has_area_exactly(t), area_of_bits(t)), (expected, expected), "{t:?}");
    }
}

/// The first vertex, else the first triangle, is named as for a mesh of the host.
#[test]
fn what_is_no_mesh_is_refused() -> Result<(), Failure> {
    let whole = arrays(&Recipe { family: Family::Soup, size: 3000, seed: 1 }.mesh());
    let spoil = |change: &dyn Fn(&mut Arrays)| {
        let mut arrays = whole.clone();
        change(&mut arrays);
        arrays
    };
    let spoilt = [
        spoil(&|(p, _)| p[4000][1] = f32::NAN),
        spoil(&|(p, _)| (p[4000][2], p[5000][0]) = (f32::NEG_INFINITY, f32::NAN)),
        spoil(&|(_, t)| t[2500][2] = 9000),
        spoil(&|(_, t)| (t[2500][2], t[2501][0]) = (u32::MAX, 9000)),
        spoil(&|(p, t)| (p[8999][2], t[0][0]) = (f32::INFINITY, u32::MAX)),
        spoil(&|(p, _)| p.as_flattened_mut().iter_mut().for_each(|x| *x *= 1e-43)),
        (whole.0.clone(), Vec::new()),
    ];
    for arrays in &spoilt {
        assert!(Mesh::new(arrays.0.clone(), arrays.1.clone()).is_err());
        for named in devices() {
            compare(&named.device, arrays, &BuildOptions::default())?;
        }
    }
    Ok(())
}

/// All queries, also those that need what only the host had.
#[test]
fn all_queries_find_the_same() -> Result<(), Failure> {
    let arrays = arrays(&Recipe { family: Family::Holes, size: 200, seed: 2 }.mesh());
    let mesh = Mesh::new(arrays.0.clone(), arrays.1.clone()).map_err(Error::from)?;
    let rays = random(mesh.bounds(), 300, 1);
    let expected = Scene::build(cpu(), &mesh, &BuildOptions::default())?;
    for device in [cpu(), gpu()] {
        let mut scene = built_from(device, &arrays, &BuildOptions::default())?;
        for &traversal in Traversal::ALL {
            scene.traverse_by(traversal)?;
            same(traversal.name(), &expected.closest(&rays)?, &scene.closest(&rays)?)?;
        }
        let brute = scene.steps(&rays)?.steps;
        assert!(scene.traversal() != Traversal::Brute || brute[0].tests == mesh.kept().len() as u32);
        same("brute", &expected.brute(&rays)?, &scene.brute(&rays)?)?;
        assert_eq!(expected.all(&rays, 4)?.hits, scene.all(&rays, 4)?.hits);
        scene.tree()?.check_mesh(&mesh)?;
        let tracer = scene.tracer()?;
        assert_eq!(tracer.closest(&rays[0]), expected.tracer()?.closest(&rays[0]));
    }
    Ok(())
}

/// A program's buffers: the mesh in parts of one, behind something else.
fn own(device: &wgpu::Device, (positions, triangles): &Arrays) -> (wgpu::Buffer, u64, u64) {
    let mut bytes = vec![0xFFu8; 256];
    bytes.extend_from_slice(bytemuck::cast_slice(positions));
    let end = bytes.len() as u64;
    bytes.resize(bytes.len().next_multiple_of(256), 0xFF);
    let next = bytes.len() as u64;
    bytes.extend_from_slice(bytemuck::cast_slice(triangles));
    let init = wgpu::util::BufferInitDescriptor { label: None, contents: &bytes, usage: Use::STORAGE };
    (device.create_buffer_init(&init), end, next)
}

fn read<T: bytemuck::Pod>(device: &Device, from: &wgpu::Buffer) -> Vec<T> {
    let (device, queue) = device.wgpu().expect("a GPU");
    let to = wgpu::BufferDescriptor {
        label: None,
        size: from.size(),
        usage: Use::COPY_DST | Use::MAP_READ,
        mapped_at_creation: false,
    };
    let to = device.create_buffer(&to);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(from, 0, &to, 0, from.size());
    queue.submit([encoder.finish()]);
    to.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("mapped"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("it goes on");
    bytemuck::pod_collect_to_vec(&to.slice(..).get_mapped_range().expect("mapped"))
}

/// The first `count` words of a buffer.
fn words(device: &Device, from: &wgpu::Buffer, count: usize) -> Vec<u32> {
    let mut words = read(device, from);
    words.truncate(count);
    words
}

/// A device of the test's own, whose bytes nobody else moves.
fn alone() -> Result<Device, Error> {
    Device::gpu(None)
}

#[test]
fn a_scene_of_own_buffers_is_the_usual_one() -> Result<(), Failure> {
    let device = &alone()?;
    let (theirs, _) = device.wgpu().expect("a GPU");
    for (family, scale) in [(Family::Holes, 1.0), (Family::Soup, 1e-40), (Family::Slivers, 1e37)] {
        let mut arrays = arrays(&Recipe { family, size: 500, seed: 3 }.mesh());
        arrays.0.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
        let (buffer, end, next) = own(theirs, &arrays);
        let options = BuildOptions::default();
        let found = Scene::build_on(device, buffer.slice(256..end), buffer.slice(next..), &options)?;
        let expected = built(device, &arrays, &options)?;
        let (a, b) = (expected.buffers()?, found.buffers()?);
        same::<TreeHeader>("header", &read(device, a.header), &read(device, b.header))?;
        let (header, mesh) = (found.header(), (arrays.0.len(), arrays.1.len()));
        let start = |buffer, count| words(device, buffer, count);
        same(
            "nodes",
            &start(a.nodes, 2 * header.nodes as usize),
            &start(b.nodes, 2 * header.nodes as usize),
        )?;
        same("references", &start(a.refs, header.refs as usize), &start(b.refs, header.refs as usize))?;
        let leaves = header.refs as usize * size_of::<LeafTriangle>() / 4;
        same("corners", &start(a.corners, leaves), &start(b.corners, leaves))?;
        same("positions", &start(a.positions, 3 * mesh.0), &start(b.positions, 3 * mesh.0))?;
        same("indices", &start(a.indices, 3 * mesh.1), &start(b.indices, 3 * mesh.1))?;
    }
    Ok(())
}

#[test]
fn buffers_that_cannot_be_used_are_refused() -> Result<(), Failure> {
    let device = &alone()?;
    let (theirs, _) = device.wgpu().expect("a GPU");
    let arrays = arrays(&Mesh::teapot(2));
    let (buffer, end, next) = own(theirs, &arrays);
    let other =
        wgpu::BufferDescriptor { label: None, size: 120, usage: Use::COPY_SRC, mapped_at_creation: false };
    let other = theirs.create_buffer(&other);
    let options = BuildOptions::default();
    for (on, positions, indices, word) in [
        (device, buffer.slice(256..end), other.slice(..), "STORAGE"),
        (device, buffer.slice(12..24), buffer.slice(next..), "begins at byte 12"),
        (device, buffer.slice(256..end - 4), buffer.slice(next..), "no whole number of vertices"),
        (
            device,
            buffer.slice(256..end),
            buffer.slice(next..buffer.size() - 8),
            "no whole number of triangles",
        ),
        (device, buffer.slice(256..268), buffer.slice(next..), "out of range"),
        (cpu(), buffer.slice(256..end), buffer.slice(next..), "the CPU"),
    ] {
        let error = Scene::build_on(on, positions, indices, &options).expect_err(word).to_string();
        assert!(error.contains(word), "{error}");
    }
    let stranger = alone()?;
    let (strange, ..) = own(stranger.wgpu().expect("a GPU").0, &arrays);
    Scene::build_on(device, strange.slice(256..end), strange.slice(next..), &options)
        .expect_err("of another device");
    // The device is none the worse for it.
    Scene::build_on(device, buffer.slice(256..end), buffer.slice(next..), &options)?;
    Ok(())
}

/// The bytes of a scene's tree, and its hits.
fn told(scene: &Scene) -> Result<(KdTree, Vec<Hit>), Error> {
    let (lo, hi) = (scene.header().lo, scene.header().hi);
    Ok((scene.tree()?, scene.closest(&random((lo, hi), 200, 1))?))
}

/// Meshes that change, some with more triangles, the old scene kept until the new one is there: what another scene left
/// in the memory shows in none.
#[test]
fn scenes_in_memory_used_again_are_the_usual_ones() -> Result<(), Failure> {
    let device = alone()?.recycling();
    for builder in [Builder::Binned, Builder::Exact, Builder::Median] {
        let options = BuildOptions::default().with_builder(builder);
        let mut old: Option<(Scene, (KdTree, Vec<Hit>))> = None;
        for (family, size) in [
            (Family::Soup, 900),
            (Family::Holes, 300),
            (Family::Lattice, 700),
            (Family::Nothing, 50),
            (Family::Slivers, 1500),
            (Family::Soup, 1400),
        ] {
            let arrays = arrays(&Recipe { family, size, seed: 5 }.mesh());
            let scene = built_from(&device, &arrays, &options)?;
            let expected = told(&built(cpu(), &arrays, &options)?)?;
            assert!(told(&scene)? == expected, "{builder}: {family:?} of {size}");
            same("header", &[*scene.header()], &read(&device, scene.buffers()?.header)[..1])?;
            if let Some((scene, before)) = old.replace((scene, expected)) {
                assert!(told(&scene)? == before, "{builder}: the scene before {family:?} changed");
            }
        }
    }
    Ok(())
}

/// Deep trees after flat ones, on a device that expects a tree like the last one: it looks again where levels are
/// missing. Triangles that halve in size, some of each, have more levels than any device expects.
#[test]
fn deep_trees_after_flat_ones_are_the_usual_ones() -> Result<(), Failure> {
    let fresh = alone()?;
    let device = fresh.recycling();
    let flat = arrays(&Recipe { family: Family::Lattice, size: 200, seed: 5 }.mesh());
    let chain = |each: u16| {
        let corners = (0..22 * each).flat_map(|k| {
            let (size, place) = (0.5f32.powi(i32::from(k / each)), f32::from(k % each) / f32::from(each));
            let (x, y) = (size * (1.0 + 0.5 * place), size * place);
            let far = size / 64.0;
            [[x, y, x], [x + far, y, x], [x, y + far, x + far]]
        });
        let positions: Vec<_> = corners.collect();
        let triangles = (0..positions.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        (positions, triangles)
    };
    for deep in [arrays(&Mesh::teapot(8)), chain(2), chain(40)] {
        for builder in [Builder::Binned, Builder::Median] {
            for max_depth in [40, 7] {
                let options = BuildOptions::default().with_builder(builder).with_max_depth(max_depth);
                for (device, mesh) in [(&device, &flat), (&device, &deep), (&device, &deep), (&fresh, &deep)]
                {
                    let expected = built(cpu(), mesh, &options)?.tree()?;
                    let found = built_from(device, mesh, &options)?.tree()?;
                    assert!(found == expected, "{builder}, {max_depth}");
                }
            }
        }
    }
    Ok(())
}

/// A mesh of which most vertices are a little farther up than in the frame before.
fn frame(mesh: &Mesh, number: u16) -> Arrays {
    let mut arrays = arrays(mesh);
    for (i, p) in (0u8..7).cycle().zip(&mut arrays.0) {
        p[1] += (0.1 + 0.001 * f32::from(number)) * f32::from(i);
    }
    arrays
}

/// A mesh like the one before is surveyed, built and laid out while the host waits once: what comes back are the words
/// of the survey, of the levels, and the times of one run.
#[test]
fn the_next_frame_is_waited_for_once() -> Result<(), Failure> {
    let alone = alone()?;
    let gpu = alone.as_gpu().expect("a GPU");
    let once = (size_of::<Found>() + size_of::<State>() + 16) as u64;
    for (builder, mesh) in [
        (Builder::Binned, Mesh::teapot(8)),
        (Builder::Median, Mesh::teapot(2)),
        (Builder::Zhou, Mesh::teapot(8)),
        // The root is a treelet.
        (Builder::Binned, Recipe { family: Family::Soup, size: 20, seed: 1 }.mesh()),
    ] {
        let (device, options) = (alone.recycling(), BuildOptions::default().with_builder(builder));
        for number in 0..4 {
            let arrays = frame(&mesh, number);
            let (found, [_, back]) = crossing(gpu, || built_from(&device, &arrays, &options));
            assert_eq!(back == once, number > 0, "{builder}, frame {number}: {back} bytes came back");
            let (found, expected) = (found?, built(cpu(), &arrays, &options)?);
            same("header", &[*found.header()], &read(&device, found.buffers()?.header)[..1])?;
            assert!(told(&found)? == told(&expected)?, "{builder}, frame {number}");
        }
    }
    Ok(())
}

/// A mesh that is not like the one before, as was expected, is built or refused like any other.
#[test]
fn surprises_are_found_out() -> Result<(), Failure> {
    let alone = alone()?;
    let gpu = alone.as_gpu().expect("a GPU");
    let usual = arrays(&Recipe { family: Family::Soup, size: 600, seed: 4 }.mesh());
    let spoil = |change: &dyn Fn(&mut Arrays)| {
        let mut arrays = usual.clone();
        change(&mut arrays);
        arrays
    };
    // As many take part as without one of them that has no area.
    let thin = spoil(&|(_, t)| t[599][2] = t[599][0]);
    let scaled = |by: f32| spoil(&|(p, _)| p.as_flattened_mut().iter_mut().for_each(|x| *x *= by));
    let options = BuildOptions::default();
    let device = alone.recycling();
    let once = (size_of::<Found>() + size_of::<State>() + 16) as u64;
    for (what, arrays) in [
        ("no number", spoil(&|(p, _)| p[700][1] = f32::NAN)),
        ("no vertex", spoil(&|(_, t)| t[599][2] = u32::MAX)),
        ("no vertex for what took no part", spoil(&|(_, t)| t[599][2] = u32::MAX)),
        ("no number that is used", spoil(&|(p, _)| p.extend([[f32::NAN; 3]]))),
        ("no area", spoil(&|(_, t)| t[17][2] = t[17][0])),
        ("dust", spoil(&|(p, _)| p[300][0] = 1e-30)),
        ("subnormal", spoil(&|(p, _)| p[300][0] = 1e-40)),
        ("small", scaled(1e-20)),
        ("large", scaled(1e20)),
        ("huge", scaled(1e36)),
        ("larger tree", spoil(&|(p, _)| p.iter_mut().for_each(|p| p[2] *= 1e-3))),
    ] {
        let before = if what.ends_with("no part") { &thin } else { &usual };
        built_from(&device, before, &options)?;
        let (_, [_, back]) = crossing(gpu, || built_from(&device, &arrays, &options));
        assert!(back > once, "{what}: {back} bytes came back");
        for device in [&device, &cpu().expecting()] {
            built_from(device, before, &options)?;
            compare(device, &arrays, &options).map_err(|e| Failure(format!("{what}: {e}")))?;
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(128))]
    /// The same by chance, with extents that are powers of two or next to one.
    #[test]
    fn worn_meshes_after_usual_ones_are_the_usual_ones(recipe in small_mesh(), seed: u64, power in any::<bool>()) {
        static DEVICE: LazyLock<Device> = LazyLock::new(|| alone().expect("a GPU").recycling());
        let mut usual = arrays(&recipe.mesh());
        let options = BuildOptions::default();
        if power {
            let mut random = Random::new(seed);
            let most = (20.0 * random.unit() - 5.0).floor().exp2() as f32;
            let least = [0.0, -0.0, 1e-17, -1e-17, 1e-10, -1e-10, 1e-6][random.bits() as usize % 7] * most;
            let most = [most, most.next_down(), most.next_up()][random.bits() as usize % 3];
            for x in usual.0.as_flattened_mut() {
                *x = if random.unit() < 0.3 { most } else { x.clamp(least.min(most), most) };
                *x = if random.unit() < 0.3 { least } else { *x };
            }
            // Dust, if the extent is not less than that power, which nobody uses.
            usual.0.extend([[0.75 * (-60f32).exp2() * most.next_up(); 3]]);
        }
        let worn = if power { usual.clone() } else { worn(usual.clone(), seed) };
        let on_cpu = cpu().expecting();
        for (arrays, times) in [(&usual, 1), (&worn, 2)] {
            let (expected, fresh) = (built(cpu(), arrays, &options), built_from(gpu(), arrays, &options));
            for _ in 0..times {
                agree(&expected, &built_from(&on_cpu, arrays, &options))?;
                let found = built_from(&DEVICE, arrays, &options);
                agree(&expected, &found)?;
                if let (Ok(fresh), Ok(found)) = (&fresh, &found) {
                    let (a, b) = (fresh.buffers()?, found.buffers()?);
                    let coordinates = 3 * arrays.0.len();
                    let [expected, found] = [(gpu(), a.positions), (&*DEVICE, b.positions)]
                        .map(|(device, positions)| words(device, positions, coordinates));
                    same("positions", &expected, &found)?;
                    same("header", &words(gpu(), a.header, 16), &words(&DEVICE, b.header, 16))?;
                }
            }
        }
    }
}

/// Nobody gets what somebody else has.
#[test]
fn threads_may_share_recycled_memory() -> Result<(), Failure> {
    let device = alone()?.recycling();
    std::thread::scope(|scope| {
        let work = |seed| {
            let device = &device;
            move || -> Result<(), Failure> {
                for size in [200, 300, 250, 350] {
                    compare(
                        device,
                        &arrays(&Recipe { family: Family::Soup, size, seed }.mesh()),
                        &BuildOptions::default(),
                    )?;
                }
                Ok(())
            }
        };
        let threads = [1, 2, 3].map(|seed| scope.spawn(work(seed)));
        threads.into_iter().try_for_each(|thread| thread.join().expect("no panic"))
    })
}

/// Builds five frames, each while the scene before is there. Those from the third on take no memory.
fn builds_in_place(
    what: &str,
    gpu: &Gpu,
    build: impl Fn(u16) -> Result<Scene, Error>,
) -> Result<(), Failure> {
    let mut old = None;
    for frame in 0..5 {
        let before = gpu.allocated();
        let scene = build(frame)?;
        let allocated = gpu.allocated() - before;
        if (allocated == 0) != (frame >= 2) {
            return Err(Failure(format!("{what}, frame {frame}: {allocated} buffers")));
        }
        drop(old.replace(scene));
    }
    Ok(())
}

#[test]
fn few_rays_allocate_nothing() -> Result<(), Failure> {
    let alone = alone()?;
    let gpu = alone.as_gpu().expect("a GPU");
    let mesh = Mesh::teapot(6);
    let (scene, usual) = (Scene::build(&alone, &mesh, &BuildOptions::default())?, cpu());
    let usual = Scene::build(usual, &mesh, &BuildOptions::default())?;
    // Of many the memory is not kept; those of fewer rays find what others left, more than they need.
    for (count, is_kept) in [(300, true), (1 << 15, true), (7, true), (300, true), (1 + (1 << 15), false)] {
        let rays = random(mesh.bounds(), count, 1);
        let expected = usual.crossings(&rays)?.counts;
        for round in 0..2 {
            let before = gpu.allocated();
            assert!(scene.closest(&rays)? == usual.closest(&rays)?, "{count} rays");
            assert!(scene.crossings(&rays)?.counts == expected, "{count} rays");
            let allocated = gpu.allocated() - before;
            if (allocated == 0) != is_kept && round > 0 {
                return Err(Failure(format!("{count} rays: {allocated} buffers")));
            }
        }
    }
    let rays = random(mesh.bounds(), 8000, 1);
    for (hits, is_kept) in [(4, true), (5, false)] {
        assert!(scene.all(&rays, hits)?.hits == usual.all(&rays, hits)?.hits);
        let before = gpu.allocated();
        scene.all(&rays, hits)?;
        let allocated = gpu.allocated() - before;
        assert_eq!(allocated == 0, is_kept, "{hits} hits a ray: {allocated} buffers");
    }
    Ok(())
}

#[test]
fn hits_alone_bring_no_times() -> Result<(), Failure> {
    let alone = alone()?;
    let gpu = alone.as_gpu().expect("a GPU");
    let mesh = Mesh::teapot(6);
    let scene = Scene::build(&alone, &mesh, &BuildOptions::default())?;
    let rays = random(mesh.bounds(), 300, 1);
    let brought = |query: &mut dyn FnMut() -> Result<Vec<Hit>, Error>| {
        let before = gpu.crossed()[1];
        query().map(|hits| (hits, gpu.crossed()[1] - before))
    };
    let (timed, all) = brought(&mut || {
        let traced = scene.trace(Query::Closest, &rays)?;
        assert!(!traced.times.trace.is_zero());
        Ok(traced.hits)
    })?;
    let (hits, alone) = brought(&mut || scene.closest(&rays))?;
    assert!(hits == timed);
    // With the hits comes what became of them; two timestamps take 8 bytes each.
    assert_eq!((alone, all), (300 * 16 + 16, 300 * 16 + 16 + 2 * 8));
    Ok(())
}

#[test]
fn rebuilding_allocates_nothing() -> Result<(), Failure> {
    let alone = alone()?;
    let (theirs, _) = alone.wgpu().expect("a GPU");
    let gpu = alone.as_gpu().expect("a GPU");
    let mesh = Mesh::teapot(8);
    for &builder in Builder::ALL {
        let (device, options) = (alone.recycling(), BuildOptions::default().with_builder(builder));
        builds_in_place(&format!("{builder} on the device"), gpu, |frame| {
            // It moves, and so do planes.
            let (buffer, end, next) = own(theirs, &self::frame(&mesh, frame));
            Scene::build_on(&device, buffer.slice(256..end), buffer.slice(next..), &options)
        })?;
        let device = alone.recycling();
        builds_in_place(&format!("{builder}"), gpu, |_| Scene::build(&device, &mesh, &options))?;
    }
    Ok(())
}

/// A scene that moves, by the host's numbers and by the device's, while a thread traces its last frame.
#[test]
fn rebuilt_scenes_are_the_usual_ones_and_allocate_nothing() -> Result<(), Failure> {
    let alone = alone()?;
    let (theirs, _) = alone.wgpu().expect("a GPU");
    let gpu = alone.as_gpu().expect("a GPU");
    let options = BuildOptions::default();
    for (traversal, on_device) in [
        (Traversal::Stack, false),
        (Traversal::Stack, true),
        (Traversal::Backtrack, true),
        (Traversal::OptimisedRopes, false),
    ] {
        let frame = |number: u16| frame(&Mesh::teapot(6), number);
        let usual = |number| told(&built(cpu(), &frame(number), &options)?);
        let mut scene = built(&alone, &frame(0), &options)?;
        scene.traverse_by(traversal)?;
        for number in 1..6 {
            let (arrays, old) = (frame(number), scene.clone());
            let (buffer, end, next) = own(theirs, &arrays);
            let mesh = Mesh::new(arrays.0.clone(), arrays.1.clone()).map_err(Error::from)?;
            let before = gpu.allocated();
            match on_device {
                true => scene.rebuild_on(buffer.slice(256..end), buffer.slice(next..), &options)?,
                false => scene.rebuild(&mesh, &options)?,
            }
            let allocated = gpu.allocated() - before;
            if (allocated == 0) != (number > 2) {
                return Err(Failure(format!("{traversal}, rebuild {number}: {allocated} buffers")));
            }
            assert!(
                told(&old)? == usual(number - 1)?,
                "{traversal}: the scene before frame {number} changed"
            );
            assert!(told(&scene)? == usual(number)?, "{traversal}: frame {number}");
            assert_eq!(scene.traversal(), traversal);
        }
        // A clone is traced meanwhile.
        let mut next = scene.clone();
        std::thread::scope(|threads| -> Result<(), Failure> {
            let tracing = threads.spawn(|| (0..5).map(|_| told(&scene)).collect::<Result<Vec<_>, _>>());
            for number in [6, 7, 8] {
                next.rebuild(&Mesh::new(frame(number).0, frame(number).1).map_err(Error::from)?, &options)?;
            }
            let (traced, usual) = (tracing.join().expect("no panic")?, usual(5)?);
            assert!(traced.iter().all(|it| *it == usual), "{traversal}: a clone changed");
            Ok(())
        })?;
        assert!(told(&next)? == usual(8)?);
        // What fails changes nothing.
        let (buffer, ..) = own(theirs, &frame(0));
        assert!(scene.rebuild_on(buffer.slice(..13), buffer.slice(..12), &options).is_err());
        assert!(told(&scene)? == usual(5)?);
    }
    Ok(())
}

/// What may be done to a scene in memory used again.
#[derive(Clone, Debug)]
enum Act {
    /// It becomes that of another mesh.
    Become(Recipe),
    /// It becomes that of the same mesh, which has moved, lost a triangle or got one more, or is worn.
    Change(u8, u64),
    /// It is to become that of what is no mesh, in one way or another.
    Spoil(u8),
    /// A clone stays.
    Keep,
    /// The oldest clone goes.
    Forget,
    Ask(Traversal, Intersector),
}

fn act() -> impl Strategy<Value = Act> {
    let traversal = prop::sample::select(Traversal::ALL.to_vec());
    let intersector = prop::sample::select(Intersector::ALL.to_vec());
    prop_oneof![
        3 => small_mesh().prop_map(Act::Become),
        6 => (0u8..5, any::<u64>()).prop_map(|(how, seed)| Act::Change(how, seed)),
        2 => (0u8..6).prop_map(Act::Spoil),
        2 => Just(Act::Keep),
        1 => Just(Act::Forget),
        2 => (traversal, intersector).prop_map(|(traversal, test)| Act::Ask(traversal, test)),
    ]
}

/// Acts with options for a build, and whether the mesh lies on the device.
fn acts() -> impl Strategy<Value = Vec<(Act, BuildOptions, bool)>> {
    let options = any_options(prop::sample::select(Builder::ALL.to_vec()));
    prop::collection::vec((act(), options, any::<bool>()), 2..10)
}

/// All that a scene keeps of mesh and tree, as in its file, and its hits.
type Told = (Vec<u8>, Vec<Hit>);

fn all_of(scene: &Scene) -> Result<Told, Failure> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.scene");
    scene.save(&path)?;
    let (lo, hi, scale) = (scene.header().lo, scene.header().hi, scene.header().scale);
    let bounds = (lo.map(|x| x / scale), hi.map(|x| x / scale));
    Ok((std::fs::read(path).expect("a file"), scene.closest(&random(bounds, 100, 1))?))
}

/// The same of a scene that is built of these numbers on the CPU, for the first time.
fn fresh(arrays: &Arrays, options: &BuildOptions, of: &Scene) -> Result<Told, Failure> {
    let mut scene = built(cpu(), arrays, options)?;
    scene.traverse_by(of.traversal())?;
    scene.intersect_by(of.intersector())?;
    all_of(&scene)
}

/// Another mesh of nearly the same numbers.
fn changed(arrays: &Arrays, how: u8, seed: u64) -> Arrays {
    let (mut positions, mut triangles) = arrays.clone();
    let mut random = Random::new(seed);
    match how {
        0 => positions.iter_mut().for_each(|p| p[1] *= 1.0 + 0.01 * random.unit() as f32),
        1 if triangles.len() > 1 => drop(triangles.pop()),
        1 | 2 => triangles.push([0, 1, 2].map(|_| random.below(positions.len()) as u32)),
        3 => triangles.reverse(),
        _ => (positions, triangles) = worn((positions, triangles), seed),
    }
    (positions, triangles)
}

/// Numbers that are no mesh.
fn spoilt(arrays: &Arrays, how: u8) -> Arrays {
    let (mut positions, mut triangles) = arrays.clone();
    let last = positions.len() - 1;
    match how {
        0 => positions[last][2] = f32::NAN,
        1 => positions[last / 2][0] = f32::INFINITY,
        2 => triangles[0][1] = positions.len() as u32,
        3 => triangles.push([u32::MAX; 3]),
        4 => positions.truncate(1),
        _ => positions.as_flattened_mut().iter_mut().for_each(|x| *x = x.signum() * 1e-44),
    }
    (positions, triangles)
}

proptest! {
    #![proptest_config(cases(4))]
    /// Whatever is done to a scene, one after the other, it is the scene that a first build makes, and so is each
    /// clone; and what fails changes nothing. Meanwhile a thread traces the scene as it was.
    #[test]
    fn a_scene_that_went_through_anything_is_a_fresh_one(
        recipe in small_mesh(),
        acts in acts(),
    ) {
        let (theirs, _) = gpu().wgpu().expect("a GPU");
        let mut now = (arrays(&recipe.mesh()), BuildOptions::default());
        let mut scene = built(gpu(), &now.0, &now.1)?;
        let mut kept: Vec<(Scene, Told)> = Vec::new();
        for (act, options, on_device) in acts {
            let arrays = match act {
                Act::Become(recipe) => arrays(&recipe.mesh()),
                Act::Change(how, seed) => changed(&now.0, how, seed),
                Act::Spoil(how) => spoilt(&now.0, how),
                Act::Keep => {
                    kept.push((scene.clone(), fresh(&now.0, &now.1, &scene)?));
                    continue;
                }
                Act::Forget => {
                    if !kept.is_empty() {
                        kept.remove(0);
                    }
                    continue;
                }
                Act::Ask(traversal, test) => {
                    scene.intersect_by(Intersector::Strict)?;
                    scene.traverse_by(traversal)?;
                    if test.goes_with(traversal).is_ok() {
                        scene.intersect_by(test)?;
                    }
                    continue;
                }
            };
            let mesh = Mesh::new(arrays.0.clone(), arrays.1.clone());
            let old = scene.clone();
            let rebuilt = std::thread::scope(|threads| {
                let tracing = threads.spawn(|| all_of(&old));
                let rebuilt = match (&mesh, on_device) {
                    (Ok(mesh), false) => scene.rebuild(mesh, &options),
                    (Err(_), false) => Ok(()),
                    _ => {
                        let (buffer, end, next) = own(theirs, &arrays);
                        scene.rebuild_on(buffer.slice(256..end), buffer.slice(next..), &options)
                    }
                };
                let traced = tracing.join().expect("no panic")?;
                Ok::<_, Failure>((rebuilt, traced))
            })?;
            let (rebuilt, traced) = rebuilt;
            prop_assert!(traced == fresh(&now.0, &now.1, &old)?, "the scene before");
            match (mesh, rebuilt) {
                (Ok(_), rebuilt) => {
                    rebuilt?;
                    now = (arrays, options);
                }
                (Err(expected), Err(found)) => prop_assert_eq!(expected.to_string(), found.to_string()),
                (Err(expected), Ok(())) => prop_assert!(!on_device, "{}", expected),
            }
            drop(old);
            prop_assert!(all_of(&scene)? == fresh(&now.0, &now.1, &scene)?, "the scene");
            for (clone, expected) in &kept {
                prop_assert!(all_of(clone)? == *expected, "a clone");
            }
        }
    }
}

/// What crosses the bus while `act` runs.
fn crossing<R>(gpu: &Gpu, act: impl FnOnce() -> R) -> (R, [u64; 2]) {
    let before = gpu.crossed();
    let result = act();
    let after = gpu.crossed();
    (result, [0, 1].map(|way| after[way] - before[way]))
}

/// Some words come back, as many whatever the mesh. None of it goes to the device: that gets what the level loop starts
/// with, zeros for each block of its lists.
#[test]
fn nothing_of_the_mesh_crosses_the_bus() -> Result<(), Failure> {
    let device = &alone()?;
    let (theirs, _) = device.wgpu().expect("a GPU");
    let gpu = device.as_gpu().expect("a GPU");
    let mut back = Vec::new();
    for level in [10, 40] {
        let arrays = arrays(&Mesh::teapot(level));
        let (buffer, end, next) = own(theirs, &arrays);
        let build = || {
            let (positions, indices) = (buffer.slice(256..end), buffer.slice(next..));
            Scene::build_on(device, positions, indices, &BuildOptions::default())
        };
        let (scene, [to, from]) = crossing(gpu, build);
        assert_eq!(scene?.times().retries, 0);
        let triangles = arrays.1.len() as u64;
        println!("{triangles} triangles: {to} bytes to the device, {from} back");
        assert!(to < 700 + triangles / 4, "{to} bytes went to the device for {triangles} triangles");
        back.push(from);
        let mesh = Mesh::new(arrays.0.clone(), arrays.1.clone()).map_err(Error::from)?;
        let (_, [to, _]) = crossing(gpu, || Scene::build(device, &mesh, &BuildOptions::default()));
        assert!(to > triangles * 12, "the bytes of the usual way are not counted: {to}");
    }
    // What the survey found, what the level loop made of it, and the times of three runs.
    let words = size_of::<Found>() + size_of::<State>() + 3 * 16;
    assert_eq!(back, [words as u64; 2]);
    Ok(())
}

/// The median of some durations in milliseconds.
fn median(mut times: Vec<Duration>) -> f64 {
    times.sort_unstable();
    times[times.len() / 2].as_secs_f64() * 1e3
}

/// Prints what `build_on` takes by the clock on the wall, from vertices on the device to a scene that can be traced,
/// beside what its kernels take by the device's clock: of the scene that `RAYKD_SCENE` names, else of the dragon.
#[test]
#[ignore = "a measurement: RAYKD_SCENE=dragon cargo test --release --workspace --test build_on -- --ignored --nocapture"]
fn times_of_build_on() -> Result<(), Failure> {
    const ROUNDS: usize = 41;
    let name = std::env::var("RAYKD_SCENE").unwrap_or_else(|_| "dragon".to_owned());
    let mesh = name.parse::<MeshSource>().and_then(|source| source.load()).map_err(Error::from)?;
    let device = alone()?;
    let (theirs, _) = device.wgpu().expect("a GPU");
    let (buffer, end, next) = own(theirs, &arrays(&mesh));
    println!("{name}, {} triangles, {}; ms, medians of {ROUNDS}", mesh.triangles().len(), device.name());
    println!("                     wall  ready  kernels  layout  rest, nodes of eight: wall  kernels");
    let mut digests = Vec::new();
    for (what, on, own_buffers) in [
        ("build_on, recycling", device.recycling(), true),
        ("build_on           ", device.clone(), true),
        ("build              ", device.clone(), false),
    ] {
        let mut old = None;
        let mut times: [Vec<Duration>; 7] = Default::default();
        for round in 0..ROUNDS + 10 {
            let start = Instant::now();
            let options = BuildOptions::default();
            let mut scene = if own_buffers {
                Scene::build_on(&on, buffer.slice(256..end), buffer.slice(next..), &options)
            } else {
                Scene::build(&on, &mesh, &options)
            }?;
            let wall = start.elapsed();
            let start = Instant::now();
            scene.traverse_by(Traversal::Wide)?;
            let eight = start.elapsed();
            // The first compile kernels, and the clock of an idle card is low.
            if round >= 10 {
                let BuildTimes { upload, build, layout, prepare, .. } = *scene.times();
                let rest = wall.saturating_sub(build + layout);
                let all = [wall, upload, build, layout, rest, eight, prepare];
                for (list, time) in times.iter_mut().zip(all) {
                    list.push(time);
                }
            }
            old = Some(scene);
        }
        let [wall, ready, kernels, layout, rest, eight, prepare] = times.map(median);
        print!("{what} {wall:6.3} {ready:6.3}  {kernels:7.3}  {layout:6.3}  {rest:5.3}");
        println!("                  {eight:6.3}  {prepare:7.3}");
        digests.extend(old.map(|scene| scene.tree().map(|tree| tree.digest())).transpose()?);
    }
    assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
    Ok(())
}
