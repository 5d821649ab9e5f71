//! The commands that there are.

mod bench;
mod build;
mod calibrate;
mod chart;
mod check;
mod devices;
mod inside;
mod rays;
mod render;
mod stress;
mod trace;
mod voxels;

use crate::task::{On, Task};
use clap::{Arg, CommandFactory as _, Parser, Subcommand, error::ErrorKind};
use raykd::internals::mesh_extensions;

const EXAMPLES: &str = "\
Examples:
  raykd bench                            the teapot on CPU and GPU, compared byte by byte
  raykd bench dragon sponza --json       two scenes, for scripts
  raykd build mesh.ply -o mesh.kd        build a tree and save it
  raykd trace mesh.ply --rays r --hits h trace a file of rays
  raykd rays mesh.ply diffuse -o r.npy   write rays to compare ray tracers by
  raykd inside mesh.ply --points p.csv   tell which points are inside
  raykd check mesh.ply                   tell whether a mesh is closed
  raykd voxels mesh.ply --size 99 -o v.npy  fill a mesh with voxels
  raykd render dragon -o dragon.png      make a picture
  raykd stress                           the scenes in which ray tracers fail
  raykd chart --quick                    what raykd knows about itself, drawn
  raykd calibrate                        measure costs, for --quality auto
  raykd devices                          what raykd can run on

A scene is a mesh file (EXTENSIONS, each also .gz) or a name: teapot,
teapot:LEVEL, dragon, dragon_res2, dragon_res3, dragon_res4, sponza (`cargo xtask scenes` gets all
but the teapot).

Exit code: 0 success, 1 an error or a difference between devices, 2 wrong usage.";

/// kd-trees for ray tracing triangle meshes: one kernel source, identical bytes on CPU and GPU.
#[derive(Debug, Parser)]
#[command(name = "raykd", version, arg_required_else_help = true)]
#[command(after_help = EXAMPLES.replace("EXTENSIONS", &mesh_extensions()))]
// So that -1 is a number out of its option's range, not an option that there is none of.
#[command(mut_subcommands(|command| command.mut_args(takes_negative_numbers)))]
pub(super) struct Args {
    #[command(subcommand)]
    pub command: Command,
}

fn takes_negative_numbers(argument: Arg) -> Arg {
    let option = !argument.is_positional() && argument.get_action().takes_values();
    argument.allow_negative_numbers(option)
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    Bench(bench::BenchArgs),
    Build(build::BuildArgs),
    Trace(trace::TraceArgs),
    Rays(rays::RaysArgs),
    Inside(inside::InsideArgs),
    Check(check::CheckArgs),
    Voxels(voxels::VoxelsArgs),
    Render(render::RenderArgs),
    Devices(devices::DevicesArgs),
    Stress(stress::StressArgs),
    Chart(chart::ChartArgs),
    Calibrate(calibrate::CalibrateArgs),
}

impl Command {
    /// Its name, which devices it was told to run on, if it can be told, and what there is to do.
    pub(super) fn task(&self) -> (&'static str, Option<On<'_>>, &dyn Task) {
        match self {
            Self::Bench(args) => ("bench", Some(On::Several(&args.on)), args),
            Self::Build(args) => ("build", Some(On::One(&args.on)), args),
            Self::Trace(args) => ("trace", Some(On::One(&args.on)), args),
            Self::Rays(args) => ("rays", Some(On::One(&args.on)), args),
            Self::Inside(args) => ("inside", Some(On::One(&args.on)), args),
            Self::Check(args) => ("check", None, args),
            Self::Voxels(args) => ("voxels", Some(On::One(&args.on)), args),
            Self::Render(args) => ("render", Some(On::One(&args.on)), args),
            Self::Devices(args) => ("devices", None, args),
            Self::Stress(args) => ("stress", Some(On::Several(&args.on)), args),
            Self::Chart(args) => ("chart", Some(On::Several(&args.on)), args),
            Self::Calibrate(args) => ("calibrate", Some(On::Several(&args.on)), args),
        }
    }
}

impl Args {
    /// Finds contradictions that clap does not see by itself.
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        let (name, on, task) = self.command.task();
        on.map_or(Ok(()), On::check).and_then(|()| task.check()).map_err(|wrong| {
            let mut command = Self::command();
            command.build();
            let command = command.find_subcommand_mut(name).expect("it was parsed");
            command.error(ErrorKind::ArgumentConflict, wrong)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definition_holds_together() {
        Args::command().debug_assert();
    }

    /// clap breaks longer lines, which leaves a word or two on the next.
    #[test]
    fn what_follows_the_help_fits_its_lines() {
        for command in Args::command().get_subcommands() {
            let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let long = text.lines().find(|line| line.chars().count() > 100);
            assert_eq!(long, None, "{}", command.get_name());
        }
    }

    /// Every option of numbers tells its range of one below it.
    #[test]
    fn negative_numbers_are_values() {
        let told = |line: &str| Args::try_parse_from(line.split(' ')).unwrap_err();
        for line in [
            "raykd build m --price -1",
            "raykd build m --cost-step -0.5",
            "raykd build m --cost-test -1e3",
            "raykd build m --budget -2",
            "raykd build m --empty -0.5",
            "raykd build m --rays -1",
            "raykd build m --threads -1",
            "raykd build m --max-bytes -1",
            "raykd trace m --rays r --hits h --limit -1",
            "raykd bench --rays -1",
            "raykd voxels m -o v --size -1",
            "raykd render m -o p --fov -40",
            "raykd render m -o p --samples -1",
            "raykd render m -o p --size -64x64",
            "raykd stress --rays -1",
            "raykd chart --rays -1",
        ] {
            assert_eq!(told(line).kind(), ErrorKind::ValueValidation, "{line}: {}", told(line));
        }
        for line in ["raykd build -1", "raykd build m --clip -1", "raykd build m --price -x"] {
            assert_eq!(told(line).kind(), ErrorKind::UnknownArgument, "{line}");
        }
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
            "raykd trace m --rays r.npy --hits h --f64",
            "raykd trace m --rays r --hits h --query count --limit 4",
            "raykd trace m --rays r --hits h --intersector plane --query all",
            "raykd render m -o p --intersector moeller --shading heat",
            "raykd stress --rays 268435457",
            "raykd stress --scene leaks,m --rays 268435457",
        ] {
            assert_eq!(check(wrong).unwrap_err().kind(), ErrorKind::ArgumentConflict, "{wrong}");
        }
        check("raykd bench --adapter x --threads 2").unwrap();
        check("raykd stress --rays 268435456").unwrap();
        check("raykd stress --scene leaks --rays 1000000000000").unwrap();
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
