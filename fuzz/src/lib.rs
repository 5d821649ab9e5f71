//! What must hold of any bytes: no panic, no hang, no memory beyond the input's order, and right answers.

use raykd::{
    BuildOptions, Builder, Device, Error, Hit, Intersector, KdTree, Mesh, Query, Ray, Ray64, Scene,
    Traversal,
    internals::{Cpu, known_formats},
    shared::{LAYOUT_VERSION, MISS, Node, TreeHeader, TreeView},
    stress::{SLACK, is_ray, settled},
};
use raykd_oracle::Oracle;
use sha2::{Digest as _, Sha256};
use std::sync::LazyLock;

static CPU: LazyLock<Device> = LazyLock::new(|| Device::from(Cpu::with_threads(1).expect("a thread")));

/// The numbers in bytes.
fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// Hits are those of brute force, and exact but for rounding.
fn trace(mesh: &Mesh, scene: &Scene, rays: &[Ray]) {
    let hits = scene.closest(rays).expect("a CPU does it");
    let brute = scene.brute(rays).expect("a CPU does it");
    assert_eq!(bytemuck::cast_slice::<_, u8>(&hits), bytemuck::cast_slice::<_, u8>(&brute), "{rays:?}");
    let oracle = Oracle::new(mesh.positions(), mesh.triangles());
    for (ray, hit) in rays.iter().zip(&hits) {
        let ray = settled(ray);
        let reach = oracle.reach(ray.origin);
        if is_ray(&ray) && reach * f64::from(mesh.scale()) < f64::from(1 << 30) {
            let crossings = oracle.crossings(&ray);
            let fault = oracle.judge(&ray, &crossings, hit, SLACK * reach);
            assert_eq!(fault, None, "{ray:?}: {hit:?}, exactly {crossings:?}");
        }
    }
}

/// Rays at a mesh's box.
fn around(mesh: &Mesh) -> Vec<Ray> {
    raykd::rays::random(mesh.bounds(), 8, 1)
}

/// A mesh file, of each format.
pub fn mesh(bytes: &[u8]) {
    known_formats().for_each(|(_, extensions)| mesh_of(extensions[0], bytes));
}

/// A mesh file with such a name.
pub fn mesh_of(extension: &str, bytes: &[u8]) {
    if let Ok(mesh) = Mesh::from_bytes(format!("fuzz.{extension}"), bytes.to_vec()) {
        let scene = Scene::build(&CPU, &mesh, &BuildOptions::default()).expect("a CPU builds it");
        let by = mesh.translation();
        let local = mesh.into_local();
        let mut rays = around(&local);
        if by != [0.0; 3] {
            // The same rays, by way of the mesh's own coordinates, which round them.
            let own = rays.iter().map(|ray| {
                let origin = [0, 1, 2].map(|a| f64::from(ray.origin[a]) + by[a]);
                Ray64::new(origin, ray.direction.map(f64::from))
            });
            let own: Vec<_> = own.collect();
            for (ray, own) in rays.iter_mut().zip(&own) {
                ray.origin = [0, 1, 2].map(|a| (own.origin[a] - by[a]) as f32);
            }
            let there = scene.closest(&own).expect("a CPU does it");
            let scene = Scene::build(&CPU, &local, &BuildOptions::default()).expect("a CPU builds it");
            assert_eq!(there, scene.closest(&rays).expect("a CPU does it"));
            return trace(&local, &scene, &rays);
        }
        trace(&local, &scene, &rays);
    }
}

/// A tree file, as it is and with a head and a checksum that fit.
pub fn tree(bytes: &[u8]) {
    static TEAPOT: LazyLock<Mesh> = LazyLock::new(|| Mesh::teapot(1));
    static HEADER: LazyLock<TreeHeader> = LazyLock::new(|| {
        let scene = Scene::build(&CPU, &TEAPOT, &BuildOptions::default()).expect("a CPU builds it");
        *scene.tree().expect("a CPU gives it back").view().header
    });
    assert!(KdTree::from_bytes(bytes).is_err(), "a checksum by chance");
    // The first byte says how many words are references.
    let Some((&refs, rest)) = bytes.split_first() else { return };
    let words = rest.len() / 4;
    let refs = usize::from(refs).min(words);
    let nodes = (words - refs) / 2;
    let depth = (rest.len() % 49) as u32;
    let mut header = TreeHeader { nodes: nodes as u32, refs: refs as u32, depth, ..*HEADER };
    let node_words: Vec<Node> = bytemuck::pod_collect_to_vec(&rest[..nodes * 8]);
    let ref_words: Vec<u32> = bytemuck::pod_collect_to_vec(&rest[nodes * 8..][..refs * 4]);
    header.checksum = TreeView { header: &header, nodes: &node_words, refs: &ref_words }.checksum();
    let mut file = b"raykd-kd".to_vec();
    file.extend(LAYOUT_VERSION.to_le_bytes());
    file.extend(bytemuck::bytes_of(&header));
    file.extend(&rest[..nodes * 8 + refs * 4]);
    file.extend(Sha256::digest(&file).as_slice());
    let Ok(tree) = KdTree::from_bytes(&file) else { return };
    // Wrong trees may lose hits; they must not do harm.
    if let Ok(mut scene) = Scene::with_tree(&CPU, &TEAPOT, &tree) {
        for &traversal in Traversal::ALL {
            scene.traverse_by(traversal).expect("a CPU does it");
            scene.closest(&around(&TEAPOT)).expect("a CPU does it");
        }
    }
}

