//! Output files that appear whole or not at all, and keep the mode and the owner of what they replace.

use crate::{Error, lock::lock};
use std::{
    fs::{self, File, Metadata},
    io::{self, BufWriter, ErrorKind, Write},
    path::{Path, PathBuf, is_separator},
    sync::{Mutex, MutexGuard},
};
use tempfile::{Builder, NamedTempFile, TempDir};

/// Temporary files and folders that there are. Held while one is made, moved or removed.
static TEMPORARY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn temporary() -> MutexGuard<'static, Vec<PathBuf>> {
    lock(&TEMPORARY)
}

/// Removes all temporary files, for a program that is about to end: as long as the result lives none is made, and none
/// becomes an output.
pub fn abandon() -> MutexGuard<'static, Vec<PathBuf>> {
    let mut all = temporary();
    for path in all.drain(..) {
        let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir_all(&path));
    }
    all
}

/// A temporary file or folder, in the list while it is there. It must not be dropped by who holds the list.
struct Listed<T> {
    path: PathBuf,
    it: Option<T>,
}

impl<T> Listed<T> {
    fn new(make: impl FnOnce() -> io::Result<T>, path: impl FnOnce(&T) -> &Path) -> io::Result<Self> {
        let mut list = temporary();
        let it = make().map_err(|error| match error.kind() {
            ErrorKind::NotFound => io::Error::new(error.kind(), "there is no such folder; create it first"),
            // Without the temporary file's name, which means nothing to anybody.
            kind => error.raw_os_error().map_or_else(|| kind.into(), io::Error::from_raw_os_error),
        })?;
        let path = path(&it).to_owned();
        list.push(path.clone());
        Ok(Self { path, it: Some(it) })
    }

    /// Moves it where it belongs.
    fn settle(&mut self, list: &mut Vec<PathBuf>, to: impl FnOnce(T) -> io::Result<()>) -> io::Result<()> {
        let done = self.it.take().map_or(Ok(()), to);
        list.retain(|path| *path != self.path);
        done
    }
}

impl<T> Drop for Listed<T> {
    fn drop(&mut self) {
        let mut list = temporary();
        drop(self.it.take());
        list.retain(|path| *path != self.path);
    }
}

/// A file that is written a mebibyte a call: a signal is seen only between calls.
#[derive(Debug)]
pub struct Pieces<'a>(&'a mut File);

impl Write for Pieces<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(&bytes[..bytes.len().min(1 << 20)])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// A file beside its target, whose place it takes when it is complete.
struct Whole {
    file: Listed<NamedTempFile>,
    target: PathBuf,
}

impl Whole {
    /// Finds out all that can be known beforehand, and makes the file.
    fn prepare(path: &Path) -> io::Result<Self> {
        let old = existing(path)?;
        let target = old.as_ref().map_or(path, |(target, _)| target);
        #[cfg_attr(not(unix), allow(unused_mut, reason = "only modes change it"))]
        let mut builder = temporary_name();
        // Readable as any new file. One that replaces another is private until it has that one's mode.
        #[cfg(unix)]
        if old.is_none() {
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        }
        let file = Listed::new(|| builder.tempfile_in(folder_of(target)), |file| file.path())?;
        let whole = Self { file, target: target.to_owned() };
        if let (Some((_, old)), Some(file)) = (&old, &whole.file.it) {
            keep_owner(file.as_file(), old)?;
            file.as_file().set_permissions(old.permissions())?;
        }
        Ok(whole)
    }

