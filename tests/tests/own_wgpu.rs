//! raykd on a device of somebody else's, and on its buffers.

use raykd::{
    BuildOptions, Builder, Crossings, Device, Error, Hit, Intersector, Mesh, Query, Ray, RayCount, Scene,
    Traversal, internals::hits_digest, rays::random, wgpu,
};
use raykd_tests::{Failure, cpu, same};
use std::{collections::BTreeSet, sync::LazyLock};
use wgpu::{BufferUsages as Use, util::DeviceExt as _};

/// Sizes of buffers after a slice of which the next may start.
const ALIGNED: u64 = 256;

fn adapter() -> wgpu::Adapter {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).expect("an adapter")
}

fn request(
    required_features: wgpu::Features,
    required_limits: wgpu::Limits,
) -> Result<(wgpu::Device, wgpu::Queue), wgpu::RequestDeviceError> {
    pollster::block_on(adapter().request_device(&wgpu::DeviceDescriptor {
        required_features,
        required_limits,
        // SAFETY: raykd's kernels keep to their buffers.
        experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
        ..Default::default()
    }))
}

/// A program's own device, with the least that raykd needs, and a scene on it.
struct Own {
    device: wgpu::Device,
    queue: wgpu::Queue,
    mesh: Mesh,
    scene: Scene,
}

static OWN: LazyLock<Own> = LazyLock::new(|| {
    let limits = raykd::required_limits(wgpu::Limits::default());
    let (device, queue) = request(raykd::required_features(), limits).expect("the least that is needed");
    let raykd = Device::from_wgpu(&device, &queue).expect("it has what is needed");
    assert_eq!(raykd.wgpu().map(|(device, _)| device), Some(&device));
    let mesh = Mesh::teapot(6);
    let scene = Scene::build(&raykd, &mesh, &BuildOptions::default()).expect("a scene");
    Own { device, queue, mesh, scene }
});

impl Own {
    fn buffer<T: bytemuck::Pod>(&self, contents: &[T], usage: Use) -> wgpu::Buffer {
        let contents = bytemuck::cast_slice(contents);
        self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    }

    fn read<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Vec<T> {
        let to = self.buffer(&vec![0u8; buffer.size() as usize], Use::COPY_DST | Use::MAP_READ);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &to, 0, buffer.size());
        self.queue.submit([encoder.finish()]);
        to.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("mapped"));
        self.device.poll(wgpu::PollType::wait_indefinitely()).expect("it goes on");
        bytemuck::pod_collect_to_vec(&to.slice(..).get_mapped_range().expect("mapped"))
    }

    fn encode(&self, act: impl FnOnce(&mut wgpu::CommandEncoder)) {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        act(&mut encoder);
        self.queue.submit([encoder.finish()]);
    }
}

fn expected(query: Query, rays: &[Ray]) -> Vec<Hit> {
    expected_by(Traversal::Stack, query, rays)
}

fn expected_by(traversal: Traversal, query: Query, rays: &[Ray]) -> Vec<Hit> {
    let mut scene = Scene::build(cpu(), &OWN.mesh, &BuildOptions::default()).expect("a scene");
    scene.traverse_by(traversal).expect("it goes");
    scene.trace(query, rays).expect("hits").hits
}

/// Two queries in one submission, each with a count of its own, on parts of buffers.
#[test]
fn hits_in_own_buffers_are_those_of_the_batch() -> Result<(), Failure> {
    [Traversal::Stack, Traversal::Wide].into_iter().try_for_each(hits_in_own_buffers)
}

