//! What a command reads and writes, looked at before it does any work.

use super::{args::Command, chart};
use raykd::{
    Error,
    internals::{output, quoted},
    mesh::{Scene, scenes_folder},
};
use same_file::Handle;
use std::{
    ffi::OsStr,
    iter,
    path::{Path, PathBuf},
};

/// Finds out whether a command's outputs can be written, and none of them is one of its inputs.
///
/// # Errors
/// Nothing could be written there; an output or standard output is the same file as an input, or both are one.
pub(super) fn check(command: &Command) -> Result<(), Error> {
    let (read, written) = inputs_and_outputs(command);
    for output in &written {
        output::check(output)?;
    }
    apart(&read, &written)
}

fn inputs_and_outputs(command: &Command) -> (Vec<PathBuf>, Vec<PathBuf>) {
    fn scenes(names: &[impl AsRef<OsStr>]) -> Vec<PathBuf> {
        names.iter().filter_map(|name| file_of(name.as_ref())).collect()
    }
    let and = |scenes: Vec<PathBuf>, more: &[&Option<PathBuf>]| -> Vec<PathBuf> {
        scenes.into_iter().chain(more.iter().copied().flatten().cloned()).collect()
    };
    let (read, written) = match command {
        Command::Bench(a) => (and(scenes(&a.scenes), &[&a.how.amount.costs, &a.compare_with]), None),
        Command::Build(a) => (and(scenes(a.mesh.as_slice()), &[&a.how.amount.costs]), a.output.clone()),
        Command::Trace(a) => {
            let more = [&a.rays, &a.tree, &a.how.amount.costs];
            (and(scenes(std::slice::from_ref(&a.mesh)), &more), a.hits.clone())
        }
        Command::Render(a) => {
            (and(scenes(std::slice::from_ref(&a.mesh)), &[&a.how.amount.costs]), Some(a.output.clone()))
        }
        Command::Stress(a) => (and(scenes(&a.scenes), &[&a.replay]), None),
        Command::Chart(a) => return (and(scenes(&a.scenes), &[&a.peers]), chart::replaced(&a.output)),
        Command::Calibrate(a) => (scenes(&a.check), a.output.clone()),
        Command::Devices(_) => (Vec::new(), None),
    };
    (read, written.into_iter().collect())
}

/// The file of a scene, if it has one.
fn file_of(scene: &OsStr) -> Option<PathBuf> {
    match Scene::try_from(scene).ok()? {
        Scene::Teapot(_) => None,
        Scene::Fetched { file, .. } => Some(scenes_folder().join(file)),
        Scene::File(path) => Some(path),
    }
}

/// A regular file, whatever it is called; nothing if it cannot be read, as then it is no input.
fn identity(path: &Path) -> Option<Handle> {
    path.metadata().is_ok_and(|it| it.is_file()).then(|| Handle::from_path(path).ok()).flatten()
}

/// Finds out whether all that is written differs from all that is read, and from what is printed.
fn apart(read: &[PathBuf], written: &[PathBuf]) -> Result<(), Error> {
    let known = |paths: &[PathBuf]| -> Vec<(String, Handle)> {
        paths.iter().filter_map(|path| Some((quoted(path.display()), identity(path)?))).collect()
    };
    let (read, mut written) = (known(read), known(written));
    // A device takes what is printed and what is written alike.
    let printed = Handle::stdout().ok().filter(|it| it.as_file().metadata().is_ok_and(|it| it.is_file()));
    written.extend(printed.map(|printed| ("standard output".to_owned(), printed)));
    let same = |(a, b): (&(String, Handle), &(String, Handle))| {
        (a.1 == b.1).then(|| Error::SameFile { written: a.0.clone(), other: b.0.clone() })
    };
    let pairs = written.iter().enumerate();
    let mut pairs = pairs.flat_map(|(i, a)| iter::repeat(a).zip(read.iter().chain(&written[i + 1..])));
    pairs.find_map(same).map_or(Ok(()), Err)
}
