//! A scene beside its device in one value, which moves between threads and is kept in a `static`.
//!
//! `cargo run --release --example scene_in_a_struct`

use raykd::{BuildOptions, Device, Error, Hit, Mesh, Ray, Scene};
use std::sync::OnceLock;

/// What a program keeps of its world.
#[derive(Debug)]
struct World {
    device: Device,
    scene: Scene,
}

impl World {
    fn new(mesh: &Mesh) -> Result<Self, Error> {
        let device = Device::best();
        let scene = Scene::build(&device, mesh, &BuildOptions::default())?;
        Ok(Self { device, scene })
    }

    /// What lies below a place.
    fn below(&self, x: f32, y: f32) -> Result<Hit, Error> {
        Ok(self.scene.closest(&[Ray::new([x, y, 100.0], [0.0, 0.0, -1.0])])?[0])
    }
}

static WORLD: OnceLock<World> = OnceLock::new();

fn main() -> Result<(), Error> {
    // Built by one thread, used by another.
    let world = std::thread::spawn(|| World::new(&Mesh::teapot(8))).join().expect("no panic")?;
    let world = WORLD.get_or_init(|| world);
    println!("on {}: {:?}", world.device.name(), world.below(0.0, 0.0)?);
    Ok(())
}

#[test]
fn all_threads_find_the_same() -> Result<(), Error> {
    let world = WORLD.get_or_init(|| World::new(&Mesh::teapot(4)).expect("a device"));
    let here = world.below(0.1, 0.2)?;
    assert!(here.is_hit());
    let there = std::thread::spawn(|| WORLD.get().expect("made above").below(0.1, 0.2)).join();
    assert_eq!(there.expect("no panic")?, here);
    // The same bytes as on the CPU.
    let scene = Scene::build(&Device::cpu(), &Mesh::teapot(4), &BuildOptions::default())?;
    assert_eq!(scene.closest(&[Ray::new([0.1, 0.2, 100.0], [0.0, 0.0, -1.0])])?, [here]);
    Ok(())
}
