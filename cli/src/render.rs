//! `raykd render`: a picture.

use super::{
    amount,
    args::{RenderArgs, Shading as Wish},
    input::Input,
    measure::ms,
    notes::Notes,
};
use crate::{
    picture::{Picture, Shading, corners, rays_of, render},
    report::count,
};
use anyhow::{Context as _, bail};
use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};
use raykd::{
    Device, Error, Scene,
    internals::{output, quoted},
    rays::Camera,
};
use std::{
    io::{self, StdoutLock, Write as _},
    time::Instant,
};

pub(super) fn run(args: &RenderArgs, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let notes = Notes::new(false);
    let extension = args.output.extension().map(std::ffi::OsStr::to_ascii_lowercase);
    if extension.is_none_or(|e| e != "png") {
        bail!("{}: pictures are PNG files; name it like {0}.png", quoted(args.output.display()));
    }
    let input = Input::load(&args.mesh, args.read, &notes)?;
    let camera = camera(args, &input)?;
    let shading = match args.shading {
        Wish::Normal => Shading::Normal,
        Wish::Depth => Shading::Depth,
        Wish::Heat => Shading::Heat,
        Wish::Id => Shading::Id,
        Wish::Ao => Shading::Ao,
    };
    let samples = args.samples.unwrap_or(if shading == Shading::Normal { 2 } else { 1 });
    let rays = u64::from(args.size[0]) * u64::from(args.size[1]) * u64::from(samples * samples);
    let rays = rays_of(shading, rays);
    let device = &args.on;
    let (machine, amount) =
        amount::decide(&args.how, args.walk.traversal, device, (&input.mesh, rays), &notes)?;
    let draw = |device: &Device| -> Result<(Picture, String, [f64; 2]), Error> {
        notes.stage(format_args!("{}: building", input.name));
        let mut scene = Scene::build(device, &input.mesh, &amount.options)?;
        scene.traverse_by(amount.traversal)?;
        scene.intersect_by(args.walk.intersector)?;
        notes.stage(format_args!("{}: tracing", input.name));
        let start = Instant::now();
        let picture = render(&scene, &input.mesh, &camera, args.size, samples, shading)?;
        let times = scene.times();
        let spent = [times.upload + times.build + times.layout, start.elapsed()].map(ms);
        Ok((picture, format!("{}, {}", device.kind().to_uppercase(), device.name()), spent))
    };
    let (picture, device, [before, shown]) = machine.run(&notes, draw)?;
    notes.stage("writing the picture");
    let [width, height] = args.size;
    output::write_whole(&args.output, |file| {
        let encoder = PngEncoder::new(file);
        let written = encoder.write_image(&picture.rgb, width, height, ExtendedColorType::Rgb8);
        written.map_err(|error| match error {
            image::ImageError::IoError(error) => error,
            other => io::Error::other(other),
        })
    })?;
    notes.clear();
    let seen = format!("{} of {} rays hit", count(picture.hits), count(picture.rays));
    writeln!(out, "{}: {width}x{height}, {seen}, {device}", args.output.display())?;
    if let Some(plan) = &amount.plan {
        writeln!(out, "auto: {}", amount::Told::new(plan, before, Some(shown)).words())?;
    }
    Ok(())
}

/// The camera given, or one that sees the whole mesh.
fn camera(args: &RenderArgs, input: &Input) -> anyhow::Result<Camera> {
    let mesh = &input.mesh;
    let local = |point: [f64; 3]| [0, 1, 2].map(|a| point[a] - input.translation[a]);
    let [width, height] = args.size;
    let framing = Camera::framing(mesh.bounds());
    let camera = match args.eye {
        None => {
            let camera = Camera { up: args.up, fov: args.fov, ..framing };
            camera.fitted(corners(mesh), f64::from(width) / f64::from(height))
        }
        Some(eye) => {
            let (lo, hi) = mesh.bounds();
            let middle = [0, 1, 2].map(|a| f64::midpoint(f64::from(lo[a]), f64::from(hi[a])));
            Camera { eye: local(eye), target: args.target.map_or(middle, local), up: args.up, fov: args.fov }
        }
    };
    (camera.eye != camera.target)
        .then_some(camera)
        .context("--eye and --target are the same point; move one of them")
}
