//! `raykd trace`: a file of rays to a file of hits.

use super::{
    args::TraceArgs,
    input::Input,
    machine::Machine,
    measure::{self, mrays, ms},
    notes::Notes,
    write_json,
};
use crate::{
    BuildOptions, Device, Error, Hit, KdTree, Query, Ray, Scene, hits_digest, output,
    report::{count, three},
};
use anyhow::bail;
use std::{
    io::{StdoutLock, Write as _},
    path::Path,
    time::{Duration, Instant},
};

/// What is told about a trace.
#[derive(Debug, serde::Serialize)]
struct Told {
    scene: String,
    triangles: usize,
    device: &'static str,
    adapter: String,
    query: &'static str,
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
    hits: usize,
    /// Rays that were none.
    invalid: u32,
    /// Of the tree.
    digest: String,
    hits_digest: String,
}

pub(super) fn run(args: &TraceArgs, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let notes = Notes::new(args.json);
    output::check(&args.hits)?;
    let rays = read_rays(&args.rays)?;
    let mut input = Input::load(&args.mesh, &notes)?;
    let start = Instant::now();
    let tree = args.tree.as_deref().map(KdTree::load).transpose()?;
    input.load += start.elapsed();
    let machine = Machine::choose(args.device, &args.machine, &notes)?;
    let query = if args.any { Query::Any } else { Query::Closest };
    let (told, hits) =
        machine.run(&notes, |device| trace(device, &input, tree.as_ref(), query, &rays, &notes))?;
    notes.stage(format_args!("writing {}", args.hits.display()));
    output::write_whole(&args.hits, |file| file.write_all(bytemuck::cast_slice(&hits)))?;
    notes.clear();
    if args.json { write_json(out, &told) } else { print(&told, &args.hits, out) }
}

/// Reads records of 8 little-endian `f32`.
fn read_rays(path: &Path) -> anyhow::Result<Vec<Ray>> {
    const _: () = assert!(cfg!(target_endian = "little"), "files are read and written as they lie in memory");
    let bytes = std::fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    let (record, extra) = (size_of::<Ray>(), bytes.len() % size_of::<Ray>());
    if extra != 0 {
        bail!(
            "{}: {} bytes are no whole number of rays of {record} bytes ({extra} left over); \
             a ray is 8 little-endian f32: origin, direction, t_min, t_max",
            path.display(),
            bytes.len()
        );
    }
    Ok(bytemuck::pod_collect_to_vec(&bytes))
}

fn trace(
    device: &Device,
    input: &Input,
    tree: Option<&KdTree>,
    query: Query,
    rays: &[Ray],
    notes: &Notes,
) -> Result<(Told, Vec<Hit>), Error> {
    let mesh = &input.mesh;
    let scene;
    let (build, upload, digest);
    if let Some(tree) = tree {
        scene = Scene::with_tree(device, mesh, tree)?;
        (build, upload, digest) = (Duration::ZERO, scene.times().upload, tree.digest());
    } else {
        notes.stage(format_args!("{}: building", input.name));
        let built = measure::build(device, mesh, &BuildOptions::default())?;
        (build, upload, digest) = (built.build, built.upload, built.tree.digest());
        scene = built.scene;
    }
    notes.stage(format_args!("{}: tracing {} rays", input.name, count(rays.len() as u64)));
    let traced = measure::trace(&scene, query, rays)?;
    let told = Told {
        scene: input.name.clone(),
        triangles: mesh.triangles().len(),
        device: device.kind(),
        adapter: device.name().to_owned(),
        query: match query {
            Query::Closest => "closest",
            Query::Any => "any",
        },
        load_ms: ms(input.load),
        build_ms: ms(build),
        upload_ms: ms(upload + traced.upload),
        trace_ms: ms(traced.trace),
        download_ms: ms(traced.download),
        mrays: mrays(rays.len(), traced.trace),
        rays: rays.len(),
        hits: traced.hits.iter().filter(|hit| hit.is_hit()).count(),
        invalid: traced.invalid,
        digest,
        hits_digest: hits_digest(&traced.hits),
    };
    Ok((told, traced.hits))
}

fn print(t: &Told, hits: &Path, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let mut line = |name: &str, what: String| writeln!(out, "{name:<7} {what}");
    line("scene", format!("{}, {} triangles", t.scene, count(t.triangles as u64)))?;
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
            "{} ({} hit), {} Mray/s, {} query",
            count(t.rays as u64),
            count(t.hits as u64),
            three(t.mrays),
            t.query
        ),
    )?;
    if t.invalid > 0 {
        let why = "with NaN, infinite or zero directions, or origins out of range";
        line("invalid", format!("{} ({why}): they hit nothing", count(t.invalid.into())))?;
    }
    line("tree", t.digest.clone())?;
    line("hits", t.hits_digest.clone())?;
    line("written", hits.display().to_string())?;
    Ok(())
}
