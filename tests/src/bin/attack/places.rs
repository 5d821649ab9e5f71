//! Files by odd names, and trees of other meshes. Where outputs go is tested with the program: `cli/tests/cli`.

use crate::{
    harness::{Case, Judged, Tally, holds, raykd, run},
    judge::Reference,
};
use raykd::KdTree;
use std::{
    ffi::OsStr,
    fs,
    os::unix::{ffi::OsStrExt as _, fs::MetadataExt as _},
    path::Path,
    process::Command,
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
    vec![Case::many("places/names", names), Case::many("places/belongs to another mesh", wrong_trees)]
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
