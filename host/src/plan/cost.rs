//! What a choice costs: measured once, on one mesh and device.

use super::choice::Choice;
use crate::{
    Device, DeviceKind, Error, Hit, Mesh, Query, Ray, Scene,
    clock::Instant,
    rays::{Camera, bounces},
};
use std::time::Duration;

/// On a CPU, work is repeated until nothing was faster for so long; in rounds for a part of it.
const ENOUGH: Duration = Duration::from_millis(30);
/// The same on a GPU: longer, because its clocks rise.
const AWAKE: Duration = Duration::from_millis(150);
/// Least repetitions of work; in rounds a part of them.
const TIMES: u32 = 3;
/// Nothing is repeated after this time.
const LONG: Duration = Duration::from_secs(2);
/// A card that was idle is woken until it gets no faster for so long.
const RESTED: Duration = Duration::from_millis(500);
/// No card is woken for longer.
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
    /// The build, the layout of leaves and what the traversal needs besides, in milliseconds.
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
    /// Building and tracing in the slowest round of a measurement, as a multiple of the fastest: far above 1 if the
    /// machine did other work, too.
    pub spread: f64,
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

    /// What the faster of two measurements of the same took, for each cost.
    #[doc(hidden)]
    #[must_use]
    pub fn or_less(self, other: &Self) -> Self {
        Self {
            upload_ms: self.upload_ms.min(other.upload_ms),
            build_ms: self.build_ms.min(other.build_ms),
            launch_ms: self.launch_ms.min(other.launch_ms),
            ray_ns: self.ray_ns.min(other.ray_ns),
            worst_ns: self.worst_ns.min(other.worst_ns),
            transfer_ns: self.transfer_ns.min(other.transfer_ns),
            ..self
        }
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
            least(scene.device(), 1, || {
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
    let (round, scene) = Round::run(device, mesh, choice, rays, 1)?;
    Ok((Round::cost(&[round], choice, moving), scene))
}

/// The best times of one round. Choices take turns in each round, so that what else the machine does for a while seldom
/// slows a choice in all of its rounds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    upload: Duration,
    build: Duration,
    /// Of few rays, and of many.
    few: Duration,
    many: Duration,
    rays: usize,
    triangles: usize,
    bytes: u64,
}

impl Round {
    /// Builds and traces, for its share of what `rounds` take in all.
    pub(super) fn run(
        device: &Device,
        mesh: &Mesh,
        choice: &Choice,
        rays: &[Ray],
        rounds: u32,
    ) -> Result<(Self, Scene), Error> {
        let (options, kept) = (choice.options(), mesh.kept().len());
        // The best of each: what else the machine does only ever slows things down.
        let (mut upload, mut build) = (Duration::MAX, Duration::MAX);
        let mut built = None;
        least(device, rounds, || {
            let mut scene = Scene::build(device, mesh, &options)?;
            scene.traverse_by(choice.traversal(kept))?;
            let times = scene.times();
            upload = upload.min(times.upload);
            let time = times.build + times.layout + times.prepare;
            build = build.min(time);
            built = Some(scene);
            Ok(time)
        })?;
        let scene = built.expect("it was built once at least");
        let most = if choice.tests_all() { few_enough(kept) } else { rays.len() };
        let many = spread(rays, most);
        let [few, time] = [&spread(rays, FEW), &many].map(|rays| traced(&scene, rays, rounds));
        let round = Self {
            upload,
            build,
            few: few?,
            many: time?,
            rays: many.len().max(1),
            triangles: kept,
            bytes: scene.tree_bytes(),
        };
        Ok((round, scene))
    }

    /// Whether one is enough, for what takes so long.
    pub(super) fn is_long(&self) -> bool {
        self.build + self.few + self.many > LONG / 2
    }

    /// What the fastest of each took.
    pub(super) fn cost(rounds: &[Self], choice: &Choice, moving: &Moving) -> Cost {
        let least = |of: fn(&Self) -> Duration| rounds.iter().map(of).min().map_or(0.0, ns);
        let (few, time) = (least(|round| round.few), least(|round| round.many));
        let own = |round: &Self| round.build + round.many;
        let slowest = rounds.iter().map(own).max().map_or(0.0, ns);
        let Self { rays, triangles, bytes, .. } = rounds[0];
        let count = rays as f64;
        // A launch of few rays takes as long as its longest ray: at most what there is to gain by more of them.
        let ray_ns = ((time - few) / (count - FEW as f64).max(1.0)).max(0.2 * time / count);
        Cost {
            choice: choice.name.to_owned(),
            triangles: triangles as u32,
            upload_ms: least(|round| round.upload) * 1e-6,
            build_ms: least(|round| round.build) * 1e-6,
            launch_ms: (time - count * ray_ns).max(0.0) * 1e-6 + moving.once_ms,
            ray_ns,
            worst_ns: ray_ns,
            transfer_ns: moving.ray_ns,
            bytes,
            spread: slowest / least(own).max(1.0),
        }
    }
}

/// Millions of rays a second, as the scene is traced; of brute force by few of them.
///
/// # Errors
/// The device failed.
pub fn speed(scene: &Scene, rays: &[Ray]) -> Result<f64, Error> {
    speed_in(scene, rays, 1)
}

/// The same in one of some rounds.
pub(super) fn speed_in(scene: &Scene, rays: &[Ray], rounds: u32) -> Result<f64, Error> {
    let brute = scene.traversal() == crate::Traversal::Brute;
    let most = if brute { few_enough(scene.header().refs as usize) } else { rays.len() };
    let rays = spread(rays, most);
    Ok(rays.len() as f64 * 1e3 / ns(traced(scene, &rays, rounds)?))
}

/// Rays for which all triangles can be tested in a reasonable time.
fn few_enough(triangles: usize) -> usize {
    (TESTS / triangles.max(1)).max(8 * FEW)
}

/// Best time of tracing rays.
fn traced(scene: &Scene, rays: &[Ray], rounds: u32) -> Result<Duration, Error> {
    let mut resident = scene.resident(rays)?;
    let time = least(scene.device(), rounds, || resident.trace(Query::Closest))?;
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
        until_steady((rested, TIMES), DROWSY, || resident.trace(Query::Closest))?;
    }
    Ok(())
}

