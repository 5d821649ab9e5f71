//! What a reader of mesh files is given, what it hands on, and what readers share.

use super::error::MeshError;
use super::repair::Repairs;
use std::path::Path;

/// A file to read.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) bytes: &'a [u8],
    /// Where buffers that are files of their own may be read.
    pub(super) folder: Option<&'a Path>,
    /// Bytes that are read at most, if not as many as is usual.
    pub(super) most: Option<u64>,
}

/// A format of mesh files.
pub(super) struct Format {
    pub(super) name: &'static str,
    /// In small letters, without the dot.
    pub(super) extensions: &'static [&'static str],
    /// Whether a file without a known extension seems to have it.
    pub(super) begins: fn(&[u8]) -> bool,
    pub(super) read: fn(Source<'_>) -> Result<Raw, MeshError>,
}

/// What a reader hands on: vertices, triangles in file order, and what it did on the way.
#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// What is known of the file's faces only is filled in.
    pub(super) repairs: Repairs,
    /// Faces of more than three corners, in file order; fans until [`polygon::cut`](super::polygon::cut) has seen them.
    pub(super) polygons: Vec<Polygon>,
    /// Whether polygons are found by their numbers, rather than by lines.
    pub(super) binary: bool,
}

/// A face of the file that stands in [`Raw`] as a fan from its first corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    /// Its first triangle, and how many there are.
    pub(super) first: u32,
    pub(super) triangles: u32,
    /// Its line, or its number in a binary file.
    pub(super) at: u64,
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

/// The nearest `f64` to a number in decimal, but none that lies halfway between two `f32` unless the number does: so
/// that rounding it once more gives the `f32` nearest to the number.
pub(super) fn decimal(text: &str) -> Option<f64> {
    text.parse().ok().map(|x| not_halfway(x, text))
}

/// [`decimal`], of what `f64` makes of the text.
pub(super) fn not_halfway(x: f64, text: &str) -> f64 {
    // The 29 bits that go are a one and zeros; below the normal numbers it is easier not to look.
    let halfway = x.to_bits() << 35 == 1 << 63 || x.abs() < f64::from(f32::MIN_POSITIVE);
    let nearest = if halfway { text.parse().unwrap_or(x as f32) } else { x as f32 };
    match f64::from(nearest) {
        _ if nearest == x as f32 => x,
        above if above > x => x.next_up(),
        _ => x.next_down(),
    }
}

/// Whether a coordinate is finite in `f32`.
pub(super) fn fits(x: f64) -> bool {
    (x as f32).is_finite()
}
