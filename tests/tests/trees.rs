//! The whole build: the same bytes on every device, and every triangle where it belongs.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Builder, KdTree, Mesh, Scene,
    shared::{
        TreeView,
        limits::{BRANCH, MAX_DEPTH},
    },
};
use raykd_tests::{
    Failure, any_options, cases, devices,
    meshes::{Family, RANDOM, Recipe, ZOO, any_mesh},
    same,
    trees::check,
};

/// Builds on every device, checks that the trees are one, and returns it.
fn build_everywhere(mesh: &Mesh, options: &BuildOptions) -> Result<KdTree, Failure> {
    let mut first: Option<KdTree> = None;
    for named in devices() {
        let tree = Scene::build(&named.device, mesh, options)?.tree()?;
        if let Some(expected) = &first {
            let (expected, found) = (expected.view(), tree.view());
            same(&format!("header by {}", named.name), &[*expected.header], &[*found.header])?;
            same(&format!("nodes by {}", named.name), expected.nodes, found.nodes)?;
            same(&format!("references by {}", named.name), expected.refs, found.refs)?;
        }
        first.get_or_insert(tree);
    }
    first.ok_or_else(|| Failure("no device".to_owned()))
}

fn any_kernel_builder() -> impl Strategy<Value = Builder> {
    prop::sample::select(vec![Builder::Median, Builder::Binned, Builder::Zhou])
}

proptest! {
    #![proptest_config(cases(96))]
    #[test]
    fn all_devices_build_the_same_valid_tree(recipe in any_mesh()) {
        let mesh = recipe.mesh();
        check(&mesh, build_everywhere(&mesh, &BuildOptions::default())?.view(), true)?;
    }

    #[test]
    fn with_any_options_too(recipe in any_mesh(), options in any_options(any_kernel_builder())) {
        let mesh = recipe.mesh();
        let tree = build_everywhere(&mesh, &options)?;
        check(&mesh, tree.view(), options.clip)?;
        prop_assert!(tree.view().header.depth <= options.max_depth);
    }
}

#[test]
fn every_family_builds_at_sizes_where_something_changes() {
    for family in RANDOM.into_iter().chain(ZOO) {
        // One triangle, a treelet and one more, a chunk and one more, several chunks.
        for size in [1, 32, 33, 512, 513, 2049] {
            let recipe = Recipe { family, size, seed: 7 };
            let mesh = recipe.mesh();
            let tree = build_everywhere(&mesh, &BuildOptions::default());
            tree.and_then(|tree| check(&mesh, tree.view(), true))
                .unwrap_or_else(|e| panic!("{recipe:?}: {e}"));
        }
    }
}

#[test]
fn the_teapot_builds_the_same_tree_everywhere() {
    let mesh = Mesh::teapot(10);
    let tree = build_everywhere(&mesh, &BuildOptions::default()).unwrap();
    check(&mesh, tree.view(), true).unwrap();
    let report = tree.validate().unwrap();
    assert!(report.depth > 8 && report.largest_leaf < 64, "{report:?}");
}

/// More large nodes on a level than one workgroup gives places to, and more references in one than one counts.
#[test]
fn levels_of_several_blocks_and_nodes_of_several_chunks() {
    /// How many references the leaves below a node hold; and how many nodes are large, by depth.
    fn held(tree: TreeView<'_>, at: u32, depth: usize, large: &mut [u32]) -> u32 {
        let node = tree.nodes[at as usize];
        if node.is_leaf() {
            return node.count();
        }
        let below = node.below();
        let held = held(tree, below, depth + 1, large) + held(tree, below + 1, depth + 1, large);
        // So many references come of more than 256.
        large[depth] += u32::from(held > 3 * BRANCH);
        held
    }
    let mesh = Mesh::teapot(68);
    let tree = build_everywhere(&mesh, &BuildOptions::default()).unwrap();
    check(&mesh, tree.view(), true).unwrap();
    let mut large = [0; MAX_DEPTH as usize + 1];
    held(tree.view(), 0, 0, &mut large);
    assert!(large.iter().any(|&nodes| nodes > 256), "{large:?} large nodes");
}

#[test]
fn budgets_are_kept() {
    let meshes = [Mesh::teapot(5), Recipe { family: Family::Soup, size: 250, seed: 3 }.mesh()];
    for (mesh, builder) in meshes.iter().flat_map(|m| [Builder::Binned, Builder::Exact].map(|b| (m, b))) {
        let refs = |budget| {
            let options = BuildOptions::default().with_budget(budget).with_builder(builder).with_price(0.0);
            build_everywhere(mesh, &options).unwrap().view().refs.len() as f32 / mesh.kept().len() as f32
        };
        let free = refs(None);
        for budget in [1.6, 1.3, 1.0] {
            let kept = refs(Some(budget));
            assert!(kept <= budget && budget < free, "{builder:?}: {kept} for {budget}, {free} without");
        }
    }
}

#[test]
fn identical_triangles_end_in_few_leaves() {
    let mesh = Recipe { family: Family::Identical, size: 3000, seed: 1 }.mesh();
    let tree = build_everywhere(&mesh, &BuildOptions::default()).unwrap();
    assert_eq!(tree.validate().unwrap().largest_leaf, 3000);
    // Planes that do not pay are tried three times in a row, in vain.
    assert!(tree.view().refs.len() <= 8 * 3000, "splitting cannot separate them");
}

#[test]
fn building_twice_gives_the_same_bytes() {
    let mesh = Recipe { family: Family::Soup, size: 5000, seed: 3 }.mesh();
    for named in devices() {
        let build = || Scene::build(&named.device, &mesh, &BuildOptions::default()).unwrap().tree().unwrap();
        assert_eq!(build().digest(), build().digest(), "{}", named.name);
    }
}
