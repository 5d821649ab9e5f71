//! Tests that cannot fail show nothing: for each family of checks a planted fault that it must find.

use raykd::{
    BuildOptions, Builder, Device, Hit, KdTree, Mesh, Ray, Scene,
    internals::{
        Cpu, Groups, Step,
        kernels::{
            Access, Group, Kernel, Order, RawBuf, Slot, lanes,
            math::{product_difference, quotient},
            mem::{Buf, Slots as _},
        },
    },
    rays::Random,
};
use raykd_tests::{
    cpu,
    dispatches::Job,
    gpu,
    meshes::{Family, Recipe, icosphere},
    same,
    trees::{assemble, check, without_reference},
};
use std::{fs, path::Path};

fn soup() -> Mesh {
    Recipe { family: Family::Soup, size: 500, seed: 1 }.mesh()
}

fn build(mesh: &Mesh) -> (Scene, KdTree) {
    let scene = Scene::build(cpu(), mesh, &BuildOptions::default()).unwrap();
    let tree = scene.tree().unwrap();
    (scene, tree)
}

#[test]
fn one_flipped_bit_in_a_tree_is_found_and_named() {
    let (_, tree) = build(&soup());
    for bit in [0, 31, 32 * 7 + 5] {
        let mut refs = tree.view().refs.to_vec();
        refs[bit / 32 + 100] ^= 1 << (bit % 32);
        let message = same("references", tree.view().refs, &refs).unwrap_err().to_string();
        assert!(message.contains(&format!("element {}", bit / 32 + 100)), "{message}");
    }
    let mut nodes = tree.view().nodes.to_vec();
    bytemuck::cast_slice_mut::<_, u32>(&mut nodes)[2 * 40] ^= 1;
    assert!(same("nodes", tree.view().nodes, &nodes).unwrap_err().to_string().contains("element 40 "));
    assert!(assemble(*tree.view().header, &nodes, tree.view().refs).is_err() || nodes != tree.view().nodes);
}

#[test]
fn a_dropped_reference_breaks_the_tree() {
    let mesh = soup();
    let whole = BuildOptions::default().with_clip(false);
    let tree = Scene::build(cpu(), &mesh, &whole).unwrap().tree().unwrap();
    check(&mesh, tree.view(), false).unwrap();
    for n in (0..tree.view().refs.len() as u32).step_by(17) {
        let damaged = without_reference(&tree, n).expect("still well formed");
        let message = check(&mesh, damaged.view(), false).unwrap_err().to_string();
        assert!(message.contains(&format!("one of those that differ is {}", tree.view().refs[n as usize])));
    }
}

#[test]
fn a_dropped_reference_loses_hits() {
    let mesh = soup();
    let (scene, tree) = build(&mesh);
    let rays = raykd::rays::random(mesh.bounds(), 2000, 1);
    let expected = scene.brute(&rays).unwrap();
    let hit = expected.iter().find(|hit| hit.is_hit()).unwrap();
    // Every reference to the triangle of the first hit.
    let mut damaged = tree;
    while let Some(n) = damaged.view().refs.iter().position(|&t| t == hit.triangle) {
        damaged = without_reference(&damaged, n as u32).unwrap();
    }
    for device in [cpu(), gpu()] {
        let found = Scene::with_tree(device, &mesh, &damaged).unwrap().closest(&rays).unwrap();
        same("hits", &expected, &found).unwrap_err();
    }
}

#[test]
fn one_changed_hit_is_found() {
    let hits = vec![Hit { triangle: 3, t: 1.0, u: 0.25, v: 0.5 }; 100];
    for change in [
        |hit: &mut Hit| hit.triangle ^= 1,
        |hit: &mut Hit| hit.t = hit.t.next_up(),
        |hit: &mut Hit| hit.v = hit.v.next_down(),
    ] {
        let mut changed = hits.clone();
        change(&mut changed[42]);
        let message = same("hits", &hits, &changed).unwrap_err().to_string();
        assert!(message.contains("element 42 (the first of 1 that differ)"), "{message}");
    }
    // Bytes count, not values.
    same("zeros", &[0.0f32], &[-0.0]).unwrap_err();
    same("lengths", &hits, &hits[1..]).unwrap_err();
}

