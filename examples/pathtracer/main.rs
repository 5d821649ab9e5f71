//! A progressive path tracer whose rays and hits never leave the GPU.
//!
//! `cargo run --release --example pathtracer -- --headless --spp 64 -o teapot.png`

mod cost;
mod gpu;
mod headless;
#[cfg(test)]
mod tests;
mod tracer;
#[cfg(feature = "window")]
mod window;

use anyhow::{Context as _, Result, bail};
use clap::Parser;
use raykd::{Mesh, rays::Camera};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples, after cargo run --release --example pathtracer:
  -- --headless -o teapot.png
  -- --headless --spp 256 --size 1920x1080 --json -o dragon.png scenes/dragon_res3.ply.gz
  --features window
  --features window -- scenes/dragon.ply.gz

In the window: drag to turn, scroll to come closer, C for costs, R to start over, S to save the picture, Esc to leave.";

/// How much farther away the camera is than it must be.
const ROOM: f64 = 1.12;

/// A picture of a mesh under a sunny sky, by following light backwards.
#[derive(Debug, Parser)]
#[command(name = "pathtracer", after_help = EXAMPLES)]
struct Args {
    /// Mesh file: OBJ, PLY, STL or glTF, also gzipped; y is up. Left out: the Utah teapot
    mesh: Option<PathBuf>,
    /// No window: make one picture
    #[arg(long)]
    headless: bool,
    /// The picture, a PNG file
    #[arg(short, long, value_name = "FILE.png")]
    output: Option<PathBuf>,
    /// Print rays a second as JSON; with --headless
    #[arg(long, requires = "headless")]
    json: bool,
    /// Lay over the picture what camera rays cost: blue is little, red 256 nodes and triangles
    #[arg(long)]
    cost: bool,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = size)]
    size: [u32; 2],
    /// Paths a pixel; left out: 64, in a window as many as there is time for
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: Option<u32>,
    /// Rays of a path, shadow rays not counted
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u32).range(1..=64))]
    bounces: u32,
    /// Where the camera is; left out: where it sees the whole mesh
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    eye: Option<[f64; 3]>,
    /// What it looks at; left out: the middle of the mesh
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    target: Option<[f64; 3]>,
    /// A part of the name of a Vulkan device; left out: the best
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse().ok().filter(|n| (1..=8192).contains(n));
    let sides = text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?]));
    sides.ok_or_else(|| "write it like 1024x768, each from 1 to 8192".to_owned())
}

fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|x| x.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    let point = numbers.and_then(|numbers| numbers.try_into().ok());
    point.ok_or_else(|| "write it like 1,2.5,-3".to_owned())
}

impl Args {
    /// Rays are made on the GPU in `f32`, so that a mesh which was moved to keep its digits stays where it was moved
    /// to.
    fn mesh(&self) -> Result<Mesh> {
        Ok(match &self.mesh {
            None => Mesh::teapot(24),
            Some(path) => Mesh::load(path).with_context(|| path.display().to_string())?.into_local(),
        })
    }

    fn camera(&self, mesh: &Mesh) -> Camera {
        let mut camera = Camera::framing(mesh.bounds());
        let moved = self.target.is_some() || self.eye.is_some();
        camera.target = self.target.unwrap_or(camera.target);
        match self.eye {
            Some(eye) => Camera { eye, ..camera },
            None if moved => camera,
            None => {
                let aspect = f64::from(self.size[0]) / f64::from(self.size[1]);
                let Camera { eye, target, .. } = camera.fitted(mesh.positions().iter().copied(), aspect);
                // Some room for the shadow.
                let eye = [0, 1, 2].map(|a| target[a] + ROOM * (eye[a] - target[a]));
                Camera { eye, target, ..Camera::framing(mesh.bounds()) }
            }
        }
    }
}

/// Writes a picture: red, green, blue and 255, a byte each.
fn write_png(path: &std::path::Path, rgba: &[u8], [width, height]: [u32; 2]) -> Result<()> {
    let write = || -> Result<()> {
        let file = std::io::BufWriter::new(std::fs::File::create(path)?);
        let mut encoder = png::Encoder::new(file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header()?;
        let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
        writer.write_image_data(&rgb)?;
        Ok(writer.finish()?)
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(not(feature = "window"))]
mod window {
    pub(crate) fn run(_: crate::Args) -> anyhow::Result<()> {
        anyhow::bail!(
            "this program was built without its window: run it with\n  \
             cargo run --release --example pathtracer --features window\n\
             or make a picture with --headless -o FILE.png"
        )
    }
}

fn main() -> Result<()> {
    let args = Args::parse();
    if !args.headless {
        return window::run(args);
    }
    if args.output.is_none() && !args.json {
        bail!("--headless makes a picture or figures: name one with -o FILE.png, or add --json");
    }
    headless::run(&args)
}
