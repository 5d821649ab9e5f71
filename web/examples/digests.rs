//! Prints, as JSON, the digests that WebAssembly must give: `digests RAYS SCENE...`, for web/test.

use raykd::{
    BuildOptions, Builder, Device, Intersector, Scene, Traversal,
    internals::{digest_of, hits_digest},
    mesh::MeshSource,
    rays::random,
};
use serde_json::{Map, Value, json};
use std::{env, error::Error};

/// What random rays are made of, as in `raykd bench`.
const SEED: u64 = 2026;
/// With more rays it takes long to test every triangle.
const FEW: usize = 2000;

fn main() -> Result<(), Box<dyn Error>> {
    let mut all = Map::new();
    let mut arguments = env::args().skip(1);
    let count: usize = arguments.next().ok_or("how many rays?")?.parse()?;
    for name in arguments {
        let mesh = name.parse::<MeshSource>()?.load()?.into_local();
        let rays = random(mesh.bounds(), count, SEED);
        let (mut trees, mut hits) = (Map::new(), Map::new());
        for &builder in Builder::ALL {
            let options = BuildOptions::default().with_builder(builder);
            // One thread, as a page's worker has.
            let mut scene = Scene::build(&Device::cpu_with_threads(1)?, &mesh, &options)?;
            trees.insert(builder.to_string(), scene.tree()?.digest().into());
            for intersector in [Intersector::Strict, Intersector::Exact] {
                scene.traverse_by(Traversal::Stack)?;
                scene.intersect_by(intersector)?;
                let goes = |it| intersector.goes_with(it).is_ok() && (it != Traversal::Brute || count <= FEW);
                for traversal in Traversal::ALL.iter().copied().filter(|&it| goes(it)) {
                    scene.traverse_by(traversal)?;
                    let found = hits_digest(&scene.closest(&rays)?);
                    hits.insert(format!("{builder} {traversal} {intersector}"), found.into());
                }
            }
        }
        let scene = Scene::build(&Device::cpu_with_threads(1)?, &mesh, &BuildOptions::default())?;
        let counts = scene.crossings(&rays)?.counts;
        let words: Vec<u32> = counts.iter().flat_map(|count| [count.entering, count.leaving]).collect();
        let crossings = digest_of(&words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>());
        let facts = json!({ "seed": SEED, "trees": trees, "hits": hits, "crossings": crossings });
        all.insert(name, facts);
    }
    println!("{}", Value::Object(all));
    Ok(())
}