fn hits_in_own_buffers(traversal: Traversal) -> Result<(), Failure> {
    let own = &*OWN;
    let mut scene = own.scene.clone();
    scene.traverse_by(traversal)?;
    let mut rays = random(own.mesh.bounds(), 3000, 1);
    rays[17].direction = [0.0; 3];
    let input = own.buffer(&rays, Use::STORAGE);
    let blank = vec![Hit { triangle: 7, t: 7.0, u: 7.0, v: 7.0 }; 1024];
    let (closest, any) =
        (own.buffer(&blank, Use::STORAGE | Use::COPY_SRC), own.buffer(&blank, Use::STORAGE | Use::COPY_SRC));
    let skipped = 8 * ALIGNED;
    let mut encoded = Vec::new();
    own.encode(|encoder| {
        let part = input.slice(skipped..);
        let whole = input.slice(..);
        encoded.push(scene.encode(encoder, Query::Closest, whole, closest.slice(..), 1000).expect("encoded"));
        encoded.push(scene.encode(encoder, Query::Any, part, any.slice(ALIGNED..), 500).expect("encoded"));
    });
    let invalid: Vec<u64> = encoded.iter().map(|it| it.invalid()).collect::<Result<_, Error>>()?;
    assert_eq!(invalid, [1, 0]);
    let found = own.read::<Hit>(&closest);
    same("closest", &expected_by(traversal, Query::Closest, &rays[..1000]), &found[..1000])?;
    same("behind the last", &blank[1000..], &found[1000..])?;
    let (found, first) = (own.read::<Hit>(&any), (skipped / 32) as usize);
    same("before the first", &blank[..16], &found[..16])?;
    same("any", &expected_by(traversal, Query::Any, &rays[first..first + 500]), &found[16..516])?;
    same("behind the last", &blank[516..], &found[516..])
}

/// Six triangles around one vertex, then twelve around another: a ray close to it leaves all of them for the exact
/// test.
fn fans() -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (rim, middle) in [(6, -2.0), (12, 2.0)] {
        let first = positions.len() as u32;
        positions.push([middle, 0.0, 0.25]);
        positions.extend((0..rim).map(|i| {
            let turn = i as f32 / rim as f32 * std::f32::consts::TAU;
            [middle + turn.cos(), turn.sin(), 0.0]
        }));
        triangles.extend((0..rim).map(|i| [first, first + 1 + i, first + 1 + (i + 1) % rim]));
    }
    Mesh::new(positions, triangles).expect("a mesh")
}

/// Closest hits by the exact test, where floats tell them, where they leave some triangles, and where too many.
#[test]
fn exact_hits_in_own_buffers_are_those_of_the_batch() -> Result<(), Failure> {
    let (own, mesh) = (&*OWN, fans());
    let mut rays = random(mesh.bounds(), 1500, 4);
    for (i, ray) in rays.iter_mut().enumerate() {
        // Into one sector after the other.
        let turn = i as f32;
        let beside = |middle: f32| [middle + 1e-7 * turn.cos(), 1e-7 * turn.sin(), 0.25];
        let to = match i {
            20..800 if i % 3 == 0 => beside(-2.0),
            1100.. if i % 20 == 0 => beside(2.0),
            _ => continue,
        };
        ray.direction = [0, 1, 2].map(|axis| to[axis] - ray.origin[axis]);
    }
    let on = |device| {
        let mut scene = Scene::build(device, &mesh, &BuildOptions::default())?;
        scene.intersect_by(Intersector::Exact)?;
        Ok::<_, Error>(scene)
    };
    let (scene, all) = (on(own.scene.device())?, on(cpu())?.closest(&rays)?);
    let winners: BTreeSet<u32> = all.iter().map(|hit| hit.triangle).collect();
    assert!(winners.len() >= 18, "{winners:?}");
    same("the batch", &all, &scene.closest(&rays)?)?;
    let input = own.buffer(&rays, Use::STORAGE);
    let blank = vec![Hit { triangle: 7, t: 7.0, u: 7.0, v: 7.0 }; 1500];
    let number = own.buffer(&[1234u32], Use::STORAGE);
    for (count, rays) in [
        (RayCount::Rays(1500), 1500),
        (RayCount::Rays(1025), 1025),
        (RayCount::Rays(1), 1),
        (RayCount::Rays(0), 0),
        (RayCount::InBuffer(number.slice(..)), 1234),
    ] {
        let hits = own.buffer(&blank, Use::STORAGE | Use::COPY_SRC);
        let mut encoded = None;
        own.encode(|encoder| {
            encoded = Some(
                scene
                    .encode(encoder, Query::Closest, input.slice(..), hits.slice(..), count)
                    .expect("encoded"),
            );
        });
        assert_eq!(encoded.expect("it was").invalid()?, 0);
        let found = own.read::<Hit>(&hits);
        same(&format!("{rays} rays"), &all[..rays], &found[..rays])?;
        same(&format!("behind {rays} rays"), &blank[rays..], &found[rays..])?;
    }
    Ok(())
}

