//! The examples, built and run.

use raykd::{
    BuildOptions, Hit, Mesh, Scene,
    rays::random,
    shared::{Content, LAYOUT_VERSION},
    single::LeafTriangle,
};
use raykd_tests::{cpu, same};
use std::{
    env,
    path::{Path, PathBuf},
    process::Command,
    sync::LazyLock,
};
use xtask::LEFT_OUT;

/// The folder of this profile's executables, with the examples built as `cargo xtask test` builds all else.
static BUILT: LazyLock<PathBuf> = LazyLock::new(|| {
    let this = env::current_exe().unwrap();
    let folder = this.parent().and_then(Path::parent).unwrap();
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["build", "--quiet", "--workspace", "--bin", "walk_tree"]);
    let examples = ["minimal", "property_test", "thickness", "visibility", "pathtracer"];
    cargo.args(examples.map(|example| format!("--example={example}")));
    cargo.args(LEFT_OUT.map(|package| format!("--exclude={package}")));
    cargo.arg("--target-dir").arg(folder.parent().unwrap());
    if folder.ends_with("release") {
        cargo.arg("--release");
    }
    assert!(cargo.current_dir(env!("CARGO_MANIFEST_DIR")).status().unwrap().success(), "{cargo:?}");
    folder.to_owned()
});

/// What a program prints.
fn run(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(BUILT.join(program)).args(arguments).output().unwrap();
    assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn minimal_prints_hits() {
    let text = run("examples/minimal", &[]);
    assert!(text.lines().filter(|line| line.contains(": triangle ")).count() > 3, "{text}");
    let lines = include_str!("../../host/examples/minimal.rs").lines().count();
    assert!(lines <= 60, "{lines} lines are not minimal");
}

/// Programs that use raykd in one way each; `own_kernel`'s are run where rust-gpu is.
#[test]
fn examples_are_short() {
    for (name, text) in [
        ("own_wgpu", include_str!("../../host/examples/own_wgpu.rs")),
        ("build_on", include_str!("../../host/examples/build_on.rs")),
        ("scene_in_a_struct", include_str!("../../host/examples/scene_in_a_struct.rs")),
        ("single_rays", include_str!("../../host/examples/single_rays.rs")),
        ("nearest, the kernel", include_str!("../../examples/own_kernel/shader/src/nearest.rs")),
        ("nearest, the program", include_str!("../../examples/own_kernel/src/bin/nearest.rs")),
        ("no_std_walker", include_str!("../../kernels/examples/no_std_walker/src/lib.rs")),
    ] {
        assert!(text.lines().count() <= 60, "{name} has {} lines", text.lines().count());
    }
}

/// A saved tree, walked without the standard library: the hits of the batch.
#[test]
fn no_std_walker_finds_the_hits_of_the_batch() {
    let mesh = Mesh::teapot(6);
    let scene = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("teapot.kd");
    scene.tree().unwrap().save(&path).unwrap();
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&std::fs::read(&path).unwrap());
    let rays = random(mesh.bounds(), 5000, 1);
    let walk = |words: &[u32], fewer: usize| {
        let tree = no_std_walker::tree(words)?;
        let mut leaves = vec![LeafTriangle::default(); tree.refs.len() - fewer];
        let lent = no_std_walker::Lent { leaves: &mut leaves, scratch: &mut vec![0; tree.scratch_words()] };
        let mut hits = vec![Hit::NONE; rays.len()];
        no_std_walker::trace(tree, (mesh.positions(), mesh.triangles()), lent, &rays, &mut hits)
            .map(|()| hits)
    };
    same("hits", &scene.closest(&rays).unwrap(), &walk(&words, 0).unwrap()).unwrap();
    // What is cut off, changed, or too small for the tree is refused.
    assert!(walk(&words, 1).is_none());
    for length in [0, 1, 2, 10, 19, 100] {
        assert!(walk(&words[..length], 0).is_none(), "{length} words");
    }
    for place in [0, 2, 6, 25] {
        let mut words = words.clone();
        words[place] ^= 8;
        assert!(walk(&words, 0).is_none(), "word {place}");
    }
}

/// The number before and the number behind `of` in a line.
fn part(text: &str) -> [usize; 2] {
    let words: Vec<&str> = text.split(' ').collect();
    let of = words.iter().position(|&word| word == "of").unwrap();
    [words[of - 1], words[of + 1]].map(|word| word.parse().unwrap())
}

