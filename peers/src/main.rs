//! raykd and other crates on the same scenes and rays: one run, one thread, peers in turn.

mod embree;
mod judge;
mod peer;
mod peers;

use anyhow::{Context as _, bail};
use judge::{Verdict, judge};
use peer::Answer;
use raykd::{BuildOptions, Device, Mesh, Ray, Scene, mesh::MeshSource, rays::sets::Sets};
use std::{io::Write as _, time::Duration};

/// One crate on one scene.
#[derive(serde::Serialize)]
struct Row {
    scene: String,
    peer: &'static str,
    build_ms: f64,
    mrays_a: f64,
    mrays_b: f64,
    mrays_c: f64,
    mrays_d: f64,
    mrays_d_any: Option<f64>,
    /// Closest hits of a to d that are wrong, as f64 arithmetic shows.
    wrong: usize,
    /// Closest hits that differ from raykd's where f64 cannot tell beyond f32's rounding who is right.
    unclear: usize,
    /// Rays of d for which "any hit" and the peer's own closest hit disagree.
    any_differs: usize,
}

fn main() -> anyhow::Result<()> {
    // SAFETY: no other thread runs yet. kdtree-ray starts a pool of threads for each build.
    unsafe { std::env::set_var("RAYON_NUM_THREADS", "1") };
    let (mut names, mut rounds, mut json, mut output) = (Vec::new(), 5, false, None);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--json" => json = true,
            "-o" => output = Some(args.next().context("-o needs a file")?),
            "--rounds" => {
                rounds = args.next().unwrap_or_default().parse().context("--rounds needs a number")?
            }
            _ if arg.starts_with('-') => {
                bail!("{arg}? There are scenes, --rounds N, --json, and -o FILE.json")
            }
            _ => names.push(arg),
        }
    }
    if names.is_empty() {
        names = vec!["teapot".to_owned()];
    }
    let mut rows = Vec::new();
    for name in &names {
        rows.extend(bench(name, rounds)?);
    }
    if let Some(path) = output {
        let bytes = serde_json::to_vec_pretty(&rows)?;
        std::fs::write(&path, bytes).with_context(|| format!("cannot write {path}"))?;
    }
    let mut out = std::io::stdout().lock();
    if json {
        serde_json::to_writer_pretty(&mut out, &rows)?;
        return Ok(writeln!(out)?);
    }
    writeln!(
        out,
        "{:14}{:20}{:>10}{:>8}{:>8}{:>8}{:>8}{:>8}{:>9}{:>9}{:>9}",
        "scene", "Mray/s", "build ms", "a", "b", "c", "d", "d any", "wrong", "unclear", "any/=d"
    )?;
    for row in &rows {
        let rate = |x: f64| format!("{x:.2}");
        let any = row.mrays_d_any.map_or_else(|| "-".to_owned(), rate);
        let [a, b, c, d] = [row.mrays_a, row.mrays_b, row.mrays_c, row.mrays_d].map(rate);
        let Row { scene, peer, build_ms, wrong, unclear, any_differs, .. } = row;
        writeln!(
            out,
            "{scene:14}{peer:20}{build_ms:10.1}{a:>8}{b:>8}{c:>8}{d:>8}{any:>8}{wrong:9}{unclear:9}{any_differs:9}"
        )?;
    }
    Ok(())
}

fn bench(name: &str, rounds: usize) -> anyhow::Result<Vec<Row>> {
    let device = Device::cpu_with_threads(1)?;
    let mesh = name.parse::<MeshSource>()?.load()?.into_local();
    let built = Scene::build(&device, &mesh, &BuildOptions::default())?;
    let sets = Sets::new(name, &mesh, |rays| built.closest(rays))?;
    drop(built);
    let Sets { a, b, c, d } = &sets;
    let closest = [a, b, c, d];
    // The best of some rounds: others on this machine only ever slow things down.
    let mut peers: Vec<Measured> = peers::ALL.iter().map(|_| Measured::default()).collect();
    for round in 1..=rounds.max(1) {
        // Whoever comes after whom: each round begins with another, and every other one goes backwards, for what
        // somebody leaves of caches and of freed memory slows the next down by a tenth.
        let number = peers::ALL.len();
        for turn in 0..number {
            let i = (turn + round) % number;
            let i = if round % 2 == 0 { number - 1 - i } else { i };
            let measured = &mut peers[i];
            let Some(peer) = peers::ALL[i](&device, &mesh) else { continue };
            eprintln!("{name}, round {round} of {rounds}: {}", peer.name);
            measured.name = peer.name;
            measured.any = peer.any.is_some();
            measured.build = measured.build.min(peer.build);
            for (i, rays) in closest.into_iter().chain([d]).enumerate() {
                let query = if i < 4 { Some(&peer.closest) } else { peer.any.as_ref() };
                if let Some(query) = query {
                    let (time, found) = query(rays);
                    measured.times[i] = measured.times[i].min(time);
                    measured.answers[i] = found;
                }
            }
        }
    }
    peers.retain(|peer| !peer.name.is_empty());
    let mut verdicts = vec![Verdict::default(); peers.len()];
    for (i, rays) in closest.into_iter().enumerate() {
        compare(&mesh, rays, &peers, i, &mut verdicts);
    }
    Ok(peers.iter().zip(verdicts).map(|(peer, verdict)| row(name, peer, verdict, closest)).collect())
}

/// What a peer took, the least of all rounds, and what it found.
struct Measured {
    name: &'static str,
    build: Duration,
    /// Closest hits of sets a to d, any of d.
    times: [Duration; 5],
    answers: [Vec<Answer>; 5],
    /// Whether it was asked for any hits.
    any: bool,
}

impl Default for Measured {
    fn default() -> Self {
        let answers = [const { Vec::new() }; 5];
        Self { name: "", build: Duration::MAX, times: [Duration::MAX; 5], answers, any: false }
    }
}

/// Judges what each peer found in set `i` by what the first of them found.
fn compare(mesh: &Mesh, rays: &[Ray], peers: &[Measured], i: usize, verdicts: &mut [Verdict]) {
    let mut lost = vec![false; rays.len()];
    for (verdict, peer) in verdicts.iter_mut().zip(peers).skip(1) {
        for (at, ray) in rays.iter().enumerate() {
            let (ours, theirs) = (peers[0].answers[i][at], peer.answers[i][at]);
            let [we, they] = judge(mesh, ray, ours, theirs);
            lost[at] |= we;
            verdict.wrong += usize::from(they);
            verdict.unclear += usize::from(!we && !they && !ours.agrees(theirs));
        }
    }
    verdicts[0].wrong += lost.iter().filter(|lost| **lost).count();
}

fn row(scene: &str, peer: &Measured, verdict: Verdict, sets: [&Vec<Ray>; 4]) -> Row {
    let rate = |i: usize| sets[i.min(3)].len() as f64 / peer.times[i].as_secs_f64() * 1.0e-6;
    let any = peer.answers[4].iter().zip(&peer.answers[3]);
    Row {
        scene: scene.to_owned(),
        peer: peer.name,
        build_ms: peer.build.as_secs_f64() * 1.0e3,
        mrays_a: rate(0),
        mrays_b: rate(1),
        mrays_c: rate(2),
        mrays_d: rate(3),
        mrays_d_any: peer.any.then(|| rate(4)),
        wrong: verdict.wrong,
        unclear: verdict.unclear,
        any_differs: any.filter(|(any, closest)| any.is_hit() != closest.is_hit()).count(),
    }
}
