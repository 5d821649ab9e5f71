//! raykd and other crates on the same scenes and rays: one run, one thread, peers in turn.

mod judge;
mod peers;

use judge::{Verdict, judge};
use peers::{Answer, Peer};
use raykd::{BuildOptions, Device, Mesh, Ray, Scene, exec::Cpu, mesh::scene, rays::sets::Sets};
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
    let (mut names, mut rounds, mut json) = (Vec::new(), 5, false);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--json" => json = true,
            "--rounds" => rounds = args.next().unwrap_or_default().parse()?,
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
    let mut out = std::io::stdout().lock();
    if json {
        serde_json::to_writer_pretty(&mut out, &rows)?;
        return Ok(writeln!(out)?);
    }
    writeln!(
        out,
        "{:14}{:14}{:>10}{:>8}{:>8}{:>8}{:>8}{:>8}{:>9}{:>9}{:>9}",
        "scene", "Mray/s", "build ms", "a", "b", "c", "d", "d any", "wrong", "unclear", "any/=d"
    )?;
    for row in &rows {
        let rate = |x: f64| format!("{x:.2}");
        let any = row.mrays_d_any.map_or_else(|| "-".to_owned(), rate);
        let [a, b, c, d] = [row.mrays_a, row.mrays_b, row.mrays_c, row.mrays_d].map(rate);
        let Row { scene, peer, build_ms, wrong, unclear, any_differs, .. } = row;
        writeln!(
            out,
            "{scene:14}{peer:14}{build_ms:10.1}{a:>8}{b:>8}{c:>8}{d:>8}{any:>8}{wrong:9}{unclear:9}{any_differs:9}"
        )?;
    }
    Ok(())
}

fn bench(name: &str, rounds: usize) -> anyhow::Result<Vec<Row>> {
    let device = Device::Cpu(Cpu::with_threads(1)?);
    let mesh = scene(name)?;
    let built = Scene::build(&device, &mesh, &BuildOptions::default())?;
    let sets = Sets::new(name, &mesh, |rays| built.closest(rays))?;
    let Sets { a, b, c, d } = &sets;
    let closest = [a, b, c, d];
    let mut peers = vec![peers::raykd(&built)];
    peers.extend(peers::all(&mesh));

    // The best of some rounds: others on this machine only ever slow things down.
    let mut times = vec![[Duration::MAX; 5]; peers.len()];
    let mut answers = vec![[const { Vec::new() }; 5]; peers.len()];
    for _ in 0..rounds.max(1) {
        for (peer, (times, answers)) in peers.iter().zip(times.iter_mut().zip(&mut answers)) {
            for (i, rays) in closest.into_iter().chain([d]).enumerate() {
                let query = if i < 4 { Some(&peer.closest) } else { peer.any.as_ref() };
                if let Some(query) = query {
                    let (time, found) = query(rays);
                    times[i] = times[i].min(time);
                    answers[i] = found;
                }
            }
        }
    }
    let mut verdicts = vec![Verdict::default(); peers.len()];
    for (i, rays) in closest.into_iter().enumerate() {
        compare(&mesh, rays, &answers, i, &mut verdicts);
    }
    let rows = peers.iter().zip(times.iter().zip(&answers)).zip(verdicts);
    Ok(rows
        .map(|((peer, (times, answers)), verdict)| row(name, peer, times, answers, verdict, closest))
        .collect())
}

/// Judges what each peer found in set `i` by what raykd, the first of them, found.
fn compare(mesh: &Mesh, rays: &[Ray], answers: &[[Vec<Answer>; 5]], i: usize, verdicts: &mut [Verdict]) {
    let mut lost = vec![false; rays.len()];
    for (verdict, answers_of) in verdicts.iter_mut().zip(answers).skip(1) {
        for (at, ray) in rays.iter().enumerate() {
            let (ours, theirs) = (answers[0][i][at], answers_of[i][at]);
            let [we, they] = judge(mesh, ray, ours, theirs);
            lost[at] |= we;
            verdict.wrong += usize::from(they);
            verdict.unclear += usize::from(!we && !they && !ours.agrees(theirs));
        }
    }
    verdicts[0].wrong += lost.iter().filter(|lost| **lost).count();
}

fn row(
    scene: &str,
    peer: &Peer<'_>,
    times: &[Duration; 5],
    answers: &[Vec<Answer>; 5],
    verdict: Verdict,
    sets: [&Vec<Ray>; 4],
) -> Row {
    let rate = |i: usize| sets[i.min(3)].len() as f64 / times[i].as_secs_f64() * 1.0e-6;
    let any = answers[4].iter().zip(&answers[3]);
    Row {
        scene: scene.to_owned(),
        peer: peer.name,
        build_ms: peer.build.as_secs_f64() * 1.0e3,
        mrays_a: rate(0),
        mrays_b: rate(1),
        mrays_c: rate(2),
        mrays_d: rate(3),
        mrays_d_any: peer.any.is_some().then(|| rate(4)),
        wrong: verdict.wrong,
        unclear: verdict.unclear,
        any_differs: any.filter(|(any, closest)| any.is_hit() != closest.is_hit()).count(),
    }
}
