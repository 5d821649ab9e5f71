//! Where outputs go: onto inputs, into places that are not to be written, over files that are to stay as they are.

use crate::{
    harness::{Case, Good, Judged, Tally, holds, program, raykd, run},
    judge::Reference,
};
use raykd::KdTree;
use std::{
    ffi::OsStr,
    fs::{self, Permissions},
    os::unix::{
        ffi::OsStrExt as _,
        fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _, chown, symlink},
        process::CommandExt as _,
    },
    path::Path,
    process::{Command, Stdio},
};
use tempfile::TempDir;

/// A folder with a mesh, its tree, rays and costs.
pub(crate) fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("there is room");
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).expect("there is room");
    write("m.obj", b"v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
    write("rays", bytemuck::cast_slice(&Reference::tetra().rays()));
    write("costs.json", b"{}");
    let built = run(&mut raykd(folder.path(), "build m.obj -o m.kd --device cpu --threads 1"));
    assert!(built.is_ok_and(|ran| ran.status.success()), "a tree can be built at all");
    folder
}

/// All that lies in a folder: names, modes, contents.
pub(crate) fn contents(folder: &Path) -> Vec<(String, u32, Vec<u8>)> {
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

/// Something that must be refused and change nothing.
fn changes_nothing(folder: &Path, command: &mut Command, words: &[&str]) -> Judged {
    let before = contents(folder);
    let done = run(command)?.refused(words);
    holds(contents(folder) == before, || format!("files changed; {done:?}"))?;
    done
}

pub(crate) fn cases() -> Vec<Case> {
    vec![
        Case::many("places/onto inputs", onto_inputs),
        Case::many("places/printed onto inputs", printed_onto_inputs),
        Case::many("places/unwritable", unwritable),
        Case::many("places/names", names),
        Case::many("places/modes", modes),
        Case::many("places/other users", others),
        Case::many("places/devices and pipes", devices),
        Case::many("places/charts", charts),
        Case::many("places/belongs to another mesh", wrong_trees),
    ]
}

fn onto_inputs(tally: &mut Tally) {
    let lines = [
        ("m.obj", "build m.obj -o"),
        ("costs.json", "build m.obj --quality auto --costs costs.json -o"),
        ("m.obj", "trace m.obj --rays rays --hits"),
        ("rays", "trace m.obj --rays rays --hits"),
        ("m.kd", "trace m.obj --rays rays --tree m.kd --hits"),
        ("costs.json", "trace m.obj --rays rays --quality auto --costs costs.json --hits"),
        ("m.png", "render m.png -o"),
        ("costs.json.png", "render m.obj --quality auto --costs costs.json.png -o"),
    ];
    for (input, line) in lines {
        for form in ["same", "dot", "up", "soft", "softer", "hard", "absolute"] {
            tally.attempt(&format!("{line} {input}, {form}"), || {
                let folder = folder();
                let at = |name: &str| folder.path().join(name);
                if input.ends_with("png") {
                    fs::copy(at(if input == "m.png" { "m.obj" } else { "costs.json" }), at(input))
                        .map_err(|e| e.to_string())?;
                }
                let ending = if input.ends_with("png") { ".png" } else { "" };
                let other = format!("other{ending}");
                let name = match form {
                    "same" => input.to_owned(),
                    "dot" => format!("./{input}"),
                    "up" => format!("../{}/{input}", folder.path().file_name().unwrap_or_default().display()),
                    "absolute" => at(input).display().to_string(),
                    "hard" => {
                        fs::hard_link(at(input), at(&other)).map(|()| other).map_err(|e| e.to_string())?
                    }
                    "soft" => symlink(input, at(&other)).map(|()| other).map_err(|e| e.to_string())?,
                    _ => {
                        let two = symlink(input, at("first")).and_then(|()| symlink("first", at(&other)));
                        two.map(|()| other).map_err(|e| e.to_string())?
                    }
                };
                changes_nothing(folder.path(), raykd(folder.path(), line).arg(name), &["same file"])
            });
        }
    }
}

fn printed_onto_inputs(tally: &mut Tally) {
    for line in [
        "bench m.obj --device cpu",
        "build m.obj",
        "build m.obj --json",
        "stress --scene m.obj",
        "render m.obj -o a.png",
    ] {
        tally.attempt(line, || {
            let folder = folder();
            let before = contents(folder.path());
            let file = fs::OpenOptions::new()
                .append(true)
                .open(folder.path().join("m.obj"))
                .map_err(|e| e.to_string())?;
            // Its output is what is tried, so it does not go where others' goes.
            let output = raykd(folder.path(), line)
                .stdin(Stdio::null())
                .stdout(file)
                .output()
                .map_err(|e| e.to_string())?;
            let told = String::from_utf8_lossy(&output.stderr);
            holds(output.status.code() == Some(1) && told.contains("same file"), || {
                told.clone().into_owned()
            })?;
            holds(contents(folder.path()) == before, || "files changed".to_owned())?;
            Ok(Good::Refused)
        });
    }
}

/// The commands that write one file, which is named at the end.
pub(crate) const WRITERS: [&str; 3] = [
    "build none-such.obj --device cpu -o",
    "trace none-such.obj --rays rays --device cpu --hits",
    "render none-such.obj --device cpu -o",
];

fn unwritable(tally: &mut Tally) {
    let long = "n".repeat(300);
    let deep = "deep/".repeat(2000);
    let places = [
        "/proc/out.png",
        "/sys/out.png",
        "/dev/null/out.png",
        "none/out.png",
        "m.obj/out.png",
        "",
        ".",
        "..",
        "/",
        "new.png/",
        "none/..",
        "link.png",
        "loop.png",
        "fixed.png",
        "folder.png",
        &format!("{long}.png"),
        &format!("{deep}out.png"),
    ];
    for line in WRITERS {
        for place in places {
            tally.attempt(&format!("{line} {}", place.get(..40).unwrap_or(place)), || {
                let folder = folder();
                let at = |name: &str| folder.path().join(name);
                fs::write(at("fixed.png"), "old").map_err(|e| e.to_string())?;
                fs::set_permissions(at("fixed.png"), Permissions::from_mode(0o444))
                    .map_err(|e| e.to_string())?;
                fs::create_dir(at("folder.png")).map_err(|e| e.to_string())?;
                symlink("nowhere.png", at("link.png")).map_err(|e| e.to_string())?;
                symlink("loop.png", at("loop.png")).map_err(|e| e.to_string())?;
                let mut command = raykd(folder.path(), line);
                let done = changes_nothing(folder.path(), command.arg(place), &[])?;
                let ran = run(&mut command)?;
                // Told before any work: the mesh is not even looked for.
                holds(!ran.err.contains("none-such"), || format!("the mesh came first: {}", ran.err))?;
                Ok(done)
            });
        }
    }
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

fn modes(tally: &mut Tally) {
    for mode in [0o600, 0o640, 0o644, 0o666, 0o700, 0o755, 0o620, 0o777] {
        for owner in [None, Some((1234, 2345))] {
            tally.attempt(&format!("{mode:o} {owner:?}"), || {
                let folder = folder();
                let out = folder.path().join("out");
                fs::write(&out, "old").map_err(|e| e.to_string())?;
                // Only root can give a file away; then nothing is tried.
                if let Some((user, group)) = owner
                    && chown(&out, Some(user), Some(group)).is_err()
                {
                    return Ok(Good::Right);
                }
                fs::set_permissions(&out, Permissions::from_mode(mode)).map_err(|e| e.to_string())?;
                let before = fs::metadata(&out).map_err(|e| e.to_string())?;
                run(&mut raykd(folder.path(), "build m.obj --device cpu --threads 1 -o out"))?.succeeded()?;
                let after = fs::metadata(&out).map_err(|e| e.to_string())?;
                let seen = |it: &fs::Metadata| (it.mode(), it.uid(), it.gid());
                holds(seen(&before) == seen(&after), || {
                    format!("{:?} became {:?}", seen(&before), seen(&after))
                })?;
                KdTree::load(&out).map_err(|e| e.to_string())?;
                Ok(Good::Right)
            });
        }
    }
}

/// What another user may not write stays. Only root can play one.
fn others(tally: &mut Tally) {
    for (mode, folder_mode) in
        [(0o644, 0o777), (0o666, 0o777), (0o444, 0o777), (0o666, 0o1777), (0o666, 0o755), (0o600, 0o755)]
    {
        tally.attempt(&format!("{mode:o} in {folder_mode:o}"), || {
            let folder = folder();
            let out = folder.path().join("out");
            fs::copy(program(), folder.path().join("raykd")).map_err(|e| e.to_string())?;
            fs::write(&out, "old").map_err(|e| e.to_string())?;
            fs::set_permissions(&out, Permissions::from_mode(mode)).map_err(|e| e.to_string())?;
            fs::set_permissions(folder.path(), Permissions::from_mode(folder_mode))
                .map_err(|e| e.to_string())?;
            let mut command = Command::new(folder.path().join("raykd"));
            command.args(["build", "m.obj", "--device", "cpu", "-o", "out"]).current_dir(folder.path());
            if command.uid(65534).gid(65534).stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
                return Ok(Good::Right);
            }
            changes_nothing(folder.path(), &mut command, &["out"])
        });
    }
}

fn devices(tally: &mut Tally) {
    tally.attempt("null", || {
        let folder = folder();
        let done = run(&mut raykd(folder.path(), "build m.obj --device cpu -o /dev/null"))?.succeeded()?;
        let null = fs::metadata("/dev/null").map_err(|e| e.to_string())?;
        holds(null.file_type().is_char_device(), || "/dev/null was replaced".to_owned())?;
        Ok(done)
    });
    tally.attempt("full", || {
        let folder = folder();
        run(&mut raykd(folder.path(), "build m.obj --device cpu -o /dev/full"))?
            .refused(&["/dev/full", "No space left"])
    });
    tally.attempt("printing to full", || {
        let folder = folder();
        let full = fs::OpenOptions::new().write(true).open("/dev/full").map_err(|e| e.to_string())?;
        let output = raykd(folder.path(), "build m.obj --json --device cpu")
            .stdout(full)
            .output()
            .map_err(|e| e.to_string())?;
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        holds(output.status.code() == Some(1) && told.contains("No space left"), || told)?;
        Ok(Good::Refused)
    });
    tally.attempt("pipe", || {
        let folder = folder();
        let script = format!(
            "mkfifo p && (cat p > seen &) && '{}' build m.obj --device cpu -o p && sleep 0.2 && test -p p",
            program().display()
        );
        run(Command::new("bash").args(["-c", &script]).current_dir(folder.path()))?.succeeded()?;
        KdTree::load(folder.path().join("seen")).map_err(|e| e.to_string())?;
        Ok(Good::Right)
    });
    tally.attempt("link", || {
        let folder = folder();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("target"), "old")
            .and_then(|()| symlink("target", at("link")))
            .map_err(|e| e.to_string())?;
        run(&mut raykd(folder.path(), "build m.obj --device cpu -o link"))?.succeeded()?;
        holds(fs::symlink_metadata(at("link")).is_ok_and(|it| it.is_symlink()), || {
            "the link was replaced".to_owned()
        })?;
        KdTree::load(at("target")).map_err(|e| e.to_string())?;
        Ok(Good::Right)
    });
    tally.attempt("folder that is gone", || {
        let folder = folder();
        let script = format!(
            "mkdir gone && cd gone && rmdir ../gone && exec '{}' build teapot:1 --device cpu -o out",
            program().display()
        );
        run(Command::new("bash").args(["-c", &script]).current_dir(folder.path()))?.refused(&["out"])
    });
}