    fn fill(&mut self, write: impl FnOnce(&mut BufWriter<Pieces<'_>>) -> io::Result<()>) -> io::Result<()> {
        let Some(file) = &mut self.file.it else { return Ok(()) };
        let mut buffered = BufWriter::new(Pieces(file.as_file_mut()));
        write(&mut buffered).and_then(|()| buffered.flush())
    }

    fn commit(&mut self, list: &mut Vec<PathBuf>) -> io::Result<()> {
        let target = &self.target;
        self.file.settle(list, |file| file.persist(target).map(drop).map_err(|failed| failed.error))
    }
}

fn temporary_name() -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(".raykd-");
    builder
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The file that is there and may be replaced, past all links.
fn existing(path: &Path) -> io::Result<Option<(PathBuf, Metadata)>> {
    let refuse = |kind, why| Err(io::Error::new(kind, why));
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let folder = path.as_os_str().as_encoded_bytes().last().is_some_and(|&b| is_separator(b.into()));
            return if folder || path.file_name().is_none() {
                refuse(ErrorKind::InvalidInput, "this names no file")
            } else {
                Ok(None)
            };
        }
        seen => seen?,
    };
    let target = match fs::canonicalize(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let why = "this is a link to a file that does not exist; make that file, or remove the link";
            return refuse(ErrorKind::NotFound, why);
        }
        target => target?,
    };
    let old = fs::metadata(&target)?;
    if old.is_dir() {
        return refuse(ErrorKind::IsADirectory, "this is a folder; name a file in it");
    }
    if !old.is_file() {
        return refuse(ErrorKind::InvalidInput, "this is no regular file");
    }
    if old.permissions().readonly() {
        return refuse(
            ErrorKind::PermissionDenied,
            "the file is read-only; make it writable, or name another",
        );
    }
    // Whether it may be written; nothing is.
    fs::OpenOptions::new().write(true).open(&target)?;
    Ok(Some((target, old)))
}

/// Gives a new file the owner and group of the one that it replaces.
#[cfg(unix)]
fn keep_owner(new: &File, old: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::MetadataExt as _;
    let now = new.metadata()?;
    if (now.uid(), now.gid()) == (old.uid(), old.gid()) {
        return Ok(());
    }
    let why = "the file's owner and group could not be kept; remove it first, or name another";
    std::os::unix::fs::fchown(new, Some(old.uid()), Some(old.gid()))
        .map_err(|error| io::Error::new(error.kind(), why))
}

#[cfg(not(unix))]
fn keep_owner(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}

/// Whether something is there that must not be replaced by a file: a device, a pipe.
fn is_no_file(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|it| !it.is_file() && !it.is_dir())
}

/// Adds the path to an error.
fn at(path: &Path) -> impl Fn(io::Error) -> Error + '_ {
    |source| Error::Io { path: path.to_owned(), source }
}

/// Finds out, before long work is done for it, whether a file could be written.
///
/// # Errors
/// The path is a folder, a link to nothing, or a file that is read-only or whose owner could not be kept; or nothing
/// can be written beside it.
pub fn check(path: &Path) -> Result<(), Error> {
    if is_no_file(path) { Ok(()) } else { Whole::prepare(path).map(drop).map_err(at(path)) }
}

/// Writes a file beside `path` and moves it there when it is complete, with the mode and the owner of the file that was
/// there. A link stays one; what is no file, as `/dev/stdout`, is written to as it is.
///
/// # Errors
/// The file cannot be written, see [`check`], or the disk is full; `path` is then as it was.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<Pieces<'_>>) -> io::Result<()>,
) -> Result<(), Error> {
    if is_no_file(path) {
        let mut target = fs::OpenOptions::new().write(true).open(path).map_err(at(path))?;
        let mut buffered = BufWriter::new(Pieces(&mut target));
        return write(&mut buffered).and_then(|()| buffered.flush()).map_err(at(path));
    }
    let mut whole = Whole::prepare(path).map_err(at(path))?;
    whole.fill(write).and_then(|()| whole.commit(&mut temporary())).map_err(at(path))
}

/// A folder that is to be made, beside its place; nothing if it is there.
fn new_folder(folder: &Path) -> io::Result<Option<Listed<TempDir>>> {
    match fs::symlink_metadata(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            #[cfg_attr(not(unix), allow(unused_mut, reason = "only modes change it"))]
            let mut builder = temporary_name();
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
            Listed::new(|| builder.tempdir_in(folder_of(folder)), |it| it.path()).map(Some)
        }
        Ok(_) if fs::metadata(folder)?.is_dir() => Ok(None),
        seen => seen.and(Err(ErrorKind::NotADirectory.into())),
    }
}

/// Finds out whether a folder is there or could be made.
///
/// # Errors
/// Something else is there, or nothing can be made beside it.
pub fn check_folder(folder: &Path) -> Result<(), Error> {
    new_folder(folder).map(drop).map_err(at(folder))
}