#[test]
fn one_wrong_word_in_one_dispatch_is_traced_to_its_kernel() {
    // Of more than one chunk.
    let mesh = Recipe { family: Family::Soup, size: 700, seed: 4 }.mesh();
    let options = BuildOptions::default();
    let exact = options.clone().with_builder(Builder::Exact);
    let [job, exact] = [&options, &exact].map(|options| Job { mesh: &mesh, options, seed: 1 });
    let [job, exact] = [&job, &exact].map(|job| job.record(cpu()).unwrap());
    job.compare(cpu(), |_, _| {}).unwrap();
    let traces = ["closest", "except", "transforms", "woop", "moeller", "plane", "baldwin"];
    let builds = ["boxes", "bin", "count", "scatter", "branch", "assign", "join", "treelet", "place", "emit"];
    let exacts = [
        "start",
        "sort",
        "weigh",
        "cheapest",
        "classify",
        "rank",
        "total",
        "advance",
        "children",
        "distribute",
        "carry",
        "insert",
        "sizes",
        "number",
        "leaves",
    ];
    let jobs = builds.into_iter().chain(traces).map(|name| (&job, name));
    for (job, name) in jobs.chain(exacts.map(|name| (&exact, name))) {
        // What a wrong kernel of this name would have done, on the GPU.
        thread_local!(static FAULTY: std::cell::Cell<&'static str> = const { std::cell::Cell::new("") });
        FAULTY.set(name);
        let fault = |device: &Device, step: &Step<'_>| {
            if step.kernel.name() == FAULTY.get() {
                let slot = step.kernel.slots.iter().position(|slot| slot.access == Access::Write).unwrap();
                let words = step.buffers[slot].view::<u32>();
                // Nothing that stops the kernels after it: the first plane moves, its children stay.
                let at = if ["treelet", "emit"].contains(&FAULTY.get()) { 0 } else { 1 };
                let word = device.read(&words, at, 1).unwrap();
                device.write(&words, at, &[word[0] ^ 0x10]).unwrap();
                FAULTY.set("none");
            }
        };
        let message = job.compare(gpu(), fault).unwrap_err().to_string();
        assert!(message.contains(&format!("::{name}::entry,")), "{name}: {message}");
    }
}

/// A group kernel that is wrong: each lane reads, within one block, what its neighbour writes.
static RACY: Kernel = Kernel {
    path: "raykd_tests::racy::entry",
    threads: 64,
    span: 1,
    slots: &[Slot { name: "out", access: Access::Write, stride: 4 }],
    run: |group: Group, buffers: &[RawBuf]| {
        // SAFETY: the executor's promise for `Kernel::run` is what `Buf::new` asks for.
        let mut out = unsafe { Buf::<u32>::new(buffers[0].ptr.cast(), buffers[0].len / 4) };
        let mut shared = [0u32; 64];
        lanes!(group, |lane| {
            shared[lane as usize] = shared[(lane as usize + 63) % 64] + 1;
        });
        lanes!(group, |lane| {
            out.put(group.id * 64 + lane, shared[lane as usize]);
        });
        out.moved()
    },
};

#[test]
fn a_kernel_that_depends_on_the_order_of_lanes_is_found() {
    let run = |order| {
        let device = Device::from(Cpu::default().in_order(order));
        let out = device.alloc::<u32>("out", 256).unwrap();
        let step = Step { kernel: &RACY, buffers: vec![&out], groups: Groups::Fixed(4) };
        // SAFETY: each group writes its own part of the buffer; only its lanes get in each other's way, in turn.
        unsafe { device.run(&[step], false) }.unwrap();
        device.read(&out, 0, 256).unwrap()
    };
    let forward = run(Order::Forward);
    same("again", &forward, &run(Order::Forward)).unwrap();
    same("reverse", &forward, &run(Order::Reverse)).unwrap_err();
    for seed in [3, 5, 0x5EED, 12345] {
        same("shuffled", &forward, &run(Order::Shuffled(seed))).unwrap_err();
    }
}

