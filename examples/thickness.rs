//! How thick a mesh is at each triangle: the way from its middle straight through to the other side.
//!
//! `cargo run --release --example thickness` measures the teapot; name a mesh file to measure that instead. Triangles
//! are counterclockwise seen from outside.

use raykd::{BuildOptions, Device, Intersector, Mesh, Query, Ray, Scene};

fn main() -> anyhow::Result<()> {
    let mesh = std::env::args_os().nth(1).map_or(Ok(Mesh::teapot(8)), Mesh::load)?;
    let mut scene = Scene::build(&Device::best(), &mesh, &BuildOptions::default())?;
    // No rounding decides what is met, however thin the wall or flat the angle.
    scene.intersect_by(Intersector::Exact)?;
    let inward = |&triangle: &u32| {
        let [a, b, c] = mesh.triangles()[triangle as usize].map(|vertex| mesh.positions()[vertex as usize]);
        let [v, w] = [b, c].map(|end| [0, 1, 2].map(|i| end[i] - a[i]));
        let normal = [v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]];
        let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt();
        // As long as the unit of the mesh, so that t is a length.
        Ray::new([0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0), normal.map(|x| -x / length))
    };
    let rays: Vec<Ray> = mesh.kept().iter().map(inward).collect();
    // The ray starts on its triangle, or a little off it: that one is left out, by number and not by a distance.
    let hits = scene.trace_except(Query::Closest, &rays, mesh.kept())?.hits;
    let met = mesh.kept().iter().zip(&hits).filter(|(_, hit)| hit.is_hit());
    let thin = met.clone().min_by(|a, b| a.1.t.total_cmp(&b.1.t));
    let (triangle, hit) = thin.ok_or_else(|| anyhow::anyhow!("nothing lies behind any triangle"))?;
    println!("{} of {} triangles have another behind them", met.count(), rays.len());
    println!("thinnest: {} at triangle {triangle}, up to triangle {}", hit.t, hit.triangle);
    Ok(())
}
