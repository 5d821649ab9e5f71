//! What a command reads and writes, looked at before it does any work.

use anyhow::anyhow;
use raykd::{
    internals::{files_beside, output, quoted},
    mesh::MeshSource,
};
use same_file::Handle;
use std::{
    ffi::OsStr,
    iter,
    path::{Path, PathBuf},
};

/// What a command reads and writes.
#[derive(Debug, Default)]
pub(super) struct Files {
    read: Vec<PathBuf>,
    written: Vec<PathBuf>,
}

impl Files {
    /// Reads scenes that have files.
    pub(super) fn of_scenes(names: &[impl AsRef<OsStr>]) -> Self {
        let scenes: Vec<PathBuf> = names.iter().filter_map(|name| file_of(name.as_ref())).collect();
        let beside = scenes.iter().flat_map(|path| files_beside(path));
        let read = beside.chain(scenes.iter().cloned()).collect();
        Self { read, written: Vec::new() }
    }

    /// Reads these too.
    pub(super) fn read(mut self, more: &[&Option<PathBuf>]) -> Self {
        self.read.extend(more.iter().copied().flatten().cloned());
        self
    }

    /// Writes these.
    pub(super) fn write(mut self, outputs: impl IntoIterator<Item = PathBuf>) -> Self {
        self.written.extend(outputs);
        self
    }

    /// Finds out whether the outputs can be written, and none of them is one of the inputs.
    ///
    /// # Errors
    /// Nothing could be written there; an output or standard output is the same file as an input, or both are one.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        for output in &self.written {
            output::check(output)?;
        }
        apart(&self.read, &self.written)
    }
}

/// The file of a scene, if it has one.
fn file_of(scene: &OsStr) -> Option<PathBuf> {
    MeshSource::try_from(scene).ok()?.path()
}

/// A regular file, whatever it is called; nothing if it cannot be read, as then it is no input.
fn identity(path: &Path) -> Option<Handle> {
    path.metadata().is_ok_and(|it| it.is_file()).then(|| Handle::from_path(path).ok()).flatten()
}

/// Finds out whether all that is written differs from all that is read, and from what is printed.
fn apart(read: &[PathBuf], written: &[PathBuf]) -> anyhow::Result<()> {
    let known = |paths: &[PathBuf]| -> Vec<(String, Handle)> {
        paths.iter().filter_map(|path| Some((quoted(path.display()), identity(path)?))).collect()
    };
    let (read, mut written) = (known(read), known(written));
    // A device takes what is printed and what is written alike.
    let printed = Handle::stdout().ok().filter(|it| it.as_file().metadata().is_ok_and(|it| it.is_file()));
    written.extend(printed.map(|printed| ("standard output".to_owned(), printed)));
    let same = |(a, b): (&(String, Handle), &(String, Handle))| {
        (a.1 == b.1).then(|| anyhow!("{} and {} are the same file; write to another one", a.0, b.0))
    };
    let pairs = written.iter().enumerate();
    let mut pairs = pairs.flat_map(|(i, a)| iter::repeat(a).zip(read.iter().chain(&written[i + 1..])));
    pairs.find_map(same).map_or(Ok(()), Err)
}
