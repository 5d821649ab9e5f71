//! Building: a mesh and options become a tree on a device.
//!
//! [`options`] is what may be asked, [`room`] how long lists are, [`retry`] what happens if one is too short.
//! The trees of [`Builder::Exact`] are built by [`sweep`], all others by [`levels`].

mod built;
mod levels;
mod options;
mod radix;
mod retry;
mod room;
mod survey;
mod sweep;
mod times;
mod wide;
mod with;

pub(crate) use built::{Built, Given, Kept, Laid, MeshBuffers, upload};
pub use options::{BuildOptions, Builder};
pub(crate) use survey::{Copies, Survey, Surveyed};
pub use sweep::LISTED;
pub use times::{BuildTimes, KernelTimes};
pub(crate) use wide::Wide;

use crate::{Error, clock::Instant, exec::Device};
use built::{Facts, Grown, KeptIn};
use raykd_kernels::build::survey::Found;
use raykd_shared::{BuildParams, Node, TreeHeader};
use retry::{Setting, Stop, Way};
use room::Arena;
use std::time::Duration;

/// Who builds a tree first; the host alone can build by the host.
fn way(options: &BuildOptions, by_host: bool) -> Way {
    match options.builder {
        _ if options.max_depth == 0 => Way::Leaf,
        Builder::Exact if by_host => Way::SweepByHost,
        Builder::Exact => Way::SweepByKernels { small: LISTED },
        _ => Way::Levels,
    }
}

/// Builds the tree of a mesh on a device, which has it.
pub(crate) fn build(device: &Device, from: &Given<'_>, options: &BuildOptions) -> Result<Built, Error> {
    let by_host = device.is_cpu() && matches!(from.kept, KeptIn::Host(_));
    until_built(device, from, options, way(options, by_host))
}

/// Builds the tree of a mesh that is surveyed, without waiting for that where the mesh is expected to be like the one
/// before.
pub(crate) fn survey_and_build(
    device: &Device,
    survey: Survey,
    options: &BuildOptions,
) -> Result<(Surveyed, Built), Error> {
    let begin = Instant::now();
    let at_once = way(options, false) == Way::Levels && options.budget.is_none() && !options.profile;
    if at_once && let Some(kept) = levels::expected(device, survey.triangles()) {
        let given = survey.expected(device, kept)?;
        let setting = Setting::first(&given, options, Way::Levels).after(levels::room_before(device, kept));
        let params = BuildParams { price: options.price_of_area(), ..setting.params() };
        let (mut arena, mut found) = (Arena { device, bytes: given.bytes() }, Found::NOTHING);
        match levels::build(&mut arena, &given, &params, options, Some((&survey, &mut found))) {
            Ok(grown) => {
                let surveyed = survey.done(&found)?;
                let built = grown.of(&surveyed.given().facts, options, arena.bytes);
                return Ok((surveyed, built));
            }
            Err(Stop::Failed(error)) => return Err(error),
            // As for any mesh, then.
            Err(_) => {}
        }
    }
    let surveyed = survey.finish(device)?;
    let ready = begin.elapsed();
    let built = build(device, &surveyed.given(), options)?.after(ready);
    Ok((surveyed, built))
}

/// The same by the kernels of the sweep on any device, with lists of faces in nodes of more than `small` references.
pub(crate) fn sweep_by_kernels(
    device: &Device,
    from: &Given<'_>,
    options: &BuildOptions,
    small: u32,
) -> Result<Built, Error> {
    until_built(device, from, options, Way::SweepByKernels { small })
}

/// Tries until there is a tree.
fn until_built(device: &Device, from: &Given<'_>, options: &BuildOptions, way: Way) -> Result<Built, Error> {
    let before = levels::room_before(device, from.facts.kept).filter(|_| way == Way::Levels);
    let mut setting = Setting::first(from, options, way).after(before);
    let (mut retries, mut failed) = (0, Duration::ZERO);
    loop {
        let begin = Instant::now();
        let mut arena = Arena { device, bytes: from.bytes() };
        match attempt(&mut arena, from, &setting, options) {
            Ok(grown) => {
                if setting.is_lowered() {
                    // The same would happen again.
                    device.note(None);
                }
                let built = grown.of(&from.facts, options, arena.bytes);
                let by_host = setting.way == Way::SweepByHost && !device.is_cpu();
                return Ok(Built { times: BuildTimes { retries, failed, by_host, ..built.times }, ..built });
            }
            Err(stop) => setting.change(stop)?,
        }
        retries += 1;
        failed += begin.elapsed();
    }
}

/// One try.
fn attempt(
    arena: &mut Arena<'_>,
    from: &Given<'_>,
    setting: &Setting,
    options: &BuildOptions,
) -> Result<Grown, Stop> {
    let params = setting.params();
    let grown = match setting.way {
        Way::Leaf => leaf(arena, from)?,
        Way::Levels => levels::build(arena, from, &params, options, None)?,
        #[cfg(not(target_arch = "wasm32"))]
        Way::SweepByKernels { .. } => sweep::kernels::build(arena, from, &params, options.profile)?,
        // A browser's host has every mesh: no page loads kernels that it never runs.
        #[cfg(target_arch = "wasm32")]
        Way::SweepByKernels { .. } => sweep_by_host(arena, from, &params)?,
        Way::SweepByHost => sweep_by_host(arena, from, &params)?,
    };
    setting.check_budget(grown.counts[1])?;
    Ok(grown)
}

fn sweep_by_host(arena: &mut Arena<'_>, from: &Given<'_>, params: &BuildParams) -> Result<Grown, Stop> {
    match from.kept {
        KeptIn::Host(mesh) => sweep::host::build(arena, mesh, params),
        KeptIn::Device(_) => unreachable!("chosen only where the host has the mesh"),
    }
}

impl Grown {
    /// As a tree over a mesh.
    fn of(self, facts: &Facts, options: &BuildOptions, peak_bytes: u64) -> Built {
        let Self { nodes, refs, counts, depth, times, laid } = self;
        let header = header(facts, options, counts, depth);
        Built { header, nodes, refs, times: BuildTimes { peak_bytes, ..times }, laid }
    }
}

/// No tree: one leaf that lists every triangle.
fn leaf(arena: &mut Arena<'_>, from: &Given<'_>) -> Result<Grown, Error> {
    let nodes = [Node::leaf(0, from.facts.kept), Node::PADDING];
    match from.kept {
        KeptIn::Host(mesh) => Grown::put(arena, &nodes, mesh.kept(), 0, BuildTimes::default()),
        KeptIn::Device(kept) => {
            let grown = Grown::put(arena, &nodes, &[], 0, BuildTimes::default())?;
            Ok(Grown { refs: kept.clone(), counts: [2, from.facts.kept], ..grown })
        }
    }
}

/// The header of a tree, without the mesh's digest and the checksum.
fn header(facts: &Facts, options: &BuildOptions, [nodes, refs]: [u32; 2], depth: u32) -> TreeHeader {
    let (lo, hi) = facts.bounds;
    TreeHeader {
        lo,
        nodes,
        hi,
        refs,
        triangles: facts.triangles,
        depth,
        scale: facts.scale,
        cost_step: options.cost_step,
        cost_test: options.cost_test,
        mesh: [0; 2],
        checksum: 0,
    }
}