/// What is asked of rays and their number go to the device, and the status comes back if it is asked for: as many words
/// whatever the number.
#[test]
fn no_ray_or_hit_crosses_the_bus() -> Result<(), Failure> {
    let limits = raykd::required_limits(wgpu::Limits::default());
    let (device, queue) = request(raykd::required_features(), limits).expect("the least that is needed");
    let raykd = Device::from_wgpu(&device, &queue)?;
    let mesh = Mesh::teapot(6);
    let scene = Scene::build(&raykd, &mesh, &BuildOptions::default())?;
    let own = Own { device, queue, mesh, scene };
    let crossed = || raykd.as_gpu().expect("a GPU").crossed();
    for count in [100, 10_000] {
        let rays = own.buffer(&random(own.mesh.bounds(), count, 1), Use::STORAGE);
        let [hits, counts] = [16, 8].map(|bytes| own.buffer(&vec![0u8; bytes * count], Use::STORAGE));
        let number = own.buffer(&[count as u32], Use::STORAGE);
        let before = crossed();
        let mut encoded = Vec::new();
        own.encode(|encoder| {
            let (rays, hits, counts) = (rays.slice(..), hits.slice(..), counts.slice(..));
            for count in [RayCount::Rays(count as u32), RayCount::InBuffer(number.slice(..))] {
                encoded.push(own.scene.encode(encoder, Query::Closest, rays, hits, count).expect("encoded"));
                encoded.push(own.scene.encode_crossings(encoder, rays, counts, count).expect("encoded"));
            }
        });
        let (job, workgroups, outcome) = (16, 12, 16);
        assert_eq!(crossed(), [before[0] + 4 * job + 2 * workgroups, before[1]]);
        for encoded in encoded {
            assert_eq!(encoded.invalid()?, 0);
        }
        assert_eq!(crossed()[1], before[1] + 4 * outcome);
    }
    Ok(())
}

/// The number of rays is what an earlier command wrote, and no more than there is room for.
#[test]
fn the_number_of_rays_may_be_on_the_device() -> Result<(), Failure> {
    let own = &*OWN;
    let rays = random(own.mesh.bounds(), 1000, 2);
    let input = own.buffer(&rays, Use::STORAGE);
    let blank = vec![Hit { triangle: 7, t: 7.0, u: 7.0, v: 7.0 }; 1000];
    let all = expected(Query::Closest, &rays);
    let counts = own.buffer(&[0u32, 1, 64, 65, 999, 1000, 1001, u32::MAX], Use::COPY_SRC);
    for (i, count) in [0usize, 1, 64, 65, 999, 1000, 1000, 1000].into_iter().enumerate() {
        let hits = own.buffer(&blank, Use::STORAGE | Use::COPY_SRC);
        let number = own.buffer(&[0u32; 65], Use::STORAGE | Use::COPY_DST);
        own.encode(|encoder| {
            encoder.copy_buffer_to_buffer(&counts, 4 * i as u64, &number, ALIGNED, 4);
            let count = number.slice(ALIGNED..);
            own.scene
                .encode(encoder, Query::Closest, input.slice(..), hits.slice(..), count)
                .expect("encoded");
        });
        let found = own.read::<Hit>(&hits);
        same(&format!("{count} rays"), &all[..count], &found[..count])?;
        same(&format!("behind {count} rays"), &blank[count..], &found[count..])?;
    }
    Ok(())
}

/// Rays of which floats tell, and such through vertices and along edges, of which they do not.
fn undecided(count: usize) -> Vec<Ray> {
    let mut rays = random(OWN.mesh.bounds(), count, 3);
    let positions = OWN.mesh.positions();
    for (i, ray) in rays.iter_mut().enumerate().skip(1) {
        // None in the first blocks, then some, then more than a workgroup has lanes.
        if i > 2048 && (i % 50 == 0 || i > 4850) {
            let vertex = positions[i * 7 % positions.len()];
            ray.direction = [0, 1, 2].map(|axis| vertex[axis] - ray.origin[axis]);
        }
    }
    rays
}

