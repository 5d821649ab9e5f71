//! From a path to a mesh: reading, unpacking, and telling the formats apart.

#[cfg(feature = "gltf")]
use super::gltf;
use super::{Mesh, MeshError, Place, Repairs, obj, ply, stl};
use flate2::read::MultiGzDecoder;
use std::io::Read;
use std::path::Path;

/// What a parser hands on: vertices, triangles in file order, and what it did on the way.
#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Only `polygons` and `ignored` are filled in.
    pub(super) repairs: Repairs,
}

#[derive(Clone, Copy)]
enum Format {
    Obj,
    Ply,
    Stl,
    Gltf,
}

/// Reads a mesh from a file.
pub(super) fn load(path: &Path) -> Result<Mesh, MeshError> {
    let bytes = std::fs::read(path).map_err(|source| MeshError::Read { path: path.to_owned(), source })?;
    parse(path, bytes, Some(path.parent().unwrap_or(path))).map_err(|e| e.in_file(path))
}

/// Makes a mesh of a file's bytes. The path serves to tell the format, and in messages.
pub(super) fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Mesh, MeshError> {
    parse(path, bytes, None).map_err(|e| e.in_file(path))
}

/// Buffers that are files of their own are read from the folder, if there is one.
fn parse(path: &Path, bytes: Vec<u8>, folder: Option<&Path>) -> Result<Mesh, MeshError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let inner_name = name.strip_suffix(".gz");
    let bytes =
        if inner_name.is_some() || bytes.starts_with(&[0x1f, 0x8b]) { unpack(&bytes)? } else { bytes };
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
    let raw = match format {
        Some(Format::Obj) => obj::parse(&bytes)?,
        Some(Format::Ply) => ply::parse(&bytes)?,
        Some(Format::Stl) => stl::parse(&bytes)?,
        #[cfg(feature = "gltf")]
        Some(Format::Gltf) => gltf::parse(&bytes, folder)?,
        #[cfg(not(feature = "gltf"))]
        Some(Format::Gltf) => {
            let _ = folder;
            return Err(MeshError::NoGltf { at: Place::default() });
        }
        None => return Err(MeshError::UnknownFormat { at: Place::default() }),
    };
    drop(bytes);
    Mesh::with_repairs(raw)
}

/// Undoes gzip, all members.
fn unpack(packed: &[u8]) -> Result<Vec<u8>, MeshError> {
    let mut bytes = Vec::new();
    match MultiGzDecoder::new(packed).read_to_end(&mut bytes) {
        Ok(_) => Ok(bytes),
        Err(e) => Err(MeshError::Gzip { at: Place::default(), reason: e.to_string() }),
    }
}

/// Tells the format by the first words.
fn sniff(bytes: &[u8]) -> Option<Format> {
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        return Some(Format::Ply);
    }
    if bytes.starts_with(b"glTF") || bytes.trim_ascii_start().starts_with(b"{") {
        return Some(Format::Gltf);
    }
    if stl::is_binary(bytes) || stl::is_text(bytes) {
        return Some(Format::Stl);
    }
    let words = bytes.split(|&b| b == b'\n').filter_map(|line| {
        line.trim_ascii().split(u8::is_ascii_whitespace).next().filter(|w| !w.is_empty() && w[0] != b'#')
    });
    let known: [&[u8]; 10] = [b"v", b"vn", b"vt", b"vp", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl"];
    words.take(1).find(|word| known.contains(word)).map(|_| Format::Obj)
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
