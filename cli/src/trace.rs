//! `raykd trace`: a file of rays to a file of hits.

use super::{
    amount,
    args::{Ask, TraceArgs},
    compare,
    input::{Input, RepairCounts},
    measure::{self, mrays, ms},
    notes::Notes,
    write_json,
};
use crate::report::{count, three};
use anyhow::bail;
use raykd::{
    AllHits, BuildOptions, Device, Error, Hit, KdTree, Query, Ray, Ray64, Scene, Traced, Traversal,
    internals::{digest_of, output, quoted},
    rays::AnyRay,
};
use std::{
    borrow::Cow,
    io::{StdoutLock, Write as _},
    path::Path,
    process::ExitCode,
    time::{Duration, Instant},
};

/// Hits a ray that are written if nothing is said.
const USUAL_LIMIT: u32 = 8;

/// What is told about a trace.
#[derive(Debug, serde::Serialize)]
struct Told {
    scene: String,
    triangles: usize,
    repairs: RepairCounts,
    device: &'static str,
    adapter: String,
    query: &'static str,
    traversal: &'static str,
    intersector: &'static str,
    /// Reading the mesh, and the tree if it was saved.
    load_ms: f64,
    /// 0 for a tree that was saved.
    build_ms: f64,
    /// Mesh, rays and a tree that was saved to device.
    upload_ms: f64,
    trace_ms: f64,
    download_ms: f64,
    mrays: f64,
    rays: usize,
    /// Rays that hit something.
    hits: usize,
    /// All hits, if all were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    total_hits: Option<u64>,
    /// Rays that were none.
    invalid: u32,
    /// Of the tree.
    digest: String,
    hits_digest: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    auto: Option<amount::Told>,
    /// Laying out the leaves, after the build.
    #[serde(skip)]
    layout_ms: f64,
    /// Of the upload, the rays.
    #[serde(skip)]
    ray_upload_ms: f64,
}

pub(super) fn run(args: &TraceArgs, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
    let notes = Notes::new(args.json);
    let limit = args.read.limit();
    let rays = args.rays.as_deref().map(|path| Rays::read(path, args.f64, limit)).transpose()?;
    let (Some(rays), Some(hits)) = (&rays, &args.hits) else {
        return compare::run(args, rays.as_ref(), &notes, out);
    };
    let mut input = Input::load(&args.mesh, args.read, &notes)?;
    let rays = &*rays.local(input.translation);
    let start = Instant::now();
    let tree = args.tree.as_deref().map(|path| KdTree::load_up_to(path, limit)).transpose()?;
    input.load += start.elapsed();
    let job = (&input.mesh, rays.len() as u64);
    let device = &args.on;
    let (machine, amount) = amount::decide(&args.how, args.walk.traversal, device, job, &notes)?;
    let how = (&amount.options, amount.traversal);
    let work = |device: &Device| trace(device, &input, tree.as_ref(), args, how, rays, &notes);
    let (mut told, found) = machine.run(&notes, work)?;
    told.auto = amount.plan.map(|plan| {
        let rays = told.ray_upload_ms + told.trace_ms + told.download_ms;
        amount::Told::new(
            &plan,
            told.upload_ms - told.ray_upload_ms + told.build_ms + told.layout_ms,
            Some(rays),
        )
    });
    notes.stage(format_args!("writing {}", hits.display()));
    output::write_whole(hits, |file| file.write_all(found.bytes()))?;
    notes.clear();
    if args.json {
        write_json(out, &told)?
    } else {
        print(&told, hits, out)?
    }
    Ok(ExitCode::SUCCESS)
}

/// The rays of a file, in the mesh's own coordinates.
pub(super) enum Rays {
    Narrow(Vec<Ray>),
    Wide(Vec<Ray64>),
}

impl Rays {
    /// Reads records of 8 little-endian `f32`, or `f64` if they are wide.
    fn read(path: &Path, wide: bool, max_bytes: u64) -> anyhow::Result<Self> {
        const _: () =
            assert!(cfg!(target_endian = "little"), "files are read and written as they lie in memory");
        let bytes = raykd::internals::all_of(path, max_bytes)?;
        let (record, number) = if wide { (size_of::<Ray64>(), "f64") } else { (size_of::<Ray>(), "f32") };
        let extra = bytes.len() % record;
        if extra != 0 {
            bail!(
                "{}: {} bytes are no whole number of rays of {record} bytes ({extra} left over); \
                 a ray is 8 little-endian {number}: origin, direction, t_min, t_max",
                quoted(path.display()),
                bytes.len()
            );
        }
        Ok(if wide {
            Self::Wide(bytemuck::pod_collect_to_vec(&bytes))
        } else {
            Self::Narrow(bytemuck::pod_collect_to_vec(&bytes))
        })
    }

    /// The rays for a mesh that was moved.
    pub(super) fn local(&self, translation: [f64; 3]) -> Cow<'_, [Ray]> {
        match self {
            Self::Narrow(rays) => AnyRay::local(rays, translation),
            Self::Wide(rays) => AnyRay::local(rays, translation),
        }
    }
}

