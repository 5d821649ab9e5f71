//! From a path to a mesh: reading, unpacking, and finding the format.

use super::error::{MeshError, Place, truncated};
use super::formats;
use super::polygon;
use super::raw::{Format, Raw, Source};
use crate::read;
use flate2::bufread::GzDecoder;
use std::{io::Read as _, path::Path};

/// Reads a file, of so many bytes at most, or as many as is usual. Errors do not name it yet.
pub(super) fn load(path: &Path, most: Option<u64>) -> Result<Raw, MeshError> {
    // What comes out of a pipe is beside nothing. Nobody could look first whether a file beside it is also written to.
    let folder = path.is_file().then(|| path.parent().unwrap_or(path));
    parse(path, bytes_of(path, most)?, folder, most)
}

fn bytes_of(path: &Path, most: Option<u64>) -> Result<Vec<u8>, MeshError> {
    let limit = most.unwrap_or_else(read::default_max_bytes);
    read::file(path, limit)
        .map_err(|source| MeshError::Read { path: path.to_owned(), source })?
        .ok_or_else(|| MeshError::TooLong { at: Place::default(), limit })
}

/// The unpacked bytes of a file of this format; none if it has another, is no regular file, or cannot be read.
#[cfg(feature = "gltf")]
pub(super) fn bytes_of_format(path: &Path, most: Option<u64>, name: &str) -> Option<Vec<u8>> {
    // A file that is named as one of another format need not be read; a pipe can be read once only.
    if !path.is_file() || formats::named(&ending(path).0).is_some_and(|format| format.name != name) {
        return None;
    }
    let (bytes, format) = unpacked(path, bytes_of(path, most).ok()?, most).ok()?;
    (format.name == name).then_some(bytes)
}

/// Understands a file's bytes. The path serves to tell the format. Buffers that are files of their own are read from
/// the folder, if there is one.
pub(super) fn parse(
    path: &Path,
    bytes: Vec<u8>,
    folder: Option<&Path>,
    most: Option<u64>,
) -> Result<Raw, MeshError> {
    let (bytes, format) = unpacked(path, bytes, most)?;
    let mut raw = (format.read)(Source { bytes: &bytes, folder, most })?;
    drop(bytes);
    polygon::cut(&mut raw)?;
    Ok(raw)
}

/// How a file's name ends, in small letters and but for `.gz`, and whether it has that.
fn ending(path: &Path) -> (String, bool) {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let inner = name.strip_suffix(".gz");
    let extension = inner.unwrap_or(&name).rsplit_once('.').map_or("", |(_, extension)| extension);
    (extension.to_owned(), inner.is_some())
}

/// A file's bytes without gzip, and their format.
fn unpacked(path: &Path, bytes: Vec<u8>, most: Option<u64>) -> Result<(Vec<u8>, Format), MeshError> {
    let (extension, packed) = ending(path);
    let bytes = if packed || bytes.starts_with(&[0x1f, 0x8b]) { unpack(&bytes, most)? } else { bytes };
    if bytes.is_empty() {
        return Err(truncated(Place::default(), "there is nothing in it"));
    }
    let format = formats::of(&extension, &bytes).ok_or_else(unknown)?;
    Ok((bytes, format))
}

/// Names the formats that there are.
fn unknown() -> MeshError {
    let names: Vec<_> = formats::known().map(|(name, _)| name).collect();
    let (last, others) = names.split_last().expect("there are formats");
    MeshError::UnknownFormat {
        at: Place::default(),
        formats: format!("{} nor {last}", others.join(", ")),
        extensions: formats::extensions(),
    }
}

/// Undoes gzip, all members.
fn unpack(packed: &[u8], most: Option<u64>) -> Result<Vec<u8>, MeshError> {
    // Meshes pack to a fifth or a tenth; what unpacks to a hundred times its size and is not small, is none.
    let usual = || read::default_max_bytes().min((packed.len() as u64 * 100).max(256 << 20));
    let limit = most.unwrap_or_else(usual);
    let (mut bytes, mut rest) = (Vec::new(), packed);
    loop {
        let left = limit.saturating_add(1).saturating_sub(bytes.len() as u64);
        let read = GzDecoder::new(&mut rest).take(left).read_to_end(&mut bytes);
        read.map_err(|e| MeshError::Gzip { at: Place::default(), reason: e.to_string() })?;
        if bytes.len() as u64 > limit {
            return Err(MeshError::TooLong { at: Place::default(), limit });
        }
        // Tapes and such fill a file with zeros, which gzip lets pass too.
        if rest.iter().all(|&b| b == 0) {
            return Ok(bytes);
        }
    }
}
