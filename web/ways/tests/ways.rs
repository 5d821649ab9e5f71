//! What is written down is what the kernels count.

use raykd::{
    BuildOptions, Builder, Device, Mesh, Ray, Scene, Stepped, Traversal,
    rays::{Camera, random},
    shared::Content,
    stress::CASES,
};
use raykd_ways::Ways;

/// Rays a mesh.
const RAYS: usize = 400;

fn meshes() -> Vec<(String, Mesh)> {
    let stress = CASES.iter().map(|case| {
        let part = case.parts(1).into_iter().next().expect("a scene has a part");
        (case.name.to_owned(), part.mesh.into_local())
    });
    [("teapot".to_owned(), Mesh::teapot(8))].into_iter().chain(stress).collect()
}

fn rays(mesh: &Mesh) -> Vec<Ray> {
    let mut rays = random(mesh.bounds(), RAYS, 5);
    rays.extend(Camera::framing(mesh.bounds()).rays(12, 12));
    // Along the axes, from corners, nowhere, and none.
    let (lo, hi) = mesh.bounds();
    let middle = [0, 1, 2].map(|axis| 0.5 * lo[axis] + 0.5 * hi[axis]);
    for axis in 0..3 {
        for from in [lo, hi, middle] {
            for sign in [1.0, -1.0] {
                let mut direction = [0.0; 3];
                direction[axis] = sign;
                rays.push(Ray::new(from, direction));
            }
        }
    }
    rays.push(Ray::new(hi, [1.0, 1.0, 1.0]));
    rays.push(Ray::new(lo, [0.0; 3]));
    rays
}

#[test]
fn visits_are_the_kernels_own() {
    let mut seen = 0;
    for (name, mesh) in meshes() {
        let rays = rays(&mesh);
        for builder in [Builder::Binned, Builder::Median, Builder::Exact] {
            let options = BuildOptions::default().with_builder(builder);
            let mut scene = Scene::build(&Device::cpu(), &mesh, &options).unwrap();
            let ways = Ways::new(&scene, &mesh).unwrap();
            let tree = scene.tree().unwrap();
            let nodes = tree.view().nodes;
            for traversal in Traversal::ALL
                .iter()
                .copied()
                .filter(|one| !matches!(one, Traversal::Wide | Traversal::Brute))
            {
                scene.traverse_by(traversal).unwrap();
                let Stepped { hits, steps, .. } = scene.steps(&rays).unwrap();
                for (i, ray) in rays.iter().enumerate() {
                    let way = ways.of(ray, traversal).unwrap();
                    let what = format!("{name}, {builder}, {traversal}, ray {i}");
                    assert_eq!(way.triangle, hits[i].triangle, "{what}");
                    let (mut inner, mut leaves, mut tests) = (0, 0, 0);
                    for &node in &way.nodes {
                        match nodes[node as usize].content() {
                            Content::Inner { .. } => inner += 1,
                            Content::Leaf { count, .. } => {
                                leaves += 1;
                                tests += count;
                            }
                        }
                    }
                    let counted = [steps[i].inner, steps[i].leaves, steps[i].tests, steps[i].turns];
                    assert_eq!([inner, leaves, tests, way.turns], counted, "{what}");
                    assert_eq!([way.inner, way.leaves, way.tests], [inner, leaves, tests], "{what}");
                    seen += way.nodes.len();
                }
            }
        }
    }
    assert!(seen > 1_000_000, "{seen} visits");
}

/// The numbers in the list are right, too, not their count alone: each follows from what was seen, and all come to the
/// same triangles in the same order.
#[test]
fn nodes_follow_from_each_other() {
    let mesh = Mesh::teapot(8);
    let scene = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default()).unwrap();
    let ways = Ways::new(&scene, &mesh).unwrap();
    let tree = scene.tree().unwrap();
    let nodes = tree.view().nodes;
    let full = |&node: &u32| {
        let Content::Leaf { count, .. } = nodes[node as usize].content() else { return false };
        count > 0
    };
    for ray in rays(&mesh) {
        let leaves = |nodes: &[u32]| nodes.iter().copied().filter(full).collect::<Vec<_>>();
        let usual = ways.of(&ray, Traversal::Stack).unwrap();
        for traversal in
            Traversal::ALL.iter().copied().filter(|one| !matches!(one, Traversal::Wide | Traversal::Brute))
        {
            let way = ways.of(&ray, traversal).unwrap();
            assert_eq!(way.nodes.first().copied().unwrap_or(0), 0, "{traversal} begins at the root");
            let mut seen = vec![0];
            for pair in way.nodes.windows(2) {
                let (from, to) = (pair[0], pair[1]);
                // Ropes lead anywhere; the others to a child of a node that was seen, up, or to the root.
                let roped = matches!(traversal, Traversal::Ropes | Traversal::OptimisedRopes);
                let up = ways.parent(to);
                let ok = roped || up.is_none_or(|up| seen.contains(&up)) || ways.parent(from) == Some(to);
                assert!(ok, "{traversal}: from {from} to {to}");
                seen.push(to);
            }
            assert_eq!(leaves(&way.nodes), leaves(&usual.nodes), "{traversal}");
        }
    }
}

#[test]
fn of_brute_force_there_is_nothing_to_tell() {
    let mesh = Mesh::teapot(1);
    let scene = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default()).unwrap();
    let ray = Ray::new([0.0; 3], [0.0, 0.0, 1.0]);
    assert_eq!(Ways::new(&scene, &mesh).unwrap().of(&ray, Traversal::Brute), None);
}
