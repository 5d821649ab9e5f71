//! What a user of the published crates would write: a scene, its tree in a file, and a walk through that file.

use raykd::{BuildOptions, Device, KdTree, Mesh, Ray, Scene};
use raykd_kernels::trace::single::{LeafTriangle, Tree, lay_out};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = Mesh::teapot(4);
    let scene = Scene::build(&Device::cpu(), &mesh, &BuildOptions::default())?;
    let path = std::env::temp_dir().join(format!("outside-{}.kd", std::process::id()));
    scene.tree()?.save(&path)?;
    let saved = KdTree::load(&path)?;
    std::fs::remove_file(&path)?;

    let tree: raykd_shared::TreeView<'_> = saved.view();
    let mut leaves = vec![LeafTriangle::default(); tree.refs.len()];
    lay_out(tree, mesh.positions(), mesh.triangles(), &mut leaves).ok_or("not this mesh")?;
    let walker = Tree::new(tree, &leaves).ok_or("not a tree")?;
    let ray = Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0]);
    let hit = walker.closest(&ray).ok_or("a miss")?;
    assert_eq!(scene.closest(&[ray])?, [hit]);
    println!("triangle {} at t = {}", hit.triangle, hit.t);
    Ok(())
}
