//! Wavefront OBJ.
//!
//! `tobj` does the reading, but its errors name no line, it takes a line element of four points for a quad, it
//! passes over faces of two corners and words it does not know, and texture coordinates, normals and colours,
//! which play no part here, can make it fail. So it is given a copy of the lines that make geometry, checked on the
//! way.

use crate::mesh::error::{self, MeshError, Place, check_triangles, quoted_bytes};
use crate::mesh::raw::{Polygon, Raw, fits, not_halfway, split_line, unmarked};
use std::borrow::Cow;

/// The geometry of an OBJ file, its triangles numbered in the order of the faces.
pub(super) fn parse(bytes: &[u8]) -> Result<Raw, MeshError> {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(malformed(1, "the text is UTF-16; save it as UTF-8"));
    }
    let mut raw = Raw::default();
    let geometry = check(unmarked(bytes), &mut raw)?;
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut geometry.as_bytes(), &options, no_materials)
        .map_err(|e| error::malformed(Place::default(), e.to_string()))?;
    for model in models {
        let base = raw.positions.len() as u32;
        raw.positions.extend_from_slice(model.mesh.positions.as_chunks().0);
        raw.triangles.extend(model.mesh.indices.as_chunks().0.iter().map(|t: &[u32; 3]| t.map(|v| base + v)));
    }
    Ok(raw)
}

/// Statements that make geometry, or would if they were read.
const GEOMETRY: [&[u8]; 13] =
    [b"v", b"f", b"fo", b"p", b"l", b"curv", b"cdc", b"surf", b"bsp", b"bzp", b"cdp", b"call", b"vp"];

/// Statements that play no part: appearance, names, and the fine print of curves and surfaces.
const OTHERS: [&[u8]; 34] = [
    b"vt",
    b"vn",
    b"g",
    b"s",
    b"mg",
    b"o",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"lod",
    b"usemtl",
    b"mtllib",
    b"usemap",
    b"maplib",
    b"shadow_obj",
    b"trace_obj",
    b"ctech",
    b"stech",
    b"cstype",
    b"deg",
    b"bmat",
    b"step",
    b"curv2",
    b"parm",
    b"trim",
    b"hole",
    b"scrv",
    b"sp",
    b"end",
    b"con",
    b"res",
    b"csh",
    b"vc",
    b"refl",
];

/// Whether the first word is a statement.
pub(super) fn begins(bytes: &[u8]) -> bool {
    let mut rest = unmarked(bytes);
    while !rest.is_empty() {
        let (line, next) = split_line(rest);
        if let Some(word) = words(line).next() {
            return is_statement(word);
        }
        rest = next;
    }
    false
}

fn is_statement(word: &[u8]) -> bool {
    GEOMETRY.contains(&word) || OTHERS.contains(&word)
}

/// The words of a line, up to a comment.
fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    let line = line.split(|&b| b == b'#').next().unwrap_or_default();
    line.split(|b| b.is_ascii_whitespace() || *b == b'\x0b').filter(|w| !w.is_empty())
}

/// A line's number and text.
type Line<'a> = (u64, Cow<'a, [u8]>);

/// The file's logical lines.
struct Lines<'a> {
    rest: &'a [u8],
    /// Lines so far.
    number: u64,
}

impl<'a> Lines<'a> {
    /// The next line as it stands in the file.
    fn physical(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        let (line, rest) = split_line(self.rest);
        self.rest = rest;
        self.number += 1;
        Some(line)
    }

    /// The next line and its number: a backslash at the end, but not of a comment, joins it with the one that follows.
    fn next(&mut self) -> Result<Option<Line<'a>>, MeshError> {
        let Some(mut part) = self.physical() else { return Ok(None) };
        let number = self.number;
        let mut joined = Vec::new();
        while let Some(start) = part.strip_suffix(b"\\").filter(|start| !start.contains(&b'#')) {
            joined.extend_from_slice(start);
            joined.push(b' ');
            part = self.physical().unwrap_or_default();
            // Neither a name nor a number looks like that: somebody did not mean to join anything.
            if words(part).next().is_some_and(|word| GEOMETRY.contains(&word)) {
                let what = "the backslash at the end of the line before makes this a part of that one";
                return Err(malformed(self.number, what));
            }
        }
        if joined.is_empty() {
            return Ok(Some((number, part.into())));
        }
        joined.extend_from_slice(part);
        Ok(Some((number, joined.into())))
    }
}