fn charts(tally: &mut Tally) {
    for (place, prepare) in [
        ("/proc/charts", ""),
        ("none/charts", ""),
        ("m.obj", ""),
        ("gone", "ln -s nowhere gone"),
        ("c", "mkdir c; echo old > c/index.html; chmod 444 c/index.html"),
        ("c", "mkdir c; ln -s nowhere c/1-accuracy.svg"),
        ("c", "mkdir -p c/index.html"),
    ] {
        tally.attempt(&format!("{place} {prepare}"), || {
            let folder = folder();
            run(Command::new("bash").args(["-c", prepare]).current_dir(folder.path()))?;
            changes_nothing(
                folder.path(),
                &mut raykd(folder.path(), &format!("chart none-such.obj --device cpu -o {place}")),
                &[place],
            )
        });
    }
    for input in ["index.html", "3-x.csv", "1-a.svg"] {
        tally.attempt(input, || {
            let folder = folder();
            fs::rename(folder.path().join("m.obj"), folder.path().join(input)).map_err(|e| e.to_string())?;
            changes_nothing(
                folder.path(),
                &mut raykd(folder.path(), &format!("chart {input} --device cpu -o .")),
                &["same file"],
            )
        });
    }
}

/// A tree file is for the mesh it was built from, and no other of the same size.
fn wrong_trees(tally: &mut Tally) {
    for (what, from, to) in [
        ("another corner", "v 0 0 4", "v 1 1 4"),
        ("another order", "f 1 3 2\nf 1 2 4\n", "f 1 2 4\nf 1 3 2\n"),
        ("another triangle", "f 1 3 2\n", "f 1 1 2\n"),
        ("more triangles", "f 1 3 2\n", "f 1 3 2\nf 1 3 2\n"),
        ("another size", "v 4 0 0", "v 5 0 0"),
        ("a digit", "v 0 4 0", "v 0 3.9999998 0"),
    ] {
        tally.attempt(what, || {
            let folder = folder();
            let mesh = fs::read_to_string(folder.path().join("m.obj")).map_err(|e| e.to_string())?;
            fs::write(folder.path().join("m.obj"), mesh.replacen(from, to, 1)).map_err(|e| e.to_string())?;
            let line = "trace m.obj --tree m.kd --rays rays --hits hits --device cpu";
            changes_nothing(folder.path(), &mut raykd(folder.path(), line), &["m.kd"])
        });
    }
    tally.attempt("its own", || {
        let folder = folder();
        let line = "trace m.obj --tree m.kd --rays rays --hits hits --device cpu";
        run(&mut raykd(folder.path(), line))?.succeeded()
    });
}
