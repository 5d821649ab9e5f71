//! Repeating builds and traces, and taking medians.

use crate::report::{Table, three};
use raykd::{
    BuildOptions, BuildTimes, Builder, Device, DeviceKind, Error, Hit, KdTree, KernelTimes, Mesh, Query, Ray,
    ResidentRays, Scene, Traced,
    internals::{SWEEP_LISTED, reserve},
    shared::Report,
};
use std::{
    iter,
    time::{Duration, Instant},
};

/// Repetitions that a median is taken of.
const TIMES: usize = 5;
/// A build slower than this is repeated [`SLOW_TIMES`] times.
const SLOW: Duration = Duration::from_secs(2);
/// Repetitions of slow builds, of uploads and of downloads.
const SLOW_TIMES: usize = 3;
/// Pictures are not traced again once this time is spent.
const ENOUGH: Duration = Duration::from_secs(1);
/// Pictures are traced again until this time is spent, however often.
const SHORT: Duration = Duration::from_millis(30);

/// Most parts in which all hits are traced.
const PARTS: usize = 12;
/// Least bytes of hits in a part.
const PART: usize = 1 << 24;

/// A graphics card that was idle is woken before anything is timed, until no trace was faster than those before for
/// so long.
const AWAKE: Duration = Duration::from_millis(300);

/// Wakes a graphics card by random rays, of which the scene needs none of its own.
fn wake(scene: &Scene) -> Result<(), Error> {
    if !scene.device().is_card() {
        return Ok(());
    }
    let header = scene.header();
    raykd::internals::wake(scene, &raykd::rays::random((header.lo, header.hi), 1 << 18, 0), AWAKE)
}

/// A tree, and what its build took: medians.
#[derive(Debug)]
pub(super) struct BuildMeasure {
    pub scene: Scene,
    pub tree: KdTree,
    pub report: Report,
    pub upload: Duration,
    pub build: Duration,
    pub layout: Duration,
    /// How many builds these are medians of; one more came before.
    pub builds: usize,
    /// Of one more build, if profiled: name, dispatches and time of every kernel.
    pub kernels: Vec<Kernel>,
}

/// Time of one kernel in a build.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Kernel {
    pub name: &'static str,
    pub dispatches: u32,
    pub ms: f64,
    /// Bytes read and written in buffers, if they were counted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
}

/// Where a build's time went.
pub(super) fn kernel_table(title: &str, kernels: &[Kernel]) -> Table {
    let total: f64 = kernels.iter().map(|kernel| kernel.ms).sum();
    let counted = kernels.iter().any(|kernel| kernel.bytes.is_some());
    let mut heads = vec![title, "dispatches", "ms", "%"];
    if counted {
        heads.extend(["MB", "GB/s"]);
    }
    let mut table = Table::new(heads);
    for Kernel { name, dispatches, ms, bytes } in kernels {
        let share = format!("{:.1}", 100.0 * ms / total.max(f64::MIN_POSITIVE));
        let mut row = vec![(*name).to_owned(), dispatches.to_string(), three(*ms), share];
        if counted {
            let mb = bytes.unwrap_or(0) as f64 * 1e-6;
            row.extend([three(mb), three(mb / ms.max(f64::MIN_POSITIVE))]);
        }
        table.row(row);
    }
    table
}

/// Builds once to warm up, then several times.
pub(super) fn build(device: &Device, mesh: &Mesh, options: &BuildOptions) -> Result<BuildMeasure, Error> {
    let plain = options.clone().with_profile(false);
    let start = Instant::now();
    let mut scene = Scene::build(device, mesh, &plain)?;
    let times = if start.elapsed() > SLOW { SLOW_TIMES } else { TIMES };
    wake(&scene)?;
    let (mut upload, mut build, mut layout) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..times {
        // The one before goes first: peak memory is that of one build.
        drop(scene);
        scene = Scene::build(device, mesh, &plain)?;
        let BuildTimes { upload: up, build: kernels, layout: laid, .. } = *scene.times();
        upload.push(up);
        build.push(kernels);
        layout.push(laid);
    }
    let mut kernels = Vec::new();
    if options.profile {
        let profiled = Scene::build(device, mesh, options)?;
        let moved = moved(device, mesh, options)?;
        let row = |&KernelTimes { name, dispatches, time, bytes, .. }: &KernelTimes| Kernel {
            name,
            dispatches,
            ms: ms(time),
            bytes: bytes.or_else(|| moved.iter().find(|kernel| kernel.name == name)?.bytes),
        };
        kernels = profiled.times().kernels.iter().map(row).collect();
    }
    let tree = scene.tree()?;
    let report = tree.validate().map_err(|error| Error::DeviceFailed {
        adapter: device.name().to_owned(),
        what: format!("it built a {error}"),
    })?;
    let [upload, build, layout] = [upload, build, layout].map(median);
    Ok(BuildMeasure { scene, tree, report, upload, build, layout, builds: times, kernels })
}

/// What kernels move that ran on a GPU: the same ones are counted on the CPU, if compiled to.
fn moved(device: &Device, mesh: &Mesh, options: &BuildOptions) -> Result<Vec<KernelTimes>, Error> {
    let cpu = Device::cpu();
    let counted = match device {
        _ if device.kind() == DeviceKind::Cpu || !cfg!(feature = "traffic") => return Ok(Vec::new()),
        _ if options.builder == Builder::Exact => Scene::sweep_by_kernels(&cpu, mesh, options, SWEEP_LISTED)?,
        _ => Scene::build(&cpu, mesh, options)?,
    };
    Ok(counted.times().kernels.clone())
}

