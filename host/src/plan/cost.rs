//! What a choice costs: measured once, on one mesh and device.

use super::choice::Choice;
use crate::{
    Device, DeviceKind, Error, Hit, Mesh, Query, Ray, Scene,
    clock::Instant,
    rays::{Camera, bounces},
};
use std::time::Duration;

/// Repeated until nothing was faster for so long, at least [`TIMES`] times;
const ENOUGH: Duration = Duration::from_millis(30);
/// on a graphics card longer, because its clocks rise.
const AWAKE: Duration = Duration::from_millis(150);
const TIMES: usize = 3;
/// Nothing is repeated after this time.
const LONG: Duration = Duration::from_secs(2);
/// A card that lay idle works until it has got no faster for so long;
const RESTED: Duration = Duration::from_millis(500);
/// at most until then.
const DROWSY: Duration = Duration::from_secs(3);
/// Tests of triangles that brute force is given; few rays tell what it costs.
const TESTS: usize = 1 << 26;
/// Rays so few that they take as long as a launch.
const FEW: usize = 64;

/// What a mesh and rays cost by one [`Choice`].
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Cost {
    /// Name of the choice.
    pub choice: String,
    /// Triangles in the tree.
    pub triangles: u32,
    /// Mesh to device, in milliseconds.
    pub upload_ms: f64,
    /// The build and the layout of leaves, in milliseconds.
    pub build_ms: f64,
    /// Once a batch of rays: its longest ray, and moving anything at all, in milliseconds.
    pub launch_ms: f64,
    /// A ray, nanoseconds: mean of a picture's and a bounce from each hit.
    pub ray_ns: f64,
    /// The same where a first look at a triangle tells nothing, and all are tested in full: without a tree, if
    /// triangles are tiny in a large scene.
    pub worst_ns: f64,
    /// A ray to the device and its hit back, nanoseconds.
    pub transfer_ns: f64,
    /// Bytes of nodes and references.
    pub bytes: u64,
}

impl Cost {
    /// All but the rays, in milliseconds.
    #[doc(hidden)]
    pub fn before_ms(&self) -> f64 {
        self.upload_ms + self.build_ms
    }

    /// What depends on the tree: building it and tracing so many rays, in milliseconds.
    #[doc(hidden)]
    pub fn own_ms(&self, rays: f64) -> f64 {
        self.build_ms + self.launch_ms + rays * self.ray_ns * 1e-6
    }

    /// Tracing so many rays and moving them, in milliseconds.
    #[doc(hidden)]
    pub fn rays_ms(&self, rays: f64) -> f64 {
        self.launch_ms + rays * (self.ray_ns + self.transfer_ns) * 1e-6
    }

    /// From the mesh to the last hit, in milliseconds.
    pub fn total_ms(&self, rays: f64) -> f64 {
        self.before_ms() + self.rays_ms(rays)
    }

    /// Millions of rays a second, while there are enough of them.
    pub fn mrays(&self) -> f64 {
        1e3 / self.ray_ns
    }
}

/// What it takes to move rays to a device and their hits back; no tree has a say in that.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Moving {
    /// Of however few, in milliseconds.
    pub once_ms: f64,
    /// Each more, in nanoseconds.
    pub ray_ns: f64,
}

impl Moving {
    /// Moves some rays, and all of them, until it gets no faster. A graphics card is woken before: this is done before
    /// anything is measured.
    ///
    /// # Errors
    /// The device failed.
    pub fn measure(scene: &Scene, rays: &[Ray]) -> Result<Self, Error> {
        wake(scene, rays, RESTED)?;
        let time = |rays: &[Ray]| {
            least(scene.device(), || {
                let start = Instant::now();
                let mut resident = scene.resident(rays)?;
                let there = start.elapsed();
                resident.trace(Query::Closest)?;
                let start = Instant::now();
                resident.hits()?;
                Ok(there + start.elapsed())
            })
        };
        let (few, many) = (ns(time(&spread(rays, FEW))?), ns(time(rays)?));
        let ray_ns = (many - few).max(0.0) / rays.len().saturating_sub(FEW).max(1) as f64;
        Ok(Self { once_ms: few * 1e-6, ray_ns })
    }
}

