//! Figure 7: other crates in the same run, as `peers/` measured them.

use super::figure::{Axis, Figure, Grid, Look, Mark, Scale, Series, front, slug};
use crate::report::three;
use anyhow::Context as _;
use raykd::{Error, internals::quoted};
use std::path::Path;

/// A crate on a scene, as the program of `peers/` writes it with --json.
#[derive(Clone, Debug, serde::Deserialize)]
pub(super) struct Peer {
    scene: String,
    peer: String,
    build_ms: f64,
    mrays_a: f64,
    mrays_b: f64,
    mrays_c: f64,
    mrays_d: f64,
    wrong: u64,
    unclear: u64,
}

impl Peer {
    /// Of all four sets, each given the same number of rays.
    fn mrays(&self) -> f64 {
        4.0 / [self.mrays_a, self.mrays_b, self.mrays_c, self.mrays_d].iter().map(|m| 1.0 / m).sum::<f64>()
    }
}

pub(super) fn read(path: &Path) -> anyhow::Result<Vec<Peer>> {
    let bytes = std::fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    serde_json::from_slice(&bytes).with_context(|| {
        format!(
            "{}: not what the program of peers/ writes with --json (peers/README.md)",
            quoted(path.display())
        )
    })
}

/// A figure for each scene.
pub(super) fn figures(peers: &[Peer]) -> Vec<Figure> {
    let mut scenes: Vec<&str> = peers.iter().map(|peer| peer.scene.as_str()).collect();
    scenes.dedup();
    scenes.into_iter().map(|scene| figure(scene, peers)).collect()
}

fn figure(scene: &str, peers: &[Peer]) -> Figure {
    let of = || peers.iter().filter(|peer| peer.scene == scene);
    let titles = ["crate", "build ms", "a", "b", "c", "d", "mean Mray/s", "wrong", "unclear"];
    let mut grid = Grid::new(&titles);
    let mut series = Vec::new();
    for (kind, p) in of().enumerate() {
        let wrong = if p.wrong == 0 { "no wrong hit".to_owned() } else { format!("{} wrong", p.wrong) };
        let mut marks = Series::new(format!("{}: {wrong}", p.peer), Look::Marks, kind, p.wrong > 0);
        marks.mark(p.build_ms, p.mrays(), &p.peer);
        series.push(marks);
        let rates = [p.build_ms, p.mrays_a, p.mrays_b, p.mrays_c, p.mrays_d, p.mrays()].map(three);
        let counts = [p.wrong.to_string(), p.unclear.to_string()];
        grid.rows.push(std::iter::once(p.peer.clone()).chain(rates).chain(counts).collect());
    }
    let mut line = Series::new("", Look::Dashed, 3, false);
    line.marks = front(of().map(|p| Mark { x: p.build_ms, y: p.mrays(), label: String::new() }));
    series.push(line);
    let best = of().max_by(|a, b| a.mrays().total_cmp(&b.mrays())).map_or("", |peer| &peer.peer);
    let clean: Vec<&str> = of().filter(|p| p.wrong == 0).map(|p| p.peer.as_str()).collect();
    Figure {
        file: format!("7-peers-{}", slug(scene)),
        title: format!("{scene}: crates on one thread"),
        say: format!(
            "Upper left is better: {best} traces fastest on one CPU thread; no hit that exact arithmetic refutes \
             came from {} (hollow: some did). Mray/s is over the four ray sets of `raykd bench --help`, as many \
             rays of each.{}",
            clean.join(", "),
            if of().any(|p| p.peer.starts_with("Embree")) { "" } else { " Embree was not on that machine." }
        ),
        x: Axis::new("build, ms", Scale::Log),
        y: Axis::new("million rays a second", Scale::Linear),
        series,
        grid,
    }
}
