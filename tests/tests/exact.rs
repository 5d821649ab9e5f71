//! The exact builder: nothing is left out, whatever the mesh, and builds end.

use proptest::prelude::*;
use raykd::{BuildOptions, Builder, KdTree, Mesh, Scene, exact::build};
use raykd_tests::{
    Failure, any_options, cases,
    covers::covers,
    cpu,
    meshes::{Family, RANDOM, Recipe, ZOO, small_mesh},
    rays::rays,
    same,
    trees::without_reference,
};

fn clipped(mesh: &Mesh, clip: bool) -> KdTree {
    build(mesh, &BuildOptions { clip, ..BuildOptions::default() })
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
    fn other_builders_cover_too(recipe in small_mesh()) {
        let mesh = recipe.mesh();
        covers(&mesh, Scene::build(cpu(), &mesh, &BuildOptions::default())?.tree()?.view())?;
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
