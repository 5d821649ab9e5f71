//! From a path to a mesh: reading, unpacking, and telling the formats apart.

#[cfg(feature = "gltf")]
use super::gltf;
use super::polygon::{self, Polygon};
use super::{Mesh, MeshError, Place, Repairs, obj, ply, stl};
use crate::read;
use flate2::read::MultiGzDecoder;
use std::path::Path;

/// What a parser hands on: vertices, triangles in file order, and what it did on the way.
#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// What is known of the file's faces only is filled in.
    pub(super) repairs: Repairs,
    /// Faces of more than three corners, in file order; fans until [`polygon::cut`] has seen them.
    pub(super) polygons: Vec<Polygon>,
    /// Whether polygons are found by their numbers, rather than by lines.
    pub(super) binary: bool,
}

#[derive(Clone, Copy)]
enum Format {
    Obj,
    Ply,
    Stl,
    Gltf,
}

/// Reads a mesh from a file, of so many bytes at most, or as many as is usual.
pub(super) fn load(path: &Path, most: Option<u64>) -> Result<Mesh, MeshError> {
    let limit = most.unwrap_or_else(read::default_max_bytes);
    let bytes = read::file(path, limit)
        .map_err(|source| MeshError::Read { path: path.to_owned(), source })?
        .ok_or_else(|| MeshError::TooLong { at: Place::default(), limit }.in_file(path))?;
    parse(path, bytes, Some(path.parent().unwrap_or(path)), most).map_err(|e| e.in_file(path))
}

/// Makes a mesh of a file's bytes. The path serves to tell the format, and in messages.
pub(super) fn from_bytes(path: &Path, bytes: Vec<u8>, most: Option<u64>) -> Result<Mesh, MeshError> {
    parse(path, bytes, None, most).map_err(|e| e.in_file(path))
}

/// Buffers that are files of their own are read from the folder, if there is one.
fn parse(path: &Path, bytes: Vec<u8>, folder: Option<&Path>, most: Option<u64>) -> Result<Mesh, MeshError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let inner_name = name.strip_suffix(".gz");
    let bytes =
        if inner_name.is_some() || bytes.starts_with(&[0x1f, 0x8b]) { unpack(&bytes, most)? } else { bytes };
    if bytes.is_empty() {
        return Err(MeshError::Truncated { at: Place::default(), what: "there is nothing in it".to_owned() });
    }
    let format = match inner_name.unwrap_or(&name).rsplit_once('.') {
        Some((_, "obj")) => Some(Format::Obj),
        Some((_, "ply")) => Some(Format::Ply),
        Some((_, "stl")) => Some(Format::Stl),
        Some((_, "gltf" | "glb")) => Some(Format::Gltf),
        _ => sniff(&bytes),
    };
    let mut raw = match format {
        Some(Format::Obj) => obj::parse(&bytes)?,
        Some(Format::Ply) => ply::parse(&bytes)?,
        Some(Format::Stl) => stl::parse(&bytes)?,
        #[cfg(feature = "gltf")]
        Some(Format::Gltf) => gltf::parse(&bytes, folder, most.unwrap_or_else(read::default_max_bytes))?,
        #[cfg(not(feature = "gltf"))]
        Some(Format::Gltf) => {
            let _ = (folder, most);
            return Err(MeshError::NoGltf { at: Place::default() });
        }
        None => return Err(MeshError::UnknownFormat { at: Place::default() }),
    };
    drop(bytes);
    polygon::cut(&mut raw)?;
    Mesh::with_repairs(raw)
}

/// Undoes gzip, all members.
fn unpack(packed: &[u8], most: Option<u64>) -> Result<Vec<u8>, MeshError> {
    // Meshes pack to a fifth or a tenth; what unpacks to a hundred times its size and is not small, is none.
    let usual = || read::default_max_bytes().min((packed.len() as u64 * 100).max(256 << 20));
    let limit = most.unwrap_or_else(usual);
    read::up_to(MultiGzDecoder::new(packed), limit, 0)
        .map_err(|e| MeshError::Gzip { at: Place::default(), reason: e.to_string() })?
        .ok_or(MeshError::TooLong { at: Place::default(), limit })
}

/// The mark that some programs put before UTF-8.
const MARK: &[u8] = b"\xef\xbb\xbf";

/// Text without the mark of UTF-8.
pub(super) fn unmarked(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(MARK).unwrap_or(bytes)
}

/// The first line of some text, and the rest: lines end with LF, CR LF, or CR alone.
pub(super) fn split_line(text: &[u8]) -> (&[u8], &[u8]) {
    match text.iter().position(|b| matches!(b, b'\n' | b'\r')) {
        Some(end) => {
            let rest = &text[end + 1..];
            let both = text[end] == b'\r' && rest.first() == Some(&b'\n');
            (&text[..end], &rest[usize::from(both)..])
        }
        None => (text, &[]),
    }
}

/// Tells the format by the first words.
fn sniff(bytes: &[u8]) -> Option<Format> {
    let mut rest = unmarked(bytes);
    if rest.starts_with(b"ply\n") || rest.starts_with(b"ply\r") {
        return Some(Format::Ply);
    }
    if rest.starts_with(b"glTF") || rest.trim_ascii_start().starts_with(b"{") {
        return Some(Format::Gltf);
    }
    if stl::is_binary(bytes) || stl::is_text(rest) {
        return Some(Format::Stl);
    }
    while !rest.is_empty() {
        let (line, next) = split_line(rest);
        if let Some(word) = obj::words(line).next() {
            return obj::is_statement(word).then_some(Format::Obj);
        }
        rest = next;
    }
    None
}

/// The nearest `f64` to a number in decimal, but none that lies halfway between two `f32` unless the number does: so
/// that rounding it once more gives the `f32` nearest to the number.
pub(super) fn decimal(text: &str) -> Option<f64> {
    text.parse().ok().map(|x| not_halfway(x, text))
}

/// [`decimal`], of what `f64` makes of the text.
pub(super) fn not_halfway(x: f64, text: &str) -> f64 {
    // The 29 digits that go are a one and zeros; below the normal numbers it is easier not to look.
    let halfway = x.to_bits() << 35 == 1 << 63 || x.abs() < f64::from(f32::MIN_POSITIVE);
    let nearest = if halfway { text.parse().unwrap_or(x as f32) } else { x as f32 };
    match f64::from(nearest) {
        _ if nearest == x as f32 => x,
        above if above > x => x.next_up(),
        _ => x.next_down(),
    }
}
