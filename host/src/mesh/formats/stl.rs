//! STL, binary and text.
//!
//! The crates for it read text as `f32`, and their errors name no line. A file is binary if its length is what its
//! count of triangles says, whatever its first word; else text if it begins with `solid`.
//!
//! Every triangle has three vertices of its own: corner `k` of triangle `i` is vertex `3 i + k`. Normals are passed
//! over.

use crate::mesh::error::{MeshError, Place, check_triangles, malformed, truncated};
use crate::mesh::raw::{Raw, decimal, fits, unmarked};

/// Bytes before the triangles of a binary file, its last four their number.
const HEAD: usize = 84;
/// Bytes of a binary triangle: a normal, three corners, and two bytes to no purpose.
const RECORD: usize = 50;

/// The mesh of an STL file, its triangles numbered in file order.
pub(super) fn parse(bytes: &[u8]) -> Result<Raw, MeshError> {
    if is_binary(bytes) {
        return binary(bytes);
    }
    if is_text(unmarked(bytes)) {
        return text(unmarked(bytes));
    }
    let Some(count) = count(bytes) else {
        let what = format!(
            "{} bytes are too few for a binary file, and it does not begin with 'solid'",
            bytes.len()
        );
        return Err(truncated(Place::header(), what));
    };
    let (there, extra) = ((bytes.len() - HEAD) / RECORD, (bytes.len() - HEAD) % RECORD);
    let what = format!("its header says {count} triangles, but there are {there} and {extra} bytes");
    let at = Place::header();
    Err(if there < count as usize { truncated(at, what) } else { malformed(at, what) })
}

/// The number of triangles that the header of a binary file says.
fn count(bytes: &[u8]) -> Option<u32> {
    let head = bytes.first_chunk::<HEAD>()?;
    head.last_chunk().map(|count| u32::from_le_bytes(*count))
}

/// Whether a file is one, as far as can be told without reading it.
pub(super) fn begins(bytes: &[u8]) -> bool {
    is_binary(bytes) || is_text(unmarked(bytes))
}

/// Whether a file has the length that its header says.
fn is_binary(bytes: &[u8]) -> bool {
    count(bytes).is_some_and(|count| bytes.len() as u64 == HEAD as u64 + u64::from(count) * RECORD as u64)
}

/// Whether a file begins as a text file does.
fn is_text(bytes: &[u8]) -> bool {
    // A binary file may begin so too; it holds zeros soon, at the latest in its number of triangles.
    let words = lines(bytes).map(|(_, words)| words).find(|words| !words.is_empty());
    words.is_some_and(|words| is(words[0], "solid")) && !bytes.iter().take(HEAD).any(|&b| b == 0)
}

fn binary(bytes: &[u8]) -> Result<Raw, MeshError> {
    let records = bytes[HEAD..].as_chunks::<RECORD>().0;
    let mut mesh = Triangles::with_room(records.len())?;
    for (index, record) in records.iter().enumerate() {
        let numbers = record.as_chunks::<4>().0;
        let corner = |k: usize| [0, 1, 2].map(|a| f64::from(f32::from_le_bytes(numbers[3 + 3 * k + a])));
        mesh.push([0, 1, 2].map(corner), || Place::element("triangle", index as u64))?;
    }
    mesh.finish()
}

/// Lines with their numbers, as words. Carriage returns end lines too.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (u64, Vec<&[u8]>)> {
    let words = |line| <[u8]>::split(line, u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
    let numbered = (1..).zip(bytes.split(|&b| b == b'\n'));
    numbered
        .flat_map(move |(number, line)| line.split(|&b| b == b'\r').map(move |line| (number, words(line))))
}

/// Whether a word is this one, in letters of any size.
fn is(word: &[u8], wanted: &str) -> bool {
    word.eq_ignore_ascii_case(wanted.as_bytes())
}

/// What the next line of a text file must be.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Next {
    Solid,
    /// `facet`, or `endsolid`.
    Facet,
    Loop,
    /// A vertex; so many are there.
    Vertex(usize),
    EndLoop,
    EndFacet,
}