/// What floats leave undecided is decided without the host, for the same bytes.
#[test]
fn crossings_in_own_buffers_are_those_of_the_batch() -> Result<(), Failure> {
    let own = &*OWN;
    let mut rays = undecided(5000);
    rays[17].direction = [0.0; 3];
    let input = own.buffer(&rays, Use::STORAGE);
    let host = Scene::build(cpu(), &own.mesh, &BuildOptions::default())?;
    let expected = host.crossings(&rays)?;
    assert_eq!(expected.invalid, 1);
    let undecided = host.undecided(&rays)?;
    assert!((100..1000).contains(&undecided), "{undecided} rays");
    let blank = vec![Crossings { leaving: 7, entering: 7 }; 5100];
    let number = own.buffer(&[4321u32], Use::STORAGE);
    // The traversal of the scene has no part in this.
    let mut scene = own.scene.clone();
    scene.traverse_by(Traversal::Restart)?;
    for (count, rays) in [
        (RayCount::Rays(5000), 5000),
        (RayCount::Rays(1023), 1023),
        (RayCount::Rays(1), 1),
        (RayCount::Rays(0), 0),
        (RayCount::InBuffer(number.slice(..)), 4321),
    ] {
        let found = own.buffer(&blank, Use::STORAGE | Use::COPY_SRC);
        let mut encoded = None;
        own.encode(|encoder| {
            let crossings = found.slice(ALIGNED..);
            encoded =
                Some(scene.encode_crossings(encoder, input.slice(..), crossings, count).expect("encoded"));
        });
        let invalid = encoded.map(|encoded| encoded.invalid()).transpose()?;
        assert_eq!(invalid, Some(u64::from(rays > 17)));
        let (found, first) = (own.read::<Crossings>(&found), ALIGNED as usize / size_of::<Crossings>());
        same("before the first", &blank[..first], &found[..first])?;
        same(&format!("{rays} rays"), &expected.counts[..rays], &found[first..first + rays])?;
        same("behind the last", &blank[first + rays..], &found[first + rays..])?;
    }
    Ok(())
}

#[test]
fn what_cannot_be_used_is_refused() {
    let own = &*OWN;
    let rays = own.buffer(&random(own.mesh.bounds(), 10, 1), Use::STORAGE);
    let (hits, few) = (own.buffer(&[Hit::NONE; 10], Use::STORAGE), own.buffer(&[Hit::NONE; 9], Use::STORAGE));
    let none = own.buffer(&[Hit::NONE; 10], Use::COPY_SRC);
    let mut other = own.scene.clone();
    other.traverse_by(Traversal::Restart).expect("it goes");
    let host = Scene::build(cpu(), &own.mesh, &BuildOptions::default()).expect("a scene");
    own.encode(|encoder| {
        for (scene, rays, hits, count, word) in [
            (&own.scene, &rays, &few, 10, "room for 9"),
            (&own.scene, &rays, &none, 10, "STORAGE"),
            (&own.scene, &rays, &rays, 10, "one buffer"),
            (&other, &rays, &hits, 10, "restart"),
            (&host, &rays, &hits, 10, "on the CPU"),
        ] {
            let refused = scene.encode(encoder, Query::Closest, rays.slice(..), hits.slice(..), count);
            let error = refused.expect_err(word).to_string();
            assert!(error.contains(word), "{error}");
        }
        let few = own.buffer(&[0u32; 19], Use::STORAGE);
        let refused = own.scene.encode_crossings(encoder, rays.slice(..), few.slice(..), 10);
        assert!(refused.expect_err("too few").to_string().contains("room for 9"));
        let counts = own.buffer(&[0u32; 20], Use::STORAGE);
        let (gone, not_four) = (own.buffer(&[0u8; 320], Use::STORAGE), rays.slice(..319));
        gone.destroy();
        let slices = [rays.slice(..), hits.slice(..)];
        for (rays, hits, count, word) in [
            (rays.slice(4..), slices[1], 9.into(), "buffer of rays begins at byte 4"),
            (slices[0], hits.slice(4..), 9.into(), "begins at byte 4"),
            (not_four, slices[1], 9.into(), "buffer of rays has 319 bytes"),
            (slices[0], slices[1], RayCount::from(counts.slice(4..)), "the number of rays begins at byte 4"),
            (gone.slice(..), slices[1], 9.into(), "destroyed"),
        ] {
            for refused in [
                own.scene.encode(encoder, Query::Closest, rays, hits, count),
                own.scene.encode_crossings(encoder, rays, hits, count),
            ] {
                let error = refused.expect_err(word).to_string();
                assert!(error.contains(word), "{error}");
            }
        }
        // The encoder is none the worse for it.
        own.scene.encode(encoder, Query::Closest, rays.slice(..), hits.slice(..), 10).expect("encoded");
    });
    assert!(host.buffers().is_err());
    let enough = raykd::required_limits(wgpu::Limits::default());
    let small =
        wgpu::Limits { max_buffer_size: 4 << 20, max_storage_buffer_binding_size: 4 << 20, ..enough.clone() };
    let tiny = wgpu::Limits { max_storage_buffer_binding_size: 100_000, ..enough.clone() };
    let lacking = [
        (wgpu::Features::empty(), enough, "PASSTHROUGH_SHADERS"),
        (raykd::required_features(), wgpu::Limits::default(), "max_storage_buffers_per_shader_stage"),
        (raykd::required_features(), small, "max_buffer_size"),
        (raykd::required_features(), tiny, "max_storage_buffer_binding_size"),
    ];
    for (features, limits, word) in lacking {
        let (device, queue) = request(features, limits).expect("a device");
        let error = Device::from_wgpu(&device, &queue).expect_err(word);
        assert!(matches!(error, Error::Lacking { .. }), "{error}");
        let told = error.to_string();
        assert!(told.contains(word) && told.contains("request it") && !told.contains("--device"), "{told}");
    }
}

