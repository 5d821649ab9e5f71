//! `raykd check`: whether a mesh is closed, and what is wrong with it.

use crate::{
    args::ReadArgs,
    files::Files,
    input::{Input, RepairCounts},
    notes::Notes,
    report::{count, write_json},
    task::Task,
};
use clap::Parser;
use raykd::{BuildOptions, ContactCount, Device, Scene, internals::quoted, mesh::EdgeCount};
use std::{
    ffi::OsString,
    io::{StdoutLock, Write as _},
    process::ExitCode,
};

const EXAMPLES: &str = "\
Vertices at one place are one vertex. A mesh is closed if along every edge as many triangles go one
way as the other: then every point is inside or outside, and raykd inside is right everywhere.

  border    edges of a single triangle
  turned    edges of two triangles of which one shows its other side
  crowded   edges of more than two triangles; a closed mesh may have some
  t-joint   vertices on an edge, between its ends: a crack opens there if one of them moves
  through   edges that pass through a triangle of which they have no vertex: the mesh meets itself

All of these are decided exactly. Triangles that overlap in one plane are not told.

Exit code: 0 closed, 1 not closed or an error, 2 wrong usage.

Examples:
  raykd check mesh.ply
  raykd check mesh.ply --json | jq .closed";

/// Tell whether a mesh is closed, and where it is not.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CheckArgs {
    /// Scene name or mesh file
    pub mesh: OsString,
    #[command(flatten)]
    pub read: ReadArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Edges of one kind, or those at which the mesh meets itself.
#[derive(Debug, serde::Serialize)]
struct Kind {
    count: u64,
    /// Ends of the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    first: Option<[[f64; 3]; 2]>,
    /// The vertex or the triangle's corners that it meets.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    meets: Vec<[f64; 3]>,
}

impl Kind {
    fn new(input: &Input, count: u64, first: Option<[u32; 2]>, meets: Vec<u32>) -> Self {
        // In the mesh's own coordinates.
        let place = |vertex: u32| {
            let local = input.mesh.vertex(vertex);
            [0, 1, 2].map(|axis| local[axis] + input.translation[axis])
        };
        let first = first.map(|ends| ends.map(place));
        Self { count, first, meets: meets.into_iter().map(place).collect() }
    }

    fn told(&self, what: &str) -> String {
        let point = |&[x, y, z]: &[f64; 3]| format!("{x},{y},{z}");
        let meets = self.meets.iter().map(point).collect::<Vec<_>>().join(" ");
        let meets = if meets.is_empty() { meets } else { format!(" meets {meets}") };
        let at = self.first.map(|[a, b]| format!(" (first: {} to {}{meets})", point(&a), point(&b)));
        format!("{} {what}{}", count(self.count), at.unwrap_or_default())
    }
}

/// What is told of a mesh.
#[derive(Debug, serde::Serialize)]
struct Told {
    scene: String,
    triangles: usize,
    closed: bool,
    edges: u64,
    border: Kind,
    turned: Kind,
    crowded: Kind,
    t_junctions: Kind,
    intersections: Kind,
    repairs: RepairCounts,
}

impl Task for CheckArgs {
    fn files(&self) -> Files {
        Files::of_scenes(std::slice::from_ref(&self.mesh), self.read)
    }

    fn run(&self, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
        let notes = Notes::new(self.json);
        let input = Input::load(&self.mesh, self.read, &notes)?;
        notes.stage(format_args!("{}: checking", input.name));
        let edges = input.mesh.edges();
        let kind = |edges: EdgeCount| Kind::new(&input, edges.count, edges.first, Vec::new());
        let scene = Scene::build(&Device::cpu(), &input.mesh, &BuildOptions::default())?;
        let contacts = scene.contacts(&input.mesh)?;
        let meeting = |contacts: ContactCount, met: &dyn Fn(u32) -> Vec<u32>| {
            let first = contacts.first;
            let meets = first.map(|first| met(first.other)).unwrap_or_default();
            Kind::new(&input, contacts.count, first.map(|first| first.edge), meets)
        };
        let told = Told {
            scene: input.name.clone(),
            triangles: input.mesh.triangles().len(),
            closed: edges.are_closed(),
            edges: edges.count,
            border: kind(edges.border),
            turned: kind(edges.turned),
            crowded: kind(edges.crowded),
            t_junctions: meeting(contacts.t_junctions, &|vertex| vec![vertex]),
            intersections: meeting(contacts.intersections, &|triangle| {
                input.mesh.triangles()[triangle as usize].to_vec()
            }),
            repairs: RepairCounts::from(&input),
        };
        notes.clear();
        if self.json { write_json(out, &told) } else { print(&told, out) }?;
        Ok(if told.closed { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}

fn print(t: &Told, out: &mut StdoutLock<'_>) -> anyhow::Result<()> {
    let mut line = |name: &str, what: String| writeln!(out, "{name:<7} {what}");
    line(
        "scene",
        format!("{}, {} triangles, {} edges", quoted(&t.scene), count(t.triangles as u64), count(t.edges)),
    )?;
    line("closed", if t.closed { "yes" } else { "no" }.to_owned())?;
    for (name, kind, what) in [
        ("border", &t.border, "edges of a single triangle"),
        ("turned", &t.turned, "edges of two triangles that show different sides"),
        ("crowded", &t.crowded, "edges of more than two triangles"),
        ("t-joint", &t.t_junctions, "vertices on edges, between their ends"),
        ("through", &t.intersections, "edges through triangles"),
    ] {
        if kind.count > 0 {
            line(name, kind.told(what))?;
        }
    }
    if let Some(told) = t.repairs.told() {
        line("repairs", told)?;
    }
    Ok(())
}
