//! What a system sets bounds to, and signals in the middle of a write.

use crate::{
    harness::{Case, Good, Judged, Tally, holds, program, run, start},
    places::{contents, folder},
};
use flate2::{Compression, write::GzEncoder};
use raykd::KdTree;
use std::{
    fs,
    io::Write as _,
    os::unix::process::ExitStatusExt as _,
    path::Path,
    process::Command,
    thread,
    time::{Duration, Instant},
};

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
    // Of memory, in megabytes: enough, or a message. What Rust says before it aborts, where a list cannot grow, is one.
    for megabytes in [64, 96, 128, 192, 256, 512, 1024] {
        for line in [
            "build teapot:60 --device cpu -o out.png",
            "trace teapot:60 --rays rays --device cpu --query all --limit 65536 --hits out.png",
            "render teapot:60 --device cpu --size 2000x2000 -o out.png",
        ] {
            all.push(Case::one(format!("limits/memory {megabytes} MB, {line}"), move || {
                memory(megabytes, line)
            }));
        }
    }
    for file in ["zero", "bomb"] {
        all.push(Case::one(format!("limits/endless mesh, {file}"), move || endless(file)));
    }
    for line in WRITERS {
        for limit in LIMITS {
            all.push(Case::one(format!("limits/{limit}, {line}"), move || limited(limit, line)));
        }
        for kilobytes in [0, 1, 4, 16] {
            for trap in ["", "trap '' XFSZ; "] {
                all.push(Case::one(format!("limits/{trap}file of {kilobytes} KB, {line}"), move || {
                    short_file(&format!("{trap}ulimit -f {kilobytes}"), line)
                }));
            }
        }
    }
    all.push(Case::one("limits/seconds of a processor", short_time));
    for signal in ["HUP", "INT", "QUIT", "TERM", "KILL"] {
        for old in [true, false] {
            all.push(Case::many(
                format!("limits/{signal} while writing, {}", if old { "over a file" } else { "anew" }),
                move |tally| {
                    for delay in [0, 3, 20] {
                        tally.attempt(&format!("{delay} ms"), || stopped(signal, old, delay));
                    }
                },
            ));
        }
    }
    all.push(Case::one("limits/HUP that is to be ignored", ignored_signal));
    all.push(Case::many("limits/TERM at any time", any_time));
    all.push(Case::many("limits/two writers of one file", two_writers));
    all.push(Case::one("limits/costs that cannot be kept", unkept_costs));
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