/// A device of one's own for a scene that no other test uses.
fn alone() -> Result<(wgpu::Device, Scene), Error> {
    let limits = raykd::required_limits(wgpu::Limits::default());
    let (device, queue) = request(raykd::required_features(), limits).expect("the least that is needed");
    let scene = Scene::build(&Device::from_wgpu(&device, &queue)?, &OWN.mesh, &BuildOptions::default())?;
    Ok((device, scene))
}

#[test]
fn too_many_rays_are_told_as_such() {
    let most = wgpu::Limits::default().max_storage_buffer_binding_size as usize / size_of::<Ray>();
    let rays = vec![Ray::new([0.0; 3], [1.0, 0.0, 0.0]); most + 1];
    let error = OWN.scene.resident(&rays).expect_err("there is no room").to_string();
    assert!(error.contains("use fewer rays, or another device"), "{error}");
}

/// Little is kept of a large batch, however few hits it has.
#[test]
fn a_large_batch_leaves_little_memory() -> Result<(), Failure> {
    let (device, scene) = alone()?;
    let memory = || {
        device.poll(wgpu::PollType::wait_indefinitely()).expect("it goes on");
        device.generate_allocator_report().expect("a report").total_allocated_bytes
    };
    let mut rays = vec![Ray::new([100.0, 0.0, 0.0], [1.0, 0.0, 0.0]); 1 << 20];
    assert!(scene.all(&rays, 1)?.hits.is_empty());
    let before = memory();
    rays[7] = Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0]);
    assert_eq!(scene.all(&rays, 1)?.hits.len(), 1);
    let more = memory().saturating_sub(before);
    assert!(more < 1 << 20, "{more} bytes are kept");
    Ok(())
}

