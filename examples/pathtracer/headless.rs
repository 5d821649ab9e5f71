//! One picture, or how fast it is made, without a window.

use crate::{Args, cost::Cost, gpu, gpu::Gpu, tracer::Tracer, write_png};
use anyhow::Result;
use raykd::{BuildOptions, Scene};
use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

/// Waves that the device is given ahead of the one it works on.
const AHEAD: usize = 2;
/// How long a GPU is kept busy before times are taken: an idle one has low clocks.
const WARM: Duration = Duration::from_millis(500);

pub(crate) fn run(args: &Args) -> Result<()> {
    let mesh = args.mesh()?;
    let gpu = Gpu::open(&gpu::adapter(&gpu::instance(None), args.device.as_deref(), None)?)?;
    let scene = Scene::build(&gpu.raykd, &mesh, &BuildOptions::default())?;
    let spp = args.spp.unwrap_or(64);
    let mut tracer = Tracer::new(&gpu, &scene, mesh.bounds(), args.size, spp, args.bounces)?;
    let camera = args.camera(&mesh);
    let wait = |submission| {
        gpu.device.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None })
    };

    // The first wave compiles kernels, and tells whether rays can be traced here at all.
    let start = Instant::now();
    tracer.look(&gpu, &camera);
    for encoded in tracer.wave(&gpu, spp)?.encoded {
        encoded.invalid()?;
    }
    while args.json && gpu.raykd.is_card() && start.elapsed() < WARM {
        wait(tracer.wave(&gpu, spp)?.submission)?;
    }

    tracer.look(&gpu, &camera);
    let start = Instant::now();
    let (mut ahead, mut waves) = (VecDeque::new(), Vec::new());
    while tracer.done() < spp {
        let left = spp - tracer.done();
        let mut wave = tracer.wave(&gpu, left)?;
        wave.encoded.clear();
        ahead.push_back(wave.submission.clone());
        if ahead.len() > AHEAD {
            ahead.pop_front().map(wait).transpose()?;
        }
        waves.push(wave);
    }
    ahead.pop_back().map(wait).transpose()?;
    let seconds = start.elapsed().as_secs_f64();

    if let Some(path) = &args.output {
        let cost = args.cost.then(|| Cost::new(&gpu, &scene, &tracer, args.size)).transpose()?;
        cost.iter().for_each(|cost| cost.draw(&gpu));
        let pixels = cost.as_ref().map_or(&tracer.pixels, |cost| &cost.pixels);
        write_png(path, &gpu.read(pixels)?, args.size)?;
    }
    if args.json {
        let rays = tracer.traced(&gpu)?;
        let spans: Option<Vec<f64>> =
            waves.iter().map(|wave| tracer.seconds(&gpu, wave)).collect::<Result<_>>()?;
        let tracing = spans.map(|spans| spans.iter().sum::<f64>());
        let figures = serde_json::json!({
            "device": gpu.raykd.name(),
            "triangles": mesh.triangles().len(),
            "size": args.size,
            "spp": spp,
            "bounces": args.bounces,
            "rays": rays,
            "seconds": seconds,
            "rays_per_second": rays as f64 / seconds,
            // By the device's timestamps; null if it has none.
            "tracing_seconds": tracing,
            "tracing_rays_per_second": tracing.map(|tracing| rays as f64 / tracing),
            "tracing_share": tracing.map(|tracing| tracing / seconds),
        });
        println!("{figures:#}");
    }
    Ok(())
}
