//! The exact builder: nothing is left out, whatever the mesh, and builds end.

use proptest::prelude::*;
use raykd::{BuildOptions, Builder, KdTree, Mesh, Scene};
use raykd_tests::{
    Failure, any_options, cases,
    covers::covers,
    cpu, devices, gpu,
    meshes::{Family, RANDOM, Recipe, ZOO, any_mesh, small_mesh},
    rays::rays,
    same,
    trees::without_reference,
};

/// The tree by the host's form, which a CPU uses.
fn build(mesh: &Mesh, options: &BuildOptions) -> KdTree {
    let options = options.clone().with_builder(Builder::Exact).with_profile(true);
    let scene = Scene::build(cpu(), mesh, &options).expect("a CPU builds it");
    assert!(scene.times().kernels.is_empty(), "it was built by kernels");
    scene.tree().expect("a CPU gives it back")
}

fn clipped(mesh: &Mesh, clip: bool) -> KdTree {
    build(mesh, &BuildOptions::default().with_clip(clip))
}

/// By kernels on every device, with lists of faces in nodes of more than `small` references: each tree is the host's.
fn same_by_kernels(mesh: &Mesh, options: &BuildOptions, small: u32) -> Result<(), Failure> {
    let host = build(mesh, options);
    let expected = host.view();
    for named in devices() {
        let tree = Scene::sweep_by_kernels(&named.device, mesh, options, small)?.tree()?;
        let found = tree.view();
        same(&format!("header by {}", named.name), &[*expected.header], &[*found.header])?;
        same(&format!("nodes by {}", named.name), expected.nodes, found.nodes)?;
        same(&format!("references by {}", named.name), expected.refs, found.refs)?;
    }
    Ok(())
}

/// A builder without a form of its own on a CPU.
fn any_other() -> impl Strategy<Value = Builder> {
    prop::sample::select(vec![Builder::Median, Builder::Zhou, Builder::Binned])
}

fn any_small() -> impl Strategy<Value = u32> {
    prop::sample::select(vec![0, 5, 64])
}

proptest! {
    #![proptest_config(cases(48))]
    #[test]
    fn kernels_build_the_same_tree(recipe in any_mesh(), small in any_small()) {
        same_by_kernels(&recipe.mesh(), &BuildOptions::default(), small)?;
    }

    #[test]
    fn kernels_do_so_with_any_options(
        recipe in small_mesh(), options in any_options(Just(Builder::Exact)), small in any_small(),
    ) {
        same_by_kernels(&recipe.mesh(), &options, small)?;
    }
}

proptest! {
    #![proptest_config(cases(96))]
    #[test]
    fn every_point_of_every_triangle_is_covered(recipe in small_mesh(), options in any_options(Just(Builder::Exact))) {
        let mesh = recipe.mesh();
        let tree = build(&mesh, &options);
        covers(&mesh, tree.view())?;
        prop_assert!(tree.view().header.depth <= options.max_depth);
    }

    #[test]
    fn other_builders_cover_too(recipe in small_mesh(), options in any_options(any_other())) {
        let mesh = recipe.mesh();
        covers(&mesh, Scene::build(cpu(), &mesh, &options)?.tree()?.view())?;
    }

    #[test]
    fn hits_do_not_depend_on_the_builder(recipe in small_mesh(), seed in any::<u64>()) {
        let mesh = recipe.mesh();
        let binned = Scene::build(cpu(), &mesh, &BuildOptions::default())?;
        for clip in [false, true] {
            let tree = clipped(&mesh, clip);
            let rays = rays(&mesh, tree.view(), 200, seed);
            let scene = Scene::with_tree(cpu(), &mesh, &tree)?;
            same(&format!("hits, clip {clip}"), &binned.closest(&rays)?, &scene.closest(&rays)?)?;
        }
    }
}