/// Traces rays once to warm up, then several times while they stay on the device.
pub(super) fn trace(scene: &Scene, query: Query, rays: &[Ray]) -> Result<Traced, Error> {
    let mut total = Traced::default();
    total.hits.reserve(rays.len());
    for part in rays.chunks(scene.batch_limit()) {
        let mut upload = Vec::new();
        let mut resident = None;
        for _ in 0..SLOW_TIMES {
            drop(resident.take());
            let start = Instant::now();
            resident = Some(scene.resident(part)?);
            upload.push(start.elapsed());
        }
        let mut resident = resident.expect("made in the loop above");
        wake(scene)?;
        resident.trace(query)?;
        let times = (0..TIMES).map(|_| resident.trace(query)).collect::<Result<_, _>>()?;
        let mut download = Vec::new();
        let mut hits = Vec::new();
        for _ in 0..SLOW_TIMES {
            drop(std::mem::take(&mut hits));
            let start = Instant::now();
            hits = resident.hits()?;
            download.push(start.elapsed());
        }
        total.invalid += resident.invalid()?;
        total.hits.append(&mut hits);
        total.times.upload += median(upload);
        total.times.trace += median(times);
        total.times.download += median(download);
    }
    Ok(total)
}

/// All hits, up to a limit a ray, several times: part by part, each a twelfth of what is written, so that there is not
/// much more in memory than that. A ray has as many hits as the limit, the rest of them misses, and how many it has.
pub(super) fn all(scene: &Scene, rays: &[Ray], limit: u32) -> Result<(Traced, Vec<u32>), Error> {
    let (mut total, mut totals) = (Traced::default(), Vec::new());
    reserve(&mut total.hits, "hits", (rays.len() as u64).saturating_mul(limit.into()))?;
    reserve(&mut totals, "totals", rays.len() as u64)?;
    let least = (PART / (size_of::<Hit>() * limit.max(1) as usize)).max(1);
    for part in rays.chunks(rays.len().div_ceil(PARTS).max(least).min(scene.batch_limit())) {
        let (mut upload, mut trace, mut download) = (Vec::new(), Vec::new(), Vec::new());
        wake(scene)?;
        let mut all = scene.all(part, limit)?;
        for _ in 0..TIMES {
            drop(all);
            all = scene.all(part, limit)?;
            upload.push(all.times.upload);
            trace.push(all.times.trace);
            download.push(all.times.download);
        }
        for ray in 0..part.len() {
            let hits = all.of(ray);
            total.hits.extend_from_slice(hits);
            total.hits.extend(iter::repeat_n(Hit::NONE, limit as usize - hits.len()));
        }
        totals.append(&mut all.totals);
        total.invalid += all.invalid;
        total.times.upload += median(upload);
        total.times.trace += median(trace);
        total.times.download += median(download);
    }
    Ok((total, totals))
}

/// Median time to trace rays, less often if it takes long: for large pictures.
pub(super) fn time(scene: &Scene, query: Query, rays: &[Ray]) -> Result<Duration, Error> {
    // No rays take no time, however often they are traced.
    if rays.is_empty() {
        return Ok(Duration::ZERO);
    }
    let parts = rays.chunks(scene.batch_limit()).map(|part| scene.resident(part));
    let mut parts = parts.collect::<Result<Vec<ResidentRays>, _>>()?;
    let mut all = || parts.iter_mut().map(|part| part.trace(query)).sum::<Result<_, _>>();
    wake(scene)?;
    let first: Duration = all()?;
    let mut times = Vec::new();
    let mut spent = first;
    // Short ones more often: a card that idled takes a while to come to speed.
    while spent < ENOUGH && (times.len() < TIMES || spent < SHORT) {
        let time = all()?;
        spent += time;
        times.push(time);
    }
    // The first alone took as long as all may.
    Ok(if times.is_empty() { first } else { median(times) })
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times[times.len() / 2]
}

/// Milliseconds.
pub(super) fn ms(time: Duration) -> f64 {
    time.as_nanos() as f64 / 1.0e6
}

/// Millions of rays a second; none if there were no rays.
pub(super) fn mrays(rays: usize, time: Duration) -> f64 {
    let seconds = time.as_secs_f64();
    if rays == 0 || seconds == 0.0 { 0.0 } else { rays as f64 / seconds * 1.0e-6 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_rates() {
        let seconds = |s| Duration::from_secs(s);
        assert_eq!(median(vec![seconds(9), seconds(1), seconds(2)]), seconds(2));
        assert_eq!(ms(Duration::from_micros(1500)), 1.5);
        assert_eq!(mrays(3_000_000, seconds(2)), 1.5);
        assert_eq!(mrays(0, seconds(2)), 0.0);
        assert_eq!(mrays(5, Duration::ZERO), 0.0);
    }

    #[test]
    fn measured_hits_are_the_scenes() {
        let device = Device::cpu();
        let mesh = Mesh::teapot(2);
        let mut rays = raykd::rays::random(mesh.bounds(), 100, 1);
        rays[3].t_max = f32::NAN;
        let measured = build(&device, &mesh, &BuildOptions::default().with_profile(true)).unwrap();
        assert!(!measured.kernels.is_empty());
        let traced = trace(&measured.scene, Query::Closest, &rays).unwrap();
        assert_eq!(traced.hits, measured.scene.closest(&rays).unwrap());
        assert_eq!(traced.invalid, 1);
        assert!(time(&measured.scene, Query::Any, &rays).unwrap() > Duration::ZERO);
        assert_eq!(time(&measured.scene, Query::Any, &[]).unwrap(), Duration::ZERO);
    }
}