/// A device that binds little takes rays and points in many batches.
#[test]
fn small_buffers_change_no_answer() -> Result<(), Failure> {
    const MOST: u64 = 160_000;
    let mesh = Mesh::teapot(3);
    let limits = wgpu::Limits {
        max_storage_buffer_binding_size: MOST,
        ..raykd::required_limits(wgpu::Limits::default())
    };
    let (device, queue) = request(raykd::required_features(), limits).expect("a device");
    let device = Device::from_wgpu(&device, &queue)?;
    let too_large = |result: Result<Scene, Error>| match result {
        Err(Error::TooLarge { limit: MOST, .. }) => {}
        other => panic!("{other:?}"),
    };
    let mut fit = Vec::new();
    for &builder in Builder::ALL {
        let options = BuildOptions::default().with_builder(builder);
        too_large(Scene::build(&device, &Mesh::teapot(60), &options));
        if let Ok(scene) = Scene::build(&device, &mesh, &options) {
            assert!(scene.tree()? == Scene::build(cpu(), &mesh, &options)?.tree()?, "{builder}");
            fit.push(builder);
        }
    }
    assert!(fit.contains(&Builder::Binned), "{fit:?}");
    let mut rays = random(mesh.bounds(), 16_000, 1);
    for at in [17, 5000, 15_999] {
        rays[at].direction = [0.0; 3];
    }
    let host = Scene::build(cpu(), &mesh, &BuildOptions::default())?;
    let scene = Scene::with_tree(&device, &mesh, &host.tree()?)?;
    assert!(scene.batch_limit() * 3 < rays.len());
    let both = [&host, &scene];
    for query in [Query::Closest, Query::Any] {
        let [a, b] = both.map(|scene| scene.trace(query, &rays));
        let (a, b) = (a?, b?);
        same("hits", &a.hits, &b.hits)?;
        assert_eq!((a.invalid, b.invalid), (3, 3));
        let excluded: Vec<u32> = a.hits.iter().map(|hit| hit.triangle).collect();
        let [a, b] = both.map(|scene| scene.trace_except(query, &rays, &excluded));
        same("others", &a?.hits, &b?.hits)?;
    }
    for limit in [0, 1, 7, 8, 9, u32::MAX] {
        let [a, b] = both.map(|scene| scene.all(&rays, limit));
        let (a, b) = (a?, b?);
        same("all hits", &a.hits, &b.hits)?;
        same("numbers", &a.totals, &b.totals)?;
        assert_eq!((a.begins, a.invalid), (b.begins, b.invalid));
    }
    let [a, b] = both.map(|scene| scene.crossings(&rays));
    let (a, b) = (a?, b?);
    assert!((a.counts, a.invalid) == (b.counts, b.invalid));
    let [a, b] = both.map(|scene| scene.steps(&rays));
    let (a, b) = (a?, b?);
    same("hits", &a.hits, &b.hits)?;
    same("steps", &a.steps, &b.steps)?;
    same("brute", &host.brute(&rays)?, &scene.brute(&rays)?)?;
    let points: Vec<[f32; 3]> = rays.iter().map(|ray| ray.origin).collect();
    for _ in 0..2 {
        let [a, b] = both.map(|scene| scene.winding(&points));
        let (a, b) = (a?, b?);
        assert!((a.counts, a.invalid) == (b.counts, b.invalid));
    }
    Ok(())
}

/// What is offered to shaders of one's own is the tree, as its layout says.
#[test]
fn buffers_hold_the_tree() -> Result<(), Failure> {
    let own = &*OWN;
    let (tree, buffers) = (own.scene.tree()?, own.scene.buffers()?);
    let tree = tree.view();
    assert_eq!(own.read::<raykd::shared::TreeHeader>(buffers.header)[0].nodes, tree.header.nodes);
    let nodes = own.read::<raykd::shared::Node>(buffers.nodes);
    same("nodes", tree.nodes, &nodes[..tree.nodes.len()])?;
    let refs = own.read::<u32>(buffers.refs);
    same("refs", tree.refs, &refs[..tree.refs.len()])?;
    let leaves = own.read::<raykd::single::LeafTriangle>(buffers.corners);
    let walker = raykd::single::Tree::new(tree, &leaves[..tree.refs.len()]).expect("a tree");
    let rays = random(own.mesh.bounds(), 100, 4);
    let found: Vec<Hit> = rays.iter().map(|ray| walker.closest(ray).unwrap_or(Hit::NONE)).collect();
    assert_eq!(hits_digest(&found), hits_digest(&expected(Query::Closest, &rays)));
    assert_eq!(buffers.indices.size() as usize / 12, own.mesh.triangles().len());
    assert!(buffers.positions.size() as usize >= own.mesh.positions().len() * 12);
    Ok(())
}

/// Without raykd's callbacks a lost device still gives no hits.
#[test]
fn a_lost_device_gives_an_error() -> Result<(), Failure> {
    let (device, scene) = alone()?;
    device.destroy();
    let _ = device.poll(wgpu::PollType::Poll);
    let rays = random(OWN.mesh.bounds(), 100_000, 1);
    assert!(scene.closest(&rays).is_err());
    assert!(Scene::build(scene.device(), &OWN.mesh, &BuildOptions::default()).is_err());
    Ok(())
}
