//! `raykd render`: a picture.

use crate::{
    amount::{self, Job},
    args::{HowArgs, OneArgs, ReadArgs, WalkArgs, direction, one_of, point, size, whole, within},
    files::{Files, renamed},
    input::Input,
    measure::ms,
    notes::Notes,
    png_file,
    report::{INVALID, capitals, count},
    task::Task,
};
use anyhow::Context as _;
use clap::Parser;
use raykd::{
    Device, Error, Scene,
    internals::{
        output,
        picture::{self, Picture, Shading, rays_of, render, samples_of},
        quoted,
    },
    rays::Camera,
};
use std::{
    ffi::OsString,
    io::{StdoutLock, Write as _},
    path::PathBuf,
    process::ExitCode,
};

const EXAMPLES: &str = "\
Examples:
  raykd render teapot:20 -o teapot.png
  raykd render dragon -o heat.png --shading heat --size 1920x1080
  raykd render sponza -o hall.png --eye=-10,4,0 --target 10,5,0 --fov 70";

/// Make a picture of a mesh.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct RenderArgs {
    /// Scene name or mesh file
    pub mesh: OsString,
    /// The picture, a PNG file
    #[arg(short, long, value_name = "FILE.png")]
    pub output: PathBuf,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size, allow_hyphen_values = true)]
    pub size: [u32; 2],
    /// What colours show
    #[arg(long, default_value_t)]
    #[arg(value_parser = one_of(Shading::ALL, Shading::name, Shading::about))]
    pub shading: Shading,
    #[command(flatten)]
    pub walk: WalkArgs,
    /// Rays per pixel are the square of this; left out: 2 for normal, else 1
    #[arg(long, value_name = "N", value_parser = whole(1_u32, 8))]
    pub samples: Option<u32>,
    /// Where the camera is; left out: far enough to see the whole mesh
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub eye: Option<[f64; 3]>,
    /// What it looks at; left out: the middle of the mesh
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "eye")]
    pub target: Option<[f64; 3]>,
    /// Which way is up
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true, default_value = "0,1,0")]
    pub up: [f64; 3],
    /// Angle of view from bottom to top, in degrees
    #[arg(long, value_name = "DEGREES", default_value = "40", value_parser = within(0.1_f64, 170.0))]
    pub fov: f64,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: OneArgs,
    #[command(flatten)]
    pub how: HowArgs,
}

const SAME: &str = "--eye and --target are the same point; move one of them";

impl Task for RenderArgs {
    fn files(&self) -> Files {
        Files::of_scenes(std::slice::from_ref(&self.mesh), self.read)
            .read("--costs", &self.how.amount.costs)
            .write("-o", [self.output.clone()])
    }

    fn check(&self) -> Result<(), String> {
        if self.output.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png")) {
            let [name, better] = [quoted(self.output.display()), renamed(&self.output, "png")];
            return Err(format!("{name}: pictures are PNG files; name it like {better}"));
        }
        if self.eye.is_some() && self.eye == self.target {
            return Err(SAME.to_owned());
        }
        self.how.check(false)?;
        self.walk.check((self.shading == Shading::Heat).then_some("counting steps"))
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(false);
        let input = Input::load(&self.mesh, self.read, &notes)?;
        let camera = camera(self, &input)?;
        let shading = self.shading;
        let samples = self.samples.unwrap_or_else(|| samples_of(shading));
        let rays = u64::from(self.size[0]) * u64::from(self.size[1]) * u64::from(samples * samples);
        let rays = rays_of(shading, rays);
        let device = &self.on;
        let job = Job { mesh: &input.mesh, rays, needs_tree: self.walk.needs_tree() };
        let (machine, amount) = amount::decide(&self.how, self.walk.traversal, device, job, &notes)?;
        let draw = |device: &Device| -> Result<(Picture, String, [f64; 2]), Error> {
            notes.stage(format_args!("{}: building", input.name));
            let mut scene = Scene::build(device, &input.mesh, &amount.options)?;
            scene.traverse_by(amount.traversal)?;
            scene.intersect_by(self.walk.intersector)?;
            notes.stage(format_args!("{}: tracing", input.name));
            let picture = render(&scene, &input.mesh, &camera, self.size, samples, shading)?;
            let (before, rays) = (scene.times(), picture.times);
            let spent = [
                before.upload + before.build + before.layout + before.prepare,
                rays.upload + rays.trace + rays.download,
            ];
            let spent = spent.map(ms);
            Ok((picture, format!("{}, {}", capitals(device), device.name()), spent))
        };
        let (picture, device, [before, shown]) = machine.run(&notes, draw)?;
        notes.stage("writing the picture");
        let [width, height] = self.size;
        output::write_whole(&self.output, |file| png_file::write(file, &picture.rgb, self.size))?;
        notes.clear();
        if picture.invalid > 0 {
            notes.note(format_args!("invalid rays: {} {INVALID}", count(picture.invalid)));
        }
        let seen = format!("{} of {} rays hit", count(picture.hits), count(picture.rays));
        writeln!(out, "{}: {width}x{height}, {seen}, {device}", quoted(self.output.display()))?;
        if let Some(plan) = &amount.plan {
            writeln!(out, "auto: {}", amount::Told::new(plan, before, Some(shown)).words())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// The camera given, or one that sees the whole mesh.
fn camera(args: &RenderArgs, input: &Input) -> anyhow::Result<Camera> {
    let local = |point: [f64; 3]| [0, 1, 2].map(|a| point[a] - input.translation[a]);
    let [width, height] = args.size.map(f64::from);
    let ends = [args.eye, args.target].map(|end| end.map(local));
    let camera = picture::camera(&input.mesh, width / height, ends, args.up, args.fov);
    // The middle of the mesh, or the same after rounding.
    (camera.eye != camera.target).then_some(camera).context(SAME)
}
