//! What a user of the published crates would write: a scene, its tree in a file, a walk through that file, and the same
//! ray on a GPU that the program opens itself.

use raykd::{BuildOptions, Device, KdTree, Mesh, Ray, Scene, wgpu};
use raykd_kernels::trace::single::{LeafTriangle, Tree, lay_out};

/// A device of wgpu, as programs of their own have one; a software driver will do.
fn open() -> Result<(wgpu::Device, wgpu::Queue), Box<dyn std::error::Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    println!("{}", adapter.get_info().name);
    Ok(pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: raykd::required_features(),
        required_limits: raykd::required_limits(adapter.limits()),
        // SAFETY: raykd's kernels keep to their buffers.
        experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
        ..Default::default()
    }))?)
}

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

    let (device, queue) = open()?;
    let on_gpu = Scene::build(&Device::from_wgpu(&device, &queue)?, &mesh, &BuildOptions::default())?;
    assert_eq!(on_gpu.tree()?.digest(), saved.digest(), "the GPU builds another tree");
    assert_eq!(on_gpu.closest(&[ray])?, [hit], "the GPU finds another hit");
    println!("triangle {} at t = {}", hit.triangle, hit.t);
    Ok(())
}