/// Rays at the teapot.
pub fn rays(bytes: &[u8]) {
    static TEAPOT: LazyLock<(Mesh, Scene)> = LazyLock::new(|| {
        let mesh = Mesh::teapot(2);
        let scene = Scene::build(&CPU, &mesh, &BuildOptions::default()).expect("a CPU builds it");
        (mesh, scene)
    });
    let rays: Vec<Ray> =
        floats(bytes).chunks_exact(8).map(|f| bytemuck::cast(<[f32; 8]>::try_from(f).unwrap())).collect();
    trace(&TEAPOT.0, &TEAPOT.1, &rays);
}

/// Triangles, and a ray in every fourth place.
pub fn triangles(bytes: &[u8]) {
    let numbers = floats(bytes);
    let (mut corners, mut rays) = (Vec::new(), Vec::new());
    for (i, chunk) in numbers.chunks_exact(9).enumerate() {
        if i % 4 == 3 {
            rays.push(Ray::new([chunk[0], chunk[1], chunk[2]], [chunk[3], chunk[4], chunk[5]]));
        } else {
            corners.extend(chunk.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        }
    }
    let count = corners.len() as u32 / 3;
    if let Ok(mesh) = Mesh::new(corners, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()) {
        let scene = Scene::build(&CPU, &mesh, &BuildOptions::default()).expect("a CPU builds it");
        rays.extend(around(&mesh));
        trace(&mesh, &scene, &rays);
        // The two forms of `exact`, lists of faces in all but the smallest nodes.
        let exact = BuildOptions::default().with_builder(Builder::Exact);
        let kernels = Scene::sweep_by_kernels(&CPU, &mesh, &exact, 5).expect("kernels build it");
        let host = Scene::build(&CPU, &mesh, &exact).expect("a CPU builds it");
        assert_eq!(kernels.tree().expect("it is read").digest(), host.tree().expect("it is read").digest());
    }
}

/// Calls of the library in any order, with any options and sizes: errors or right answers, and what is asked twice is
/// answered twice the same.
pub fn api(bytes: &[u8]) {
    static TEAPOT: LazyLock<Mesh> = LazyLock::new(|| Mesh::teapot(1));
    let mut bytes = bytes.iter().copied();
    // What is not there counts as 0.
    let mut byte = || bytes.next().unwrap_or(0);
    let mut word = || u32::from_le_bytes([byte(), byte(), byte(), byte()]);
    let mut options = BuildOptions::default().with_max_depth(word() % 64);
    options.builder = Builder::ALL[word() as usize % Builder::ALL.len()];
    options.clip = word().is_multiple_of(2);
    for field in [&mut options.cost_step, &mut options.cost_test, &mut options.price, &mut options.empty] {
        match word() {
            0 => {}
            bits => *field = f32::from_bits(bits),
        }
    }
    match word() {
        0 => {}
        bits => options.budget = Some(f32::from_bits(bits)),
    }
    options.long = word();
    let mut scene = match Scene::build(&CPU, &TEAPOT, &options) {
        Ok(scene) => scene,
        Err(Error::Options { .. }) => return,
        Err(error) => panic!("{options:?}: {error}"),
    };
    let tree = scene.tree().expect("a CPU gives it back");
    tree.validate().expect("builders make valid trees");
    let rays = around(&TEAPOT);
    let same = |a: &[Hit], b: &[Hit]| bytemuck::cast_slice::<_, u8>(a) == bytemuck::cast_slice::<_, u8>(b);
    loop {
        let rays = &rays[..(word() % 9) as usize];
        let refused = |error: Error| assert!(matches!(error, Error::Intersector { .. }), "{error}");
        match word() % 9 {
            0 => return,
            1 => scene
                .traverse_by(Traversal::ALL[word() as usize % Traversal::ALL.len()])
                .unwrap_or_else(refused),
            2 => scene
                .intersect_by(Intersector::ALL[word() as usize % Intersector::ALL.len()])
                .unwrap_or_else(refused),
            3 => {
                let hits = scene.closest(rays).expect("a CPU does it");
                assert!(same(&hits, &scene.brute(rays).expect("a CPU does it")));
            }
            4 => {
                let any = scene.any(rays).expect("a CPU does it");
                let closest = scene.closest(rays).expect("a CPU does it");
                assert!(any.iter().zip(&closest).all(|(a, b)| a.is_hit() == b.is_hit()));
            }
            5 => match scene.all(rays, word() % 4 * (word() % 3)) {
                Ok(all) => assert_eq!(all.totals.len(), rays.len()),
                Err(error) => refused(error),
            },
            6 => {
                let excluded: Vec<u32> =
                    (0..word() % 9).map(|i| if i % 3 == 0 { MISS } else { word() }).collect();
                match scene.trace_except(Query::Closest, rays, &excluded) {
                    Ok(traced) => assert_eq!(traced.hits.len(), rays.len()),
                    Err(Error::Excluded { .. }) => assert_ne!(rays.len(), excluded.len()),
                    Err(error) => refused(error),
                }
            }
            7 => match scene.steps(rays) {
                Ok(all) => assert_eq!((all.hits.len(), all.steps.len()), (rays.len(), rays.len())),
                Err(error) => refused(error),
            },
            _ => {
                let again = Scene::with_tree(&CPU, &TEAPOT, &tree).expect("it is the teapot's");
                assert_eq!(again.tree().expect("a CPU gives it back"), tree);
            }
        }
    }
}