fn text(bytes: &[u8]) -> Result<Raw, MeshError> {
    let mut mesh = Triangles::with_room(0)?;
    let mut next = Next::Solid;
    let mut corners = [[0.0; 3]; 3];
    for (line, words) in lines(bytes) {
        let Some((first, rest)) = words.split_first() else { continue };
        let at = || Place::line(line);
        let second = |wanted: &str| rest.len() == 1 && is(rest[0], wanted);
        next = match next {
            Next::Solid if is(first, "solid") => Next::Facet,
            Next::Facet if is(first, "facet") && rest.len() <= 4 => Next::Loop,
            // A file may hold several.
            Next::Facet if is(first, "endsolid") => Next::Solid,
            Next::Loop if is(first, "outer") && second("loop") => Next::Vertex(0),
            Next::Vertex(count @ 0..3) if is(first, "vertex") && rest.len() == 3 => {
                for (axis, word) in rest.iter().enumerate() {
                    corners[count][axis] = coordinate(word, at)?;
                }
                if count == 2 { Next::EndLoop } else { Next::Vertex(count + 1) }
            }
            Next::EndLoop if is(first, "endloop") && rest.is_empty() => {
                mesh.push(corners, at)?;
                Next::EndFacet
            }
            Next::EndFacet if is(first, "endfacet") && rest.is_empty() => Next::Facet,
            _ => {
                let found: Vec<_> =
                    words.iter().take(5).map(|word| word.escape_ascii().to_string()).collect();
                let what = format!("{} must stand here, not '{}'", wanted(next), found.join(" "));
                return Err(malformed(at(), what));
            }
        };
    }
    if next != Next::Solid {
        let what = format!("the file ends where {} must stand", wanted(next));
        return Err(truncated(Place::default(), what));
    }
    mesh.finish()
}

/// What must come next, in words.
const fn wanted(next: Next) -> &'static str {
    match next {
        Next::Solid => "'solid'",
        Next::Facet => "'facet normal' or 'endsolid'",
        Next::Loop => "'outer loop'",
        Next::Vertex(_) => "'vertex' with three coordinates",
        Next::EndLoop => "'endloop' (a facet has three vertices)",
        Next::EndFacet => "'endfacet'",
    }
}

fn coordinate(word: &[u8], at: impl Fn() -> Place) -> Result<f64, MeshError> {
    match std::str::from_utf8(word).ok().and_then(decimal) {
        Some(x) if fits(x) => Ok(x),
        Some(x) => Err(MeshError::NonFinite { at: at(), value: format!("{x:?}") }),
        None => {
            let what = format!("'{}' is not a coordinate", word.escape_ascii());
            Err(malformed(at(), what))
        }
    }
}

/// Triangles, each with vertices of its own.
struct Triangles(Raw);

impl Triangles {
    fn with_room(triangles: usize) -> Result<Self, MeshError> {
        let mut mesh = Self(Raw::default());
        check_triangles(triangles as u64)?;
        mesh.0.positions.reserve_exact(triangles * 3);
        mesh.0.triangles.reserve_exact(triangles);
        Ok(mesh)
    }

    fn push(&mut self, corners: [[f64; 3]; 3], at: impl Fn() -> Place) -> Result<(), MeshError> {
        if let Some(x) = corners.as_flattened().iter().find(|x| !fits(**x)) {
            return Err(MeshError::NonFinite { at: at(), value: format!("{x:?}") });
        }
        check_triangles(self.0.triangles.len() as u64 + 1)?;
        let first = self.0.positions.len() as u32;
        self.0.positions.extend(corners);
        self.0.triangles.push([first, first + 1, first + 2]);
        Ok(())
    }

    fn finish(self) -> Result<Raw, MeshError> {
        if self.0.triangles.is_empty() {
            Err(MeshError::NoFaces { at: Place::default() })
        } else {
            Ok(self.0)
        }
    }
}
