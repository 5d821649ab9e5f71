//! Odd names, what a system sets bounds to, signals at any time, and two writers of one file.

use crate::harness::{Case, Good, Judged, Tally, holds, program, raykd, run, start};
use raykd::{KdTree, rays::random};
use std::{
    ffi::OsStr,
    fs,
    os::unix::{ffi::OsStrExt as _, fs::MetadataExt as _, process::ExitStatusExt as _},
    path::Path,
    process::Command,
    thread,
    time::Duration,
};
use tempfile::TempDir;

/// A folder with a mesh and rays at it.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("there is room");
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).expect("there is room");
    write("m.obj", b"v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
    write("rays", bytemuck::cast_slice(&random(([0.0; 3], [4.0; 3]), 40, 19)));
    folder
}

/// All that lies in a folder: names, modes, contents.
fn contents(folder: &Path) -> Vec<(String, u32, Vec<u8>)> {
    let mut all: Vec<_> = fs::read_dir(folder)
        .expect("it can be read")
        .flatten()
        .map(|entry| {
            let name = String::from_utf8_lossy(entry.file_name().as_bytes()).into_owned();
            let mode = entry.metadata().map_or(0, |it| it.mode());
            (
                name,
                mode,
                if entry.path().is_file() { fs::read(entry.path()).unwrap_or_default() } else { Vec::new() },
            )
        })
        .collect();
    all.sort();
    all
}

/// The program under shell commands that limit it.
fn under(limits: &str, folder: &Path, line: &str) -> Command {
    let mut command = Command::new("bash");
    let script = format!("{limits}\nexec '{}' {line}", program().display());
    command.args(["-c", &script]).current_dir(folder);
    command
}

const WRITERS: [&str; 4] = [
    "build teapot:12 --device cpu -o out.png",
    "trace teapot:12 --rays rays --device cpu --query all --limit 64 --hits out.png",
    "render teapot:12 --device cpu --size 400x400 -o out.png",
    "build teapot:12 --builder exact --device cpu -o out.png",
];

/// What a shell can take away from a program.
const LIMITS: [&str; 12] = [
    "ulimit -n 4",
    "ulimit -n 6",
    "ulimit -n 10",
    "ulimit -s 512",
    "ulimit -s 1024",
    "exec >&-",
    "exec 2>&-",
    "exec <&-",
    "exec >&- 2>&- <&-",
    "unset HOME PATH",
    "umask 777",
    "umask 0",
];

pub(crate) fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    for line in WRITERS {
        for limit in LIMITS {
            all.push(Case::one(format!("limits/{limit}, {line}"), move || limited(limit, line)));
        }
    }
    all.push(Case::many("limits/names", names));
    all.push(Case::one("limits/seconds of a processor", short_time));
    all.push(Case::many("limits/TERM at any time", any_time));
    all.push(Case::many("limits/two writers of one file", two_writers));
    all
}

/// Whether there is an output, which then is whole; and nothing else that was not there.
fn tidy(folder: &Path, expected: bool) -> Result<bool, String> {
    let names: Vec<String> = contents(folder).into_iter().map(|(name, ..)| name).collect();
    holds(names.iter().all(|name| !name.starts_with(".raykd")), || format!("left behind: {names:?}"))?;
    let there = names.iter().any(|name| name == "out.png");
    holds(!expected || there, || "nothing was written".to_owned())?;
    Ok(there)
}

/// Names that are right, if odd.
fn names(tally: &mut Tally) {
    let odd: [&[u8]; 8] =
        [b"a b", b"new\nline", b"tab\t", b"\xff\xfe", "ü🌍".as_bytes(), b"'quotes\"", b"$(date)", b"*"];
    for name in odd {
        tally.attempt(&format!("{}", name.escape_ascii()), || {
            let folder = folder();
            let mut command = raykd(folder.path(), "build m.obj --device cpu --threads 1 -o");
            let done = run(command.arg(OsStr::from_bytes(name)))?.succeeded()?;
            KdTree::load(folder.path().join(OsStr::from_bytes(name))).map_err(|e| e.to_string())?;
            Ok(done)
        });
        tally.attempt(&format!("mesh {}", name.escape_ascii()), || {
            let folder = folder();
            let mesh = [name, b".obj"].concat();
            fs::rename(folder.path().join("m.obj"), folder.path().join(OsStr::from_bytes(&mesh)))
                .map_err(|e| e.to_string())?;
            let mut command = raykd(folder.path(), "build --device cpu --threads 1 -o out --");
            run(command.arg(OsStr::from_bytes(&mesh)))?.succeeded()
        });
    }
}

fn limited(limit: &str, line: &str) -> Judged {
    let folder = folder();
    let ran = run(&mut under(limit, folder.path(), line))?;
    // Who cannot be told anything must still be told by the exit code.
    let code = ran.status.code().ok_or_else(|| format!("{}: {}", ran.status, ran.err))?;
    let whole = tidy(folder.path(), code == 0)?;
    holds(code <= 1 && whole == (code == 0), || format!("exit code {code}, written: {whole}; {}", ran.err))?;
    if limit.contains("2>") { Ok(Good::Right) } else { ran.either() }
}

fn short_time() -> Judged {
    let folder = folder();
    let before = contents(folder.path());
    let ran = run(&mut under(
        "ulimit -S -t 1",
        folder.path(),
        "build teapot:300 --builder exact --device cpu -o out.png",
    ))?;
    const XCPU: i32 = 24;
    holds(ran.status.signal() == Some(XCPU), || format!("{}: {}", ran.status, ran.err))?;
    holds(contents(folder.path()) == before, || "files changed".to_owned())?;
    Ok(Good::Right)
}

fn send(signal: &str, to: u32) -> Result<(), String> {
    let sent = Command::new("kill").args([format!("-{signal}"), to.to_string()]).status();
    sent.map_err(|e| e.to_string())?;
    Ok(())
}

fn any_time(tally: &mut Tally) {
    for delay in (0..400).step_by(20) {
        for line in [WRITERS[0], WRITERS[2], "chart teapot:1 --quick --device cpu -o out.png"] {
            tally.attempt(&format!("{delay} ms, {line}"), || {
                let folder = folder();
                let mut command = under("ulimit -c 0", folder.path(), line);
                let running = start(command.env("RAYKD_CACHE", folder.path().join("cache")));
                thread::sleep(Duration::from_millis(delay));
                send("TERM", running.child.id())?;
                let ran = running.finish()?;
                let there = tidy(folder.path(), ran.status.success())?;
                holds(ran.status.success() || ran.status.signal() == Some(15), || {
                    format!("{}: {}", ran.status, ran.err)
                })?;
                if there && line == WRITERS[0] {
                    KdTree::load(folder.path().join("out.png")).map_err(|e| e.to_string())?;
                }
                holds(!(there && line.starts_with("chart")), || "a chart after so short a time".to_owned())?;
                Ok(Good::Right)
            });
        }
    }
}

fn two_writers(tally: &mut Tally) {
    for round in 0..10 {
        tally.attempt(&format!("round {round}"), || {
            let folder = folder();
            let both = [4, 9].map(|level| {
                start(&mut under("", folder.path(), &format!("build teapot:{level} --device cpu -o out.png")))
            });
            for running in both {
                running.finish()?.succeeded()?;
            }
            tidy(folder.path(), true)?;
            KdTree::load(folder.path().join("out.png")).map_err(|e| e.to_string())?;
            Ok(Good::Right)
        });
    }
}
