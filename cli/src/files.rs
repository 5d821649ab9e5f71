//! What a command reads and writes, looked at before it does any work.

use crate::args::ReadArgs;
use anyhow::bail;
use raykd::{
    internals::{files_beside, output, quoted},
    mesh::MeshSource,
};
use same_file::Handle;
use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
};

/// What a command reads and writes.
#[derive(Debug, Default)]
pub(super) struct Files {
    read: Vec<Use>,
    written: Vec<Use>,
}

/// A file, and what is done with it: read by --rays.
type Use = (PathBuf, String);

impl Files {
    /// Reads scenes that have files.
    pub(super) fn of_scenes(names: &[impl AsRef<OsStr>], how: ReadArgs) -> Self {
        let mut read = Vec::new();
        for path in names.iter().filter_map(|name| file_of(name.as_ref())) {
            let beside = files_beside(&path, how.max_bytes).into_iter();
            read.extend(beside.map(|buffer| (buffer, "read as a buffer of the mesh".to_owned())));
            read.push((path, "read as the mesh".to_owned()));
        }
        Self { read, written: Vec::new() }
    }

    /// Reads these too, by an option.
    pub(super) fn read<'a>(mut self, option: &str, more: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        self.read.extend(more.into_iter().map(|path| (path.clone(), format!("read by {option}"))));
        self
    }

    /// Writes these, by an option.
    pub(super) fn write(mut self, option: &str, outputs: impl IntoIterator<Item = PathBuf>) -> Self {
        self.written.extend(outputs.into_iter().map(|path| (path, format!("written by {option}"))));
        self
    }

    /// Finds out whether the outputs can be written, and none of them is one of the inputs.
    ///
    /// # Errors
    /// Nothing could be written there; an output is `-`, with which other programs mean standard output; an output or
    /// standard output is the same file as an input, or both are one.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        for (output, how) in &self.written {
            if output == Path::new("-") {
                bail!("what is {how} goes to a file, not to standard output; for a file '-' write ./-");
            }
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
fn apart(read: &[Use], written: &[Use]) -> anyhow::Result<()> {
    let known = |files: &[Use]| -> Vec<(String, String, Handle)> {
        let known = |(path, how): &Use| Some((quoted(path.display()), how.clone(), identity(path)?));
        files.iter().filter_map(known).collect()
    };
    let (read, mut written) = (known(read), known(written));
    // A device takes what is printed and what is written alike.
    let printed = Handle::stdout().ok().filter(|it| it.as_file().metadata().is_ok_and(|it| it.is_file()));
    written.extend(printed.map(|it| (String::new(), "written as standard output".to_owned(), it)));
    for (i, (a, written_how, file)) in written.iter().enumerate() {
        let mut others = read.iter().chain(&written[i + 1..]);
        if let Some((b, how, _)) = others.find(|(_, _, other)| other == file) {
            // Standard output has no name.
            let names = match (a.as_str(), b.as_str()) {
                ("", name) | (name, "") => name.to_owned(),
                (a, b) if a == b => a.to_owned(),
                (a, b) => format!("{a}, the same file as {b},"),
            };
            bail!("{names} would be both {how} and {written_how}; name another file");
        }
    }
    Ok(())
}

/// A name to suggest instead of one that does not end so.
pub(super) fn renamed(path: &Path, extension: &str) -> String {
    // A folder has no ending: `.` and `..` name one.
    let path = if path.file_name().is_some() { path.to_owned() } else { path.join("mesh") };
    quoted(path.with_extension(extension).display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suggested_names_have_one_ending() {
        for (name, better) in
            [("p.jpg", "p.png"), ("p", "p.png"), ("a.b/p.tar.gz", "a.b/p.tar.png"), ("..", "../mesh.png")]
        {
            assert_eq!(renamed(Path::new(name), "png"), better);
        }
    }
}
