//! What a system sets bounds to, signals at any time, and two writers of one file.

use crate::{
    harness::{Case, Good, Judged, Tally, holds, program, run, start},
    places::{contents, folder},
};
use raykd::KdTree;
use std::{os::unix::process::ExitStatusExt as _, path::Path, process::Command, thread, time::Duration};

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