/// A box of 4 x 6 x 1 is thinnest from top to bottom, and its top is seen from above.
#[test]
fn thickness_and_visibility_of_a_box_and_of_the_teapot() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("box.obj");
    let corners = (0..8).map(|i| format!("v {} {} {}\n", i & 1, (i >> 1 & 1) * 6, i >> 2));
    let faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"];
    let text: String = corners.chain(faces.map(|face| format!("f {face}\n"))).collect();
    std::fs::write(&path, text.replace("v 1", "v 4")).unwrap();
    let path = path.to_str().unwrap();
    let thickness = run("examples/thickness", &[path]);
    assert!(thickness.contains("12 of 12 triangles") && thickness.contains("thinnest: 1 at"), "{thickness}");
    assert_eq!(part(&run("examples/visibility", &[path])), [2, 12]);

    let [met, all] = part(&run("examples/thickness", &[]));
    assert!(2 * met > all && met < all, "{met} of {all}");
    let [seen, all] = part(&run("examples/visibility", &[]));
    assert!(all / 5 < seen && seen < all / 2, "{seen} of {all}");
}

#[test]
fn property_test_is_an_example() {
    // Its tests run with all others, by `cargo test --workspace`.
    assert!(run("examples/property_test", &[]).contains("cargo test --example property_test"));
}

#[test]
fn walk_tree_reads_what_raykd_saves() {
    let mesh = Mesh::teapot(6);
    let tree = Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap().tree().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("teapot.kd");
    tree.save(&path).unwrap();
    let point = mesh.positions()[0];
    let [x, y, z] = point.map(|x| x.to_string());
    let text = run("walk_tree", &[path.to_str().unwrap(), &x, &y, &z]);

    let report = tree.validate().unwrap();
    let view = tree.view();
    assert!(text.contains(&format!(
        "{} triangles, {} nodes, depth {}",
        mesh.triangles().len(),
        view.nodes.len(),
        report.depth
    )));
    assert!(text.contains(&format!("{} leaves, {} of them empty", report.leaves, report.empty_leaves)));
    let mut node = 0;
    while let Content::Inner { axis, split, below } = view.nodes[node as usize].content() {
        node = below + u32::from(point[axis as usize] * view.header.scale > split);
    }
    let leaf = view.nodes[node as usize];
    let listed = &view.refs[leaf.first() as usize..][..leaf.count() as usize];
    assert!(text.contains(&format!("triangles {listed:?}")) && !listed.is_empty(), "{text}");

    let damaged = folder.path().join("damaged.kd");
    let head = [b"raykd-kd", &LAYOUT_VERSION.to_le_bytes()[..], b"and no more"].concat();
    std::fs::write(&damaged, head).unwrap();
    let output = Command::new(BUILT.join("walk_tree")).arg(damaged).output().unwrap();
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("truncated"));
}

#[test]
fn walk_tree_needs_the_layouts_alone() {
    let manifest = include_str!("../../shared/examples/walk_tree/Cargo.toml");
    let (_, after) = manifest.split_once("[dependencies]").unwrap();
    let needs: Vec<_> =
        after.lines().take_while(|line| !line.starts_with('[')).filter(|l| !l.is_empty()).collect();
    assert_eq!(needs, [r#"raykd-shared = { workspace = true, features = ["alloc"] }"#]);
}

/// Without a window, and two runs make the same picture.
#[test]
fn pathtracer_makes_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let render = |name: &str, more: &[&str]| {
        let path = folder.path().join(name);
        let usual = ["--headless", "--spp", "2", "--size", "96x64", "--json", "-o", path.to_str().unwrap()];
        let text = run("examples/pathtracer", &[&usual, more].concat());
        // Camera rays and more: half of the picture is floor.
        let rays = text.lines().find_map(|line| line.trim().strip_prefix("\"rays\": ")).unwrap();
        let rays: u64 = rays.trim_end_matches(',').parse().unwrap();
        assert!((2 * 96 * 64 * 3 / 2..2 * 96 * 64 * 8).contains(&rays), "{text}");
        std::fs::read(path).unwrap()
    };
    let once = render("once.png", &[]);
    assert_eq!(once[16..24], [0, 0, 0, 96, 0, 0, 0, 64], "width and height of the PNG");
    assert!(once == render("again.png", &[]), "two pictures of the same differ");
    assert!(once != render("costs.png", &["--cost"]), "costs change nothing");
}

#[test]
fn pathtracer_without_its_window_says_how_to_get_it() {
    let output = Command::new(BUILT.join("examples/pathtracer")).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && error.contains("--features window"), "{error}");
}