/// Writes files, by name, into a folder, which is made if it is not there. They appear when all are complete, as
/// [`write_whole`] has it, and a new folder appears with them.
///
/// # Errors
/// A file cannot be written; if that is known before all are complete, everything is as it was.
pub fn write_folder(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<(), Error> {
    let mut new = new_folder(folder).map_err(at(folder))?;
    let into = new.as_ref().map_or(folder, |new| &new.path).to_owned();
    let mut wholes = Vec::new();
    for (name, bytes) in files {
        let whole = Whole::prepare(&into.join(name))
            .and_then(|mut whole| whole.fill(|file| file.write_all(bytes)).map(|()| whole));
        wholes.push(whole.map_err(at(&folder.join(name)))?);
    }
    let mut list = temporary();
    wholes.iter_mut().try_for_each(|whole| whole.commit(&mut list)).map_err(at(folder))?;
    if let Some(new) = &mut new {
        let place = |made: TempDir| {
            fs::rename(made.path(), folder)?;
            // Nothing is left to be removed.
            let _ = made.keep();
            Ok(())
        };
        new.settle(&mut list, place).map_err(at(folder))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(all: &[(&str, &str)]) -> Vec<(String, Vec<u8>)> {
        all.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect()
    }

    /// Names and contents.
    fn seen(folder: &Path) -> Vec<(String, String)> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
        let entry = |it: fs::DirEntry| {
            let text = if it.path().is_file() {
                fs::read_to_string(it.path()).unwrap()
            } else {
                "folder".to_owned()
            };
            (it.file_name().into_string().unwrap(), text)
        };
        let mut all: Vec<_> = entries.map(entry).collect();
        all.sort();
        all
    }

    fn is(folder: &Path, expected: &[(&str, &str)]) {
        let expected: Vec<_> = expected.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
        assert_eq!(seen(folder), expected);
    }

    #[test]
    fn a_new_folder_appears_with_all_its_files_or_not_at_all() {
        let above = tempfile::tempdir().unwrap();
        let folder = above.path().join("charts");
        write_folder(&folder, &files(&[("a", "1"), ("none/b", "2")])).unwrap_err();
        is(above.path(), &[]);
        write_folder(&folder, &files(&[("a", "1"), ("b", "2")])).unwrap();
        is(above.path(), &[("charts", "folder")]);
        is(&folder, &[("a", "1"), ("b", "2")]);
    }

    #[test]
    fn files_of_a_folder_are_replaced_together_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        for (name, text) in [("a", "old"), ("b", "old"), ("mine", "kept")] {
            fs::write(path.join(name), text).unwrap();
        }
        let fixed = |it: bool| {
            let mut mode = fs::metadata(path.join("b")).unwrap().permissions();
            mode.set_readonly(it);
            fs::set_permissions(path.join("b"), mode).unwrap();
        };
        fixed(true);
        let error = write_folder(path, &files(&[("a", "new"), ("b", "new")])).unwrap_err().to_string();
        assert!(error.contains("b: the file is read-only"), "{error}");
        is(path, &[("a", "old"), ("b", "old"), ("mine", "kept")]);
        fixed(false);
        write_folder(path, &files(&[("a", "new"), ("b", "new"), ("c", "new")])).unwrap();
        is(path, &[("a", "new"), ("b", "new"), ("c", "new"), ("mine", "kept")]);
    }

    #[test]
    fn writing_that_fails_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write_whole(&path, |file| file.write_all(b"old")).unwrap();
        let half = |file: &mut BufWriter<Pieces<'_>>| {
            file.write_all(&[0; 100_000])?;
            Err(io::Error::other("no more"))
        };
        assert!(write_whole(&path, half).unwrap_err().to_string().contains("no more"));
        is(folder.path(), &[("a", "old")]);
    }

    #[test]
    #[cfg(unix)]
    fn a_stopped_program_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let stop = |file: &mut BufWriter<Pieces<'_>>| {
            file.write_all(&[0; 100_000])?;
            drop(abandon());
            is(folder.path(), &[]);
            Ok(())
        };
        write_whole(&path, stop).unwrap_err();
        is(folder.path(), &[]);
    }
}
