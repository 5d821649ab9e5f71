//! Output files that appear whole or not at all.

use crate::Error;
use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
};

/// Finds out, before long work is done for it, whether a file could be written.
///
/// # Errors
/// The path is a folder, or nothing can be written beside it.
pub(crate) fn check(path: &Path) -> Result<(), Error> {
    let fail = |source| Error::Io { path: path.to_owned(), source };
    if path.is_dir() {
        return Err(fail(io::ErrorKind::IsADirectory.into()));
    }
    if is_no_file(path) { Ok(()) } else { beside(path).map(drop).map_err(fail) }
}

/// Whether something is there that must not be replaced by a file: a device, a pipe.
fn is_no_file(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|it| !it.is_file() && !it.is_dir())
}

/// A new file in the same folder.
fn beside(path: &Path) -> io::Result<tempfile::NamedTempFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".raykd-");
    // Readable as any new file: temporary ones are private by default.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => io::Error::new(error.kind(), "there is no such folder; create it first"),
        // Without the temporary file's name, which means nothing to anybody.
        kind => kind.into(),
    })
}

/// Writes a file beside `path` and moves it there when it is complete. A link stays one; what is no file, as
/// `/dev/stdout`, is written to as it is.
///
/// # Errors
/// The folder or the file cannot be written, or the disk is full; `path` is then as it was.
pub(crate) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<(), Error> {
    let fail = |source| Error::Io { path: path.to_owned(), source };
    if is_no_file(path) {
        let mut target = fs::OpenOptions::new().write(true).open(path).map_err(fail)?;
        let mut buffered = BufWriter::new(&mut target);
        return write(&mut buffered).and_then(|()| buffered.flush()).map_err(fail);
    }
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let mut temporary = beside(path).map_err(fail)?;
    let mut buffered = BufWriter::new(temporary.as_file_mut());
    write(&mut buffered).and_then(|()| buffered.flush()).map_err(fail)?;
    drop(buffered);
    temporary.persist(path).map_err(|e| fail(e.error))?;
    Ok(())
}
