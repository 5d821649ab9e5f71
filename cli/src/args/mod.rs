//! What the program can be told.

mod bench;
mod build;
mod calibrate;
mod chart;
mod devices;
mod machine;
mod read;
mod render;
mod stress;
mod trace;
mod tree;
mod values;

pub(super) use bench::BenchArgs;
pub(super) use build::BuildArgs;
pub(super) use calibrate::CalibrateArgs;
pub(super) use chart::ChartArgs;
pub(super) use devices::DevicesArgs;
pub(super) use machine::{MachineArgs, One, OneArgs, Which, WhichArgs};
pub(super) use read::ReadArgs;
pub(super) use render::{RenderArgs, Shading};
pub(super) use stress::StressArgs;
pub(super) use trace::{Ask, TraceArgs};
pub(super) use tree::{HowArgs, Quality, WalkArgs};

use clap::{CommandFactory as _, Parser, Subcommand, error::ErrorKind};
use raykd::{Error, Intersector};

const EXAMPLES: &str = "\
Examples:
  raykd bench                            the teapot on CPU and GPU, compared byte by byte
  raykd bench dragon sponza --json       two scenes, for scripts
  raykd build mesh.ply -o mesh.kd        build a tree and save it
  raykd trace mesh.ply --rays r --hits h trace a file of rays
  raykd render dragon -o dragon.png      make a picture
  raykd stress                           the scenes in which ray tracers fail
  raykd chart --quick                    what raykd knows about itself, drawn
  raykd calibrate                        measure costs, for --quality auto
  raykd devices                          what raykd can run on

A scene is a mesh file (.obj, .ply, .stl, .gltf, .glb, each also .gz) or a name: teapot,
teapot:LEVEL, dragon, dragon_res2, dragon_res3, dragon_res4, sponza (`cargo xtask scenes` gets all
but the teapot).

Exit code: 0 success, 1 an error or a difference between devices, 2 wrong usage.";

/// kd-trees for ray tracing triangle meshes: one kernel source, identical bytes on CPU and GPU.
#[derive(Debug, Parser)]
#[command(name = "raykd", version, after_help = EXAMPLES, arg_required_else_help = true)]
pub(super) struct Args {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    Bench(BenchArgs),
    Build(BuildArgs),
    Trace(TraceArgs),
    Render(RenderArgs),
    Devices(DevicesArgs),
    Stress(StressArgs),
    Chart(ChartArgs),
    Calibrate(CalibrateArgs),
}

impl Args {
    /// Finds contradictions that clap does not see by itself.
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        let (name, device, machine) = match &self.command {
            Command::Bench(a) => ("bench", a.on.device, &a.on.more),
            Command::Build(a) => ("build", a.on.device.map(Which::from), &a.on.more),
            Command::Trace(a) => ("trace", a.on.device.map(Which::from), &a.on.more),
            Command::Render(a) => ("render", a.on.device.map(Which::from), &a.on.more),
            Command::Stress(a) => ("stress", a.on.device, &a.on.more),
            Command::Chart(a) => ("chart", a.on.device, &a.on.more),
            Command::Calibrate(a) => ("calibrate", a.on.device, &a.on.more),
            Command::Devices(_) => return Ok(()),
        };
        let conflict = |what: &str| {
            let mut command = Self::command();
            command.build();
            let command = command.find_subcommand_mut(name).expect("it was parsed");
            Err(command.error(ErrorKind::ArgumentConflict, what))
        };
        match (&machine.adapter, machine.threads) {
            (Some(_), _) if device == Some(Which::Cpu) => {
                conflict("--adapter names a GPU, --device cpu uses none")
            }
            (_, Some(_)) if device == Some(Which::Gpu) => {
                conflict("--threads is for the CPU, --device gpu does not use it")
            }
            (Some(_), Some(_)) if matches!(name, "build" | "trace" | "render") => {
                conflict("--adapter is for the GPU, --threads for the CPU: use one of them")
            }
            _ => self
                .check_idle()
                .or_else(conflict)
                .and_then(|()| self.check_test().or_else(|error| conflict(&error.to_string()))),
        }
    }

    /// Finds options that would do nothing.
    fn check_idle(&self) -> Result<(), &'static str> {
        let (amount, rays) = match &self.command {
            Command::Bench(a) => (&a.how.amount, None),
            Command::Build(a) => (&a.how.amount, a.rays),
            Command::Trace(a) if a.limit.is_some() && a.query != Ask::All => {
                return Err("--limit is for --query all");
            }
            Command::Trace(a) if a.brute && !a.compare => return Err("--brute is for --compare"),
            Command::Trace(a) => (&a.how.amount, None),
            Command::Render(a) => (&a.how.amount, None),
            _ => return Ok(()),
        };
        match amount.quality {
            Quality::Auto => Ok(()),
            Quality::Usual if amount.costs.is_some() => Err("--costs is for --quality auto"),
            Quality::Usual if rays.is_some() => Err("--rays is for --quality auto"),
            Quality::Usual => Ok(()),
        }
    }

    /// Whether the triangle test does what is asked for.
    fn check_test(&self) -> Result<(), Error> {
        let (test, traversal, more) = match &self.command {
            Command::Bench(a) => (a.walk.intersector, a.walk.traversal, None),
            Command::Trace(a) => {
                let all = matches!(a.query, Ask::Count | Ask::All);
                (a.walk.intersector, a.walk.traversal, all.then_some("a query for all hits"))
            }
            Command::Render(a) => (
                a.walk.intersector,
                a.walk.traversal,
                (a.shading == Shading::Heat).then_some("counting steps"),
            ),
            _ => return Ok(()),
        };
        match more.filter(|_| test != Intersector::Strict) {
            Some(asked) => Err(Error::Intersector { name: test.name(), asked: asked.to_owned() }),
            None => test.check(traversal),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definition_holds_together() {
        Args::command().debug_assert();
    }

    #[test]
    fn contradictions() {
        let check = |line: &str| Args::try_parse_from(line.split(' ')).unwrap().check();
        for wrong in [
            "raykd bench --device cpu --adapter x",
            "raykd bench --device gpu --threads 2",
            "raykd build m --adapter x --threads 2",
            "raykd trace m --rays r --hits h --device cpu --adapter x",
            "raykd render m -o p --device gpu --threads 1",
            "raykd bench --intersector woop --traversal ropes",
            "raykd bench --costs c.json",
            "raykd build m --rays 10",
            "raykd render m -o p --quality usual --costs c.json",
            "raykd trace m --rays r --hits h --brute",
            "raykd trace m --rays r --hits h --limit 4",
            "raykd trace m --rays r --hits h --query count --limit 4",
            "raykd trace m --rays r --hits h --intersector plane --query all",
            "raykd render m -o p --intersector moeller --shading heat",
        ] {
            assert_eq!(check(wrong).unwrap_err().kind(), ErrorKind::ArgumentConflict, "{wrong}");
        }
        check("raykd bench --adapter x --threads 2").unwrap();
        check("raykd bench --intersector woop --traversal brute").unwrap();
        check("raykd build m --device cpu --threads 2").unwrap();
        check("raykd build m --quality auto --rays 10 --costs c.json").unwrap();
        check("raykd trace m --rays r --hits h --query all --limit 4").unwrap();
        for wrong in [
            "raykd build m --compare --quality auto",
            "raykd build --scaling --quality auto",
            "raykd trace m --compare --quality auto",
            "raykd bench --quality auto --traversal ropes",
            "raykd stress --list --json",
        ] {
            let error = Args::try_parse_from(wrong.split(' ')).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::ArgumentConflict, "{wrong}");
        }
    }
}