/// Does work that says how long it took, until it gets no faster; its share if that goes in rounds.
fn least(
    device: &Device,
    rounds: u32,
    work: impl FnMut() -> Result<Duration, Error>,
) -> Result<Duration, Error> {
    let enough = if device.kind() == DeviceKind::Cpu { ENOUGH } else { AWAKE };
    until_steady((enough / rounds, TIMES.div_ceil(rounds)), LONG, work)
}

/// Does work until it has got no faster for so long and so often, or for `long` in all; its best time.
fn until_steady(
    (enough, often): (Duration, u32),
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
        if start.elapsed() > long || times >= often && since.elapsed() > enough {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::CHOICES;

    #[test]
    fn the_fastest_of_all_rounds_counts() {
        let ms = Duration::from_millis;
        let round = |build: u64, few: u64, many: u64| Round {
            upload: ms(1),
            build: ms(build),
            few: ms(few),
            many: ms(many),
            rays: 1064,
            triangles: 7,
            bytes: 9,
        };
        let moving = Moving { once_ms: 0.5, ray_ns: 3.0 };
        let cost = Round::cost(&[round(4, 3, 22), round(8, 2, 12), round(6, 9, 50)], &CHOICES[1], &moving);
        assert_eq!((cost.triangles, cost.bytes, cost.upload_ms, cost.build_ms), (7, 9, 1.0, 4.0));
        // 12 ms for all rays, 2 for the first 64.
        assert!((cost.ray_ns - 1e4).abs() < 1e-6, "{cost:?}");
        assert!((cost.launch_ms - (12.0 - 10.64 + 0.5)).abs() < 1e-9, "{cost:?}");
        assert!((cost.spread - 56.0 / 20.0).abs() < 1e-12, "{cost:?}");
        let [first, second] =
            [round(4, 3, 22), round(8, 2, 12)].map(|r| Round::cost(&[r], &CHOICES[1], &moving));
        let less = first.clone().or_less(&second);
        assert_eq!((less.build_ms, less.ray_ns), (first.build_ms, second.ray_ns));
        assert_eq!(less, second.or_less(&first));
    }
}