/// Builds and traces until the costs are known.
///
/// # Errors
/// The mesh does not fit the device, or it failed.
pub fn measure(
    device: &Device,
    mesh: &Mesh,
    choice: &Choice,
    rays: &[Ray],
    moving: &Moving,
) -> Result<(Cost, Scene), Error> {
    let options = choice.options();
    // The best of each: what else the machine does only ever slows things down.
    let (mut upload, mut build) = (Duration::MAX, Duration::MAX);
    let mut scene = Scene::build(device, mesh, &options)?;
    least(device, || {
        scene = Scene::build(device, mesh, &options)?;
        let times = scene.times();
        upload = upload.min(times.upload);
        build = build.min(times.build + times.layout);
        Ok(times.build)
    })?;
    let kept = mesh.kept().len();
    scene.traverse_by(choice.traversal(kept))?;
    let most = if choice.has_tree() { rays.len() } else { few_enough(kept) };
    let many = spread(rays, most);
    let [few_time, time] = [&spread(rays, FEW), &many].map(|rays| traced(&scene, rays));
    let (few_time, time) = (few_time?, time?);
    let count = many.len().max(1) as f64;
    // A launch of few rays takes as long as its longest ray: at most what there is to gain by more of them.
    let ray_ns = ((ns(time) - ns(few_time)) / (count - FEW as f64).max(1.0)).max(0.2 * ns(time) / count);
    Ok((
        Cost {
            choice: choice.name.to_owned(),
            triangles: kept as u32,
            upload_ms: ns(upload) * 1e-6,
            build_ms: ns(build) * 1e-6,
            launch_ms: (ns(time) - count * ray_ns).max(0.0) * 1e-6 + moving.once_ms,
            ray_ns,
            worst_ns: ray_ns,
            transfer_ns: moving.ray_ns,
            bytes: scene.tree_bytes(),
        },
        scene,
    ))
}

/// Millions of rays a second, as the scene is traced; of brute force by few of them.
///
/// # Errors
/// The device failed.
pub fn speed(scene: &Scene, rays: &[Ray]) -> Result<f64, Error> {
    let brute = scene.traversal() == crate::Traversal::Brute;
    let most = if brute { few_enough(scene.header().refs as usize) } else { rays.len() };
    let rays = spread(rays, most);
    Ok(rays.len() as f64 * 1e3 / ns(traced(scene, &rays)?))
}

/// Rays for which all triangles can be tested in a reasonable time.
fn few_enough(triangles: usize) -> usize {
    (TESTS / triangles.max(1)).max(8 * FEW)
}

/// Best time of tracing rays.
fn traced(scene: &Scene, rays: &[Ray]) -> Result<Duration, Error> {
    let mut resident = scene.resident(rays)?;
    let time = least(scene.device(), || resident.trace(Query::Closest))?;
    resident.hits()?;
    Ok(time)
}

/// Keeps a graphics card busy until it has got no faster for so long: its clocks rise, in steps. The CPU and software
/// rasterisers need none.
///
/// # Errors
/// The device failed.
pub fn wake(scene: &Scene, rays: &[Ray], rested: Duration) -> Result<(), Error> {
    if scene.device().is_card() {
        let mut resident = scene.resident(rays)?;
        until_steady(rested, DROWSY, || resident.trace(Query::Closest))?;
    }
    Ok(())
}

/// Does work that says how long it took, until it gets no faster.
fn least(device: &Device, work: impl FnMut() -> Result<Duration, Error>) -> Result<Duration, Error> {
    until_steady(if device.kind() == DeviceKind::Cpu { ENOUGH } else { AWAKE }, LONG, work)
}

/// Does work until it has got no faster for `enough` and [`TIMES`], or for `long` in all; its best time.
fn until_steady(
    enough: Duration,
    long: Duration,
    mut work: impl FnMut() -> Result<Duration, Error>,
) -> Result<Duration, Error> {
    let start = Instant::now();
    let (mut best, mut slower, mut since) = (Duration::MAX, Duration::MAX, start);
    for times in 1.. {
        let time = work()?;
        best = best.min(time);
        if time < slower.mul_f64(0.98) {
            (slower, since) = (time, Instant::now());
        }
        if start.elapsed() > long || times >= TIMES && since.elapsed() > enough {
            break;
        }
    }
    Ok(best)
}

/// So many of the rays, from all over them; all if there are not so many.
fn spread(rays: &[Ray], count: usize) -> Vec<Ray> {
    if count >= rays.len() {
        return rays.to_vec();
    }
    (0..count).map(|i| rays[i * rays.len() / count.max(1)]).collect()
}

/// About so many rays of the usual kind: a picture of the whole mesh, and a bounce from each hit.
///
/// # Errors
/// Those of `closest`, which finds the picture's hits.
pub fn usual_rays<E>(
    mesh: &Mesh,
    count: usize,
    closest: impl FnOnce(&[Ray]) -> Result<Vec<Hit>, E>,
) -> Result<Vec<Ray>, E> {
    let side = ((count as f64 / 1.5).sqrt() as u32).max(8);
    let mut rays = Camera::framing(mesh.bounds()).rays(side, side);
    let hits = closest(&rays)?;
    rays.extend(bounces(mesh, &rays, &hits, 1));
    Ok(rays)
}

fn ns(time: Duration) -> f64 {
    time.as_nanos() as f64
}