/// The test of Möller and Trumbore (1997), which evaluates a shared edge differently in each triangle.
fn moller_trumbore(ray: &Ray, [a, b, c]: [[f32; 3]; 3]) -> bool {
    let sub = |p: [f32; 3], q: [f32; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let dot = |p: [f32; 3], q: [f32; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let cross = |p: [f32; 3], q: [f32; 3]| {
        [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
    };
    let (ab, ac, ao) = (sub(b, a), sub(c, a), sub(ray.origin, a));
    let p = cross(ray.direction, ac);
    let q = cross(ao, ab);
    let det = dot(ab, p);
    let (u, v, t) = (dot(ao, p) / det, dot(ray.direction, q) / det, dot(ac, q) / det);
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0
}

#[test]
fn a_triangle_test_that_is_not_watertight_leaks() {
    let mesh = icosphere(2);
    let mut random = Random::new(5);
    let mut rays = Vec::new();
    for _ in 0..10 {
        for triangle in mesh.triangles() {
            let [a, b, _] = triangle.map(|v| mesh.positions()[v as usize]);
            let s = random.unit() as f32;
            let from = [(); 3].map(|()| random.unit() as f32 - 0.5);
            rays.push(Ray::new(from, [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * s - from[i])));
        }
    }
    let corners = |t: &[u32; 3]| t.map(|v| mesh.positions()[v as usize]);
    let leaks = |ray: &&Ray| !mesh.triangles().iter().any(|t| moller_trumbore(ray, corners(t)));
    assert!(rays.iter().filter(leaks).count() > 10, "the rays tell the two tests apart");
    let (scene, _) = build(&mesh);
    assert!(scene.closest(&rays).unwrap().iter().all(Hit::is_hit));
}

#[test]
fn arithmetic_that_is_not_exact_is_told_apart() {
    let mut random = Random::new(6);
    let mut number = || 1.0 + random.unit() as f32;
    let (mut quotients, mut differences) = (0, 0);
    for _ in 0..10_000 {
        let (a, b) = (number(), number());
        // By way of the reciprocal: rounded twice.
        quotients += u32::from(a * (1.0 / b) != a / b);
        assert_eq!(quotient(a, b), a / b);
        // The plain difference of equal rounded products is 0, whatever the exact one is.
        let c = number();
        let d = (f64::from(a) * f64::from(b) / f64::from(c)) as f32;
        if a * b == c * d && f64::from(a) * f64::from(b) != f64::from(c) * f64::from(d) {
            differences += 1;
            assert_ne!(product_difference(a, b, c, d), 0.0);
        }
    }
    assert!(quotients > 1000 && differences > 1000, "{quotients}, {differences}");
}

#[test]
fn a_module_older_than_its_sources_is_refused() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let copy = tempfile::tempdir().unwrap();
    for part in ["kernels", "shared"] {
        copy_folder(&root.join(part), &copy.path().join(part));
    }
    // As if compiled from what is there.
    let manifest = xtask::Manifest::read(&root).unwrap();
    let text = fs::read_to_string(root.join(xtask::MANIFEST)).unwrap();
    let mut text = text.replace(&manifest.sources_sha256, &xtask::sources_digest(&root).unwrap());
    for (module, contents) in xtask::MODULES.iter().zip(&manifest.modules) {
        let bytes = fs::read(root.join(module.path)).unwrap();
        text = text.replace(&contents.sha256, &xtask::sha256(&bytes));
    }
    fs::write(copy.path().join(xtask::MANIFEST), text).unwrap();
    xtask::verify(copy.path()).unwrap();
    let source = copy.path().join("kernels/src/math.rs");
    let text = fs::read_to_string(&source).unwrap();
    fs::write(&source, format!("{text}// changed\n")).unwrap();
    let message = xtask::verify(copy.path()).unwrap_err().to_string();
    assert!(message.contains("older than the kernel sources: run `cargo xtask kernels`"), "{message}");
    fs::write(&source, text).unwrap();
    for module in xtask::MODULES {
        let module = copy.path().join(module.path);
        let right = fs::read(&module).unwrap();
        let mut bytes = right.clone();
        bytes[1000] ^= 1;
        fs::write(&module, bytes).unwrap();
        xtask::verify(copy.path()).unwrap_err();
        fs::write(&module, right).unwrap();
    }
    xtask::verify(copy.path()).unwrap();
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}