#[test]
fn every_family_ends_with_few_references() -> Result<(), Failure> {
    for family in RANDOM.into_iter().chain(ZOO) {
        for size in [1, 2, 33, 6000] {
            let recipe = Recipe { family, size, seed: 7 };
            let mesh = recipe.mesh();
            for clip in [false, true] {
                let tree = clipped(&mesh, clip);
                tree.validate()?;
                let refs = tree.view().refs.len();
                println!("{recipe:?}, clip {clip}: {:.1} references a triangle", refs as f64 / size as f64);
                assert!(refs <= 64 * mesh.kept().len(), "{recipe:?}, clip {clip}: {refs} references");
                if size <= 33 {
                    covers(&mesh, tree.view()).map_err(|e| Failure(format!("{recipe:?}: {e}")))?;
                }
            }
        }
    }
    Ok(())
}

#[test]
fn where_splitting_separates_nothing_kernels_halve_the_depth_too() -> Result<(), Failure> {
    let mesh = Recipe { family: Family::Flat, size: 150, seed: 1 }.mesh();
    let options = BuildOptions::default().with_price(0.0).with_cost_step(0.0);
    same_by_kernels(&mesh, &options, 64)?;
    let scene = Scene::sweep_by_kernels(cpu(), &mesh, &options, 64)?;
    println!("{:?}, {} retries", scene.header(), scene.times().retries);
    // Its leaves get no smaller for that, and depth is all that ends it.
    assert!(scene.header().depth * 2 < options.max_depth && scene.times().retries > 1);
    Ok(())
}

/// Prints times too, of a larger mesh, the best of three, if `RAYKD_MESH` names one.
#[test]
fn where_lists_of_faces_end_does_not_show() -> Result<(), Failure> {
    let (mesh, rounds) = match std::env::var_os("RAYKD_MESH") {
        Some(path) => (Mesh::load(path).expect("a mesh"), 3),
        None => (Mesh::teapot(16), 1),
    };
    let expected = build(&mesh, &BuildOptions::default()).digest();
    for small in [16, 32, 64, 96, 128, 256] {
        let mut best = f64::INFINITY;
        let mut peak = 0;
        for _ in 0..rounds {
            let scene = Scene::sweep_by_kernels(gpu(), &mesh, &BuildOptions::default(), small)?;
            assert_eq!(scene.tree()?.digest(), expected, "{small}");
            best = best.min(scene.times().build.as_secs_f64());
            peak = scene.times().peak_bytes;
        }
        println!("{small}: {:.2} ms, {} MB", best * 1e3, peak / 1_000_000);
    }
    Ok(())
}

/// Devices that bind more than llvmpipe's 128 MiB would need a mesh of many millions of triangles for this.
#[test]
fn what_a_device_has_no_room_for_the_host_builds() -> Result<(), Failure> {
    let mesh = Mesh::teapot(140);
    let options = BuildOptions::default().with_builder(Builder::Exact);
    let scene = Scene::build(gpu(), &mesh, &options)?;
    // Six lists of 8 bytes a face, with room for 2.25 references a triangle.
    let fits = 108 * mesh.kept().len() as u64 <= gpu().limit().bytes;
    assert_eq!(scene.times().by_host, !fits);
    assert_eq!(scene.tree()?.digest(), build(&mesh, &options).digest());
    Ok(())
}

#[test]
fn threads_do_not_show() -> Result<(), Failure> {
    let mesh = Mesh::teapot(24);
    for clip in [false, true] {
        let build = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads start").install(|| clipped(&mesh, clip).digest())
        };
        assert_eq!(build(1), build(3), "clip {clip}");
    }
    Ok(())
}

#[test]
fn a_missing_reference_is_noticed() {
    let mesh = Recipe { family: Family::Soup, size: 60, seed: 5 }.mesh();
    let tree = clipped(&mesh, true);
    let refs = tree.view().refs.len() as u32;
    let noticed = |&n: &u32| without_reference(&tree, n).is_ok_and(|t| covers(&mesh, t.view()).is_err());
    let (number, found) = (refs.min(100), (0..refs.min(100)).filter(noticed).count());
    // A box that is rounded outward, or clipped by planes alone, may reach a cell that the triangle does not.
    assert!(found * 100 >= number as usize * 80, "{found} of {number}");
}