/// Copies positions and faces, without textures and normals, once everything about them is in order. No line that is
/// not understood is passed over.
fn check(bytes: &[u8], raw: &mut Raw) -> Result<String, MeshError> {
    let mut geometry = String::with_capacity(bytes.len());
    let mut vertices = 0i64;
    let mut triangles = 0u64;
    // A face may name a vertex that follows; remember the one that reaches farthest.
    let mut farthest = (0i64, 0u64);
    let mut lines = Lines { rest: bytes, number: 0 };
    while let Some((line, text)) = lines.next()? {
        let mut words = words(&text);
        match words.next() {
            Some(b"v") => {
                vertices += 1;
                geometry.push('v');
                for _ in 0..3 {
                    let word =
                        words.next().ok_or_else(|| malformed(line, "a vertex needs three coordinates"))?;
                    geometry.push(' ');
                    geometry.push_str(&coordinate(word, line)?);
                }
                geometry.push('\n');
                // A weight, a colour, or both: numbers, or something is wrong with this line.
                for (i, word) in words.enumerate() {
                    if i == 5 || number::<f32>(word).is_none() {
                        return Err(refused(word, "is not a weight or a colour", line));
                    }
                }
            }
            // `fo` is an old word for the same.
            Some(b"f" | b"fo") => {
                let mut corners = 0u64;
                geometry.push('f');
                for word in words {
                    let (text, index) = corner(word, line)?;
                    if index == 0 || index < -vertices {
                        return Err(out_of_range(line, index, vertices));
                    }
                    if index > farthest.0 {
                        farthest = (index, line);
                    }
                    corners += 1;
                    geometry.push(' ');
                    geometry.push_str(text);
                }
                geometry.push('\n');
                if corners < 3 {
                    return Err(MeshError::TooFewCorners { at: Place::line(line), corners });
                }
                let first = triangles as u32;
                triangles += corners - 2;
                check_triangles(triangles)?;
                if corners > 3 {
                    raw.repairs.polygons += 1;
                    raw.polygons.push(Polygon { first, triangles: corners as u32 - 2, at: line });
                }
            }
            Some(b"p" | b"l" | b"curv" | b"cdc") => {
                raw.repairs.ignored = raw.repairs.ignored.saturating_add(1);
            }
            Some(word @ (b"surf" | b"bsp" | b"bzp" | b"cdp")) => {
                let why = "is a curved surface, which only polygons can stand for here";
                return Err(refused(word, why, line));
            }
            Some(word @ b"call") => {
                return Err(refused(word, "takes in another file, which is not done here", line));
            }
            Some(word) if !is_statement(word) => {
                let why = "is no statement of OBJ (a # before it makes it a comment)";
                return Err(refused(word, why, line));
            }
            _ => {}
        }
    }
    if farthest.0 > vertices {
        return Err(out_of_range(farthest.1, farthest.0, vertices));
    }
    Ok(geometry)
}

fn malformed(line: u64, what: impl Into<String>) -> MeshError {
    error::malformed(Place::line(line), what)
}

fn out_of_range(line: u64, index: i64, vertices: i64) -> MeshError {
    MeshError::IndexOutOfRange { at: Place::line(line), index, first: 1, vertices: vertices.unsigned_abs() }
}

/// A word that is a finite coordinate, written so that `tobj` reads [`decimal`](crate::mesh::raw::decimal).
fn coordinate(word: &[u8], line: u64) -> Result<Cow<'_, str>, MeshError> {
    match number::<f64>(word) {
        Some((text, x)) if fits(not_halfway(x, text)) => match not_halfway(x, text) {
            same if same == x => Ok(text.into()),
            other => Ok(format!("{other:?}").into()),
        },
        Some((text, _)) => {
            Err(MeshError::NonFinite { at: Place::line(line), value: quoted_bytes(text.as_bytes()) })
        }
        None => Err(refused(word, "is not a coordinate", line)),
    }
}

/// A word and the number that it is.
fn number<T: std::str::FromStr>(word: &[u8]) -> Option<(&str, T)> {
    let text = std::str::from_utf8(word).ok()?;
    Some((text, text.parse().ok()?))
}

/// The vertex index of a corner written `v`, `v/vt`, `v//vn` or `v/vt/vn`.
fn corner(word: &[u8], line: u64) -> Result<(&str, i64), MeshError> {
    let index = word.split(|&b| b == b'/').next().unwrap_or_default();
    number(index).ok_or_else(|| refused(word, "is not a vertex index", line))
}

fn refused(word: &[u8], why: &str, line: u64) -> MeshError {
    malformed(line, format!("'{}' {why}", quoted_bytes(word)))
}