fn memory(megabytes: u32, line: &str) -> Judged {
    let folder = folder();
    let ran = run(&mut under(&format!("ulimit -v {}", megabytes << 10), folder.path(), line))?;
    let there = tidy(folder.path(), ran.status.success())?;
    holds(there == ran.status.success(), || format!("{}: a file is there", ran.status))?;
    if ran.status.success() {
        return Ok(Good::Right);
    }
    // Abort, with a message.
    let told = ran.err.to_lowercase();
    let said = told.contains("memory")
        || told.contains("threads")
        || told.contains("resource temporarily unavailable");
    holds(said && matches!(ran.status.signal(), None | Some(6)), || format!("{}: {}", ran.status, ran.err))?;
    Ok(Good::Refused)
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

fn short_file(limit: &str, line: &str) -> Judged {
    let folder = folder();
    fs::write(folder.path().join("out.png"), "old").map_err(|e| e.to_string())?;
    let before = contents(folder.path());
    let output = under(limit, folder.path(), line).output().map_err(|e| e.to_string())?;
    let told = String::from_utf8_lossy(&output.stderr);
    holds(output.status.code() == Some(1) && told.contains("too large"), || {
        format!("{}: {told}", output.status)
    })?;
    holds(contents(folder.path()) == before, || "files changed".to_owned())?;
    Ok(Good::Refused)
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

fn ignored_signal() -> Judged {
    let folder = folder();
    let running = writing(folder.path(), "trap '' HUP;")?;
    send("HUP", running.child.id())?;
    running.finish()?.succeeded()
}

fn unkept_costs() -> Judged {
    let folder = folder();
    let mut command = under("", folder.path(), "build m.obj --quality auto --device cpu --threads 1");
    let running = start(command.env("RAYKD_CACHE", "/proc/none"));
    // Measuring takes minutes; that it begins is enough.
    thread::sleep(Duration::from_secs(2));
    send("TERM", running.child.id())?;
    let ran = running.finish()?;
    let noted = ran.err.contains("cannot be kept") && ran.err.contains("measuring");
    holds(ran.status.signal() == Some(15) && noted, || format!("{}: {}", ran.status, ran.err))?;
    Ok(Good::Right)
}

/// A mesh that has no end, or 4 GB of nothing.
fn endless(file: &str) -> Judged {
    let folder = folder();
    let name = if file == "zero" { "/dev/zero".to_owned() } else { "bomb.obj.gz".to_owned() };
    if file == "bomb" {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(&vec![b'\n'; 1 << 25]).map_err(|e| e.to_string())?;
        let member = encoder.finish().map_err(|e| e.to_string())?;
        fs::write(folder.path().join(&name), member.repeat(128)).map_err(|e| e.to_string())?;
    }
    let line = format!("build {name} --device cpu --threads 1");
    run(&mut under(&format!("ulimit -v {}", 3 << 20), folder.path(), &line))?.refused(&[&name])
}

/// A run that is in the middle of writing 180 MB.
fn writing(folder: &Path, shell: &str) -> Result<crate::harness::Running, String> {
    let rays = raykd::rays::random(([-9.0; 3], [9.0; 3]), 700, 1);
    fs::write(folder.join("many"), bytemuck::cast_slice::<_, u8>(&rays)).map_err(|e| e.to_string())?;
    let line = "trace teapot:1 --rays many --hits out.png --query all --limit 16384 --device cpu";
    let mut running = start(&mut under(&format!("ulimit -c 0; {shell}"), folder, line));
    let begun = Instant::now();
    while begun.elapsed() < crate::harness::RUN {
        let temporary = fs::read_dir(folder).map_err(|e| e.to_string())?.flatten();
        let mut temporary =
            temporary.filter(|entry| entry.file_name().as_encoded_bytes().starts_with(b".raykd"));
        if temporary.any(|entry| entry.metadata().is_ok_and(|it| it.len() > 0)) {
            return Ok(running);
        }
        if running.child.try_wait().map_err(|e| e.to_string())?.is_some() {
            return Err(format!("it ended early: {}", running.finish()?.err));
        }
        thread::sleep(Duration::from_millis(1));
    }
    Err(format!("nothing was written: {}", running.finish()?.err))
}

fn send(signal: &str, to: u32) -> Result<(), String> {
    let sent = Command::new("kill").args([format!("-{signal}"), to.to_string()]).status();
    sent.map_err(|e| e.to_string())?;
    Ok(())
}

fn stopped(signal: &str, old: bool, delay: u64) -> Judged {
    let folder = folder();
    let out = folder.path().join("out.png");
    if old {
        fs::write(&out, "old").map_err(|e| e.to_string())?;
    }
    let running = writing(folder.path(), "")?;
    thread::sleep(Duration::from_millis(delay));
    send(signal, running.child.id())?;
    let ran = running.finish()?;
    let now = fs::read(&out).ok();
    let finished = now.as_ref().is_some_and(|bytes| bytes.len() == 700 * 16384 * 16);
    holds(finished || now == old.then(|| b"old".to_vec()), || "half a file".to_owned())?;
    holds(ran.status.signal().is_some() || ran.status.success(), || format!("{}: {}", ran.status, ran.err))?;
    // Nobody can tidy up after that one.
    if signal != "KILL" {
        tidy(folder.path(), old || finished)?;
    }
    Ok(Good::Right)
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
