//! `raykd rays`: rays by which ray tracers are compared, as a file.

use crate::{
    args::{OneArgs, ReadArgs},
    files::Files,
    input::Input,
    machine::Machine,
    notes::Notes,
    ray_file::Rays,
    report::{count, write_json},
    task::Task,
};
use clap::{Parser, ValueEnum};
use raykd::{
    BuildOptions, Device, Error, Ray, Scene,
    internals::{output, quoted},
    rays::sets::Sets,
};
use std::{
    ffi::OsString,
    io::{StdoutLock, Write as _},
    path::PathBuf,
    process::ExitCode,
};

const EXAMPLES: &str = "\
They are those of raykd bench, the same on every machine. A file named .npy is an array of N x 8
f32: origin x y z, direction x y z, t_min, t_max; any other has these numbers alone, one ray after
the other. raykd trace takes both. Of a mesh that lies far from zero they are f64 (trace --f64).

Examples:
  raykd rays dragon random -o random.npy
  raykd rays mesh.ply diffuse -o diffuse.bin
  raykd trace mesh.ply --rays diffuse.bin --hits hits.bin";

/// Write rays to compare ray tracers by.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct RaysArgs {
    /// Scene name or mesh file
    pub mesh: OsString,
    /// Which rays
    #[arg(value_enum)]
    pub kind: Kind,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub on: OneArgs,
    /// Print JSON about it
    #[arg(long)]
    pub json: bool,
}

/// Rays of which kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// 50,000 from a sphere around the mesh into its box: set a
    Random,
    /// Those of a picture of 1024 x 1024 pixels: set b
    Primary,
    /// From each hit of those in a random direction, by Lambert's law: set c
    Diffuse,
    /// From the same points to points of a light: set d
    Shadow,
}

impl Task for RaysArgs {
    fn files(&self) -> Files {
        Files::of_scenes(std::slice::from_ref(&self.mesh), self.read).write("-o", [self.output.clone()])
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        let input = Input::load(&self.mesh, self.read, &notes)?;
        let machine = Machine::choose(self.on.device, &self.on.more, &notes)?;
        let work = |device: &Device| -> Result<Vec<Ray>, Error> {
            let scene = Scene::build(device, &input.mesh, &BuildOptions::default())?;
            let Sets { a, b, c, d, .. } = Sets::new(&input.name, &input.mesh, |rays| scene.closest(rays))?;
            Ok(match self.kind {
                Kind::Random => a,
                Kind::Primary => b,
                Kind::Diffuse => c,
                Kind::Shadow => d,
            })
        };
        let local = machine.run(&notes, work)?;
        let rays = Rays::of_local(local, input.translation);
        output::write_whole(&self.output, |file| rays.write(&self.output, file))?;
        notes.clear();
        if self.json {
            write_json(out, &serde_json::json!({ "scene": input.name, "rays": rays.len() }))?;
        } else {
            writeln!(out, "{} rays written to {}", count(rays.len() as u64), quoted(self.output.display()))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
