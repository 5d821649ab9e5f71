//! Output files that appear whole or not at all.

use crate::Error;
use std::{
    io::{self, BufWriter, Write},
    path::Path,
};

/// Writes a file beside `path` and moves it there when it is complete.
///
/// # Errors
/// The folder or the file cannot be written, or the disk is full; `path` is then as it was.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut std::fs::File>) -> io::Result<()>,
) -> Result<(), Error> {
    let fail = |source| Error::Io { path: path.to_owned(), source };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut temporary = tempfile::Builder::new().prefix(".raykd-").tempfile_in(folder).map_err(fail)?;
    let mut buffered = BufWriter::new(temporary.as_file_mut());
    write(&mut buffered).and_then(|()| buffered.flush()).map_err(fail)?;
    drop(buffered);
    temporary.persist(path).map_err(|e| fail(e.error))?;
    Ok(())
}