/// Traces, and says what that took and what to write.
fn trace(
    device: &Device,
    input: &Input,
    tree: Option<&KdTree>,
    args: &TraceArgs,
    (options, traversal): (&BuildOptions, Traversal),
    rays: &[Ray],
    notes: &Notes,
) -> Result<(Told, Found), Error> {
    let mesh = &input.mesh;
    let mut scene;
    let (build, upload, digest);
    if let Some(tree) = tree {
        scene = Scene::with_tree(device, mesh, tree).map_err(|error| match (error, &args.tree) {
            (Error::Tree(what), Some(file)) => {
                Error::Tree(format!("{} and {}: {what}", quoted(file.display()), quoted(args.mesh.display())))
            }
            (other, _) => other,
        })?;
        (build, upload, digest) = (Duration::ZERO, scene.times().upload, tree.digest());
    } else {
        notes.stage(format_args!("{}: building", input.name));
        let built = measure::build(device, mesh, options)?;
        (build, upload, digest) = (built.build, built.upload, built.tree.digest());
        scene = built.scene;
    }
    scene.traverse_by(traversal)?;
    scene.intersect_by(args.walk.intersector)?;
    notes.stage(format_args!("{}: tracing {} rays", input.name, count(rays.len() as u64)));
    let ask = if args.any { Ask::Any } else { args.query };
    let answer = answer(&scene, ask, args.limit.unwrap_or(USUAL_LIMIT), rays)?;
    let told = Told {
        scene: input.name.clone(),
        triangles: mesh.triangles().len(),
        repairs: input.into(),
        device: device.kind(),
        adapter: device.name().to_owned(),
        query: match ask {
            Ask::Closest => "closest",
            Ask::Any => "any",
            Ask::Count => "count",
            Ask::All => "all",
        },
        traversal: traversal.name(),
        intersector: args.walk.intersector.name(),
        load_ms: ms(input.load),
        build_ms: ms(build),
        upload_ms: ms(upload + answer.upload),
        trace_ms: ms(answer.trace),
        download_ms: ms(answer.download),
        mrays: mrays(rays.len(), answer.trace),
        rays: rays.len(),
        hits: answer.hits,
        total_hits: answer.total_hits,
        invalid: answer.invalid,
        digest,
        hits_digest: digest_of(answer.found.bytes()),
        auto: None,
        layout_ms: ms(scene.times().layout),
        ray_upload_ms: ms(answer.upload),
    };
    Ok((told, answer.found))
}

/// What was found, and what that took: medians.
struct Answer {
    /// Rays that hit something.
    hits: usize,
    /// All hits, if all were asked for.
    total_hits: Option<u64>,
    invalid: u32,
    upload: Duration,
    trace: Duration,
    download: Duration,
    found: Found,
}

/// What is written.
enum Found {
    Hits(Vec<Hit>),
    Totals(Vec<u32>),
}

impl Found {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Hits(hits) => bytemuck::cast_slice(hits),
            Self::Totals(totals) => bytemuck::cast_slice(totals),
        }
    }
}

/// Asks for the hits of rays, up to a limit a ray if for all of them.
fn answer(scene: &Scene, ask: Ask, limit: u32, rays: &[Ray]) -> Result<Answer, Error> {
    let query = match ask {
        Ask::Closest => Query::Closest,
        Ask::Any => Query::Any,
        Ask::Count | Ask::All => {
            let AllHits { hits, totals, upload, trace, download, invalid } =
                measure::all(scene, rays, if ask == Ask::All { limit } else { 0 })?;
            return Ok(Answer {
                hits: totals.iter().filter(|&&n| n > 0).count(),
                total_hits: Some(totals.iter().map(|&n| u64::from(n)).sum()),
                invalid,
                upload,
                trace,
                download,
                found: if ask == Ask::All { Found::Hits(hits) } else { Found::Totals(totals) },
            });
        }
    };
    let Traced { hits, upload, trace, download, invalid } = measure::trace(scene, query, rays)?;
    Ok(Answer {
        hits: hits.iter().filter(|hit| hit.is_hit()).count(),
        total_hits: None,
        invalid,
        upload,
        trace,
        download,
        found: Found::Hits(hits),
    })
}

fn print(t: &Told, hits: &Path, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let mut line = |name: &str, what: String| writeln!(out, "{name:<7} {what}");
    line("scene", format!("{}, {} triangles", t.scene, count(t.triangles as u64)))?;
    if let Some(told) = t.repairs.told() {
        line("repairs", told)?;
    }
    line("device", format!("{}, {}", t.device.to_uppercase(), t.adapter))?;
    line(
        "times",
        format!(
            "load {} ms, build {} ms, upload {} ms, trace {} ms, download {} ms",
            three(t.load_ms),
            three(t.build_ms),
            three(t.upload_ms),
            three(t.trace_ms),
            three(t.download_ms)
        ),
    )?;
    line(
        "rays",
        format!(
            "{} ({} hit), {} Mray/s, {} query, {}, {} test",
            count(t.rays as u64),
            count(t.hits as u64),
            three(t.mrays),
            t.query,
            t.traversal,
            t.intersector
        ),
    )?;
    if let Some(total) = t.total_hits {
        line("all", format!("{} hits", count(total)))?;
    }
    if t.invalid > 0 {
        let why = "with NaN, infinite or zero directions, or origins out of range";
        line("invalid", format!("{} ({why}): they hit nothing", count(t.invalid.into())))?;
    }
    if let Some(auto) = &t.auto {
        line("auto", auto.words())?;
    }
    line("tree", t.digest.clone())?;
    line("hits", t.hits_digest.clone())?;
    line("written", hits.display().to_string())?;
    Ok(())
}
