//! Wavefront OBJ.
//!
//! `tobj` does the reading, but its errors name no line, it takes a line element of four points for a quad, it
//! passes over faces of two corners, and texture coordinates, normals and colours, which play no part here,
//! can make it fail. So it is given a copy of the lines that make geometry, checked on the way.

use super::load::{Raw, not_halfway};
use super::{MeshError, Place, fits};
use raykd_shared::limits::MAX_TRIANGLES;
use std::borrow::Cow;

/// The geometry of an OBJ file, its triangles numbered in the order of the faces.
pub(super) fn parse(bytes: &[u8]) -> Result<Raw, MeshError> {
    let mut raw = Raw::default();
    let geometry = check(bytes, &mut raw)?;
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut geometry.as_bytes(), &options, no_materials)
        .map_err(|e| MeshError::Malformed { at: Place::default(), what: e.to_string() })?;
    for model in models {
        let base = raw.positions.len() as u32;
        raw.positions.extend_from_slice(model.mesh.positions.as_chunks().0);
        raw.triangles.extend(model.mesh.indices.as_chunks().0.iter().map(|t: &[u32; 3]| t.map(|v| base + v)));
    }
    Ok(raw)
}

/// The file's logical lines with their numbers: a backslash at the end joins a line with the next.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (u64, Cow<'_, [u8]>)> {
    let mut rest = (1..).zip(bytes.split(|&b| b == b'\n').map(|l| l.strip_suffix(b"\r").unwrap_or(l)));
    std::iter::from_fn(move || {
        let (number, mut part) = rest.next()?;
        let mut joined = Vec::new();
        while let Some(start) = part.strip_suffix(b"\\") {
            joined.extend_from_slice(start);
            joined.push(b' ');
            match rest.next() {
                Some((_, next)) => part = next,
                None => return Some((number, joined.into())),
            }
        }
        if joined.is_empty() {
            return Some((number, part.into()));
        }
        joined.extend_from_slice(part);
        Some((number, joined.into()))
    })
}

/// Copies positions and faces, without textures and normals, once everything about them is in order.
fn check(bytes: &[u8], raw: &mut Raw) -> Result<String, MeshError> {
    let mut geometry = String::with_capacity(bytes.len());
    let mut vertices = 0i64;
    let mut triangles = 0u64;
    // A face may name a vertex that follows; remember the one that reaches farthest.
    let mut farthest = (0i64, 0u64);
    for (line, text) in lines(bytes) {
        let mut words = text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => {
                vertices += 1;
                geometry.push('v');
                for _ in 0..3 {
                    let word = words.next().ok_or_else(|| MeshError::Malformed {
                        at: Place::line(line),
                        what: "a vertex needs three coordinates".to_owned(),
                    })?;
                    geometry.push(' ');
                    geometry.push_str(&coordinate(word, line)?);
                }
                geometry.push('\n');
            }
            Some(b"f") => {
                let mut corners = 0u64;
                geometry.push('f');
                for word in words.take_while(|w| w[0] != b'#') {
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
                raw.repairs.polygons += u32::from(corners > 3);
                triangles += corners - 2;
                if triangles > u64::from(MAX_TRIANGLES) {
                    return Err(MeshError::TooManyTriangles { at: Place::default(), limit: MAX_TRIANGLES });
                }
            }
            Some(b"p" | b"l") => raw.repairs.ignored = raw.repairs.ignored.saturating_add(1),
            _ => {}
        }
    }
    if farthest.0 > vertices {
        return Err(out_of_range(farthest.1, farthest.0, vertices));
    }
    Ok(geometry)
}

fn out_of_range(line: u64, index: i64, vertices: i64) -> MeshError {
    MeshError::IndexOutOfRange { at: Place::line(line), index, first: 1, vertices: vertices.unsigned_abs() }
}

/// A word that is a finite coordinate, written so that `tobj` reads [`decimal`](super::load::decimal).
fn coordinate(word: &[u8], line: u64) -> Result<Cow<'_, str>, MeshError> {
    let number = std::str::from_utf8(word).ok().and_then(|text| Some((text, text.parse().ok()?)));
    match number {
        Some((text, x)) if fits(not_halfway(x, text)) => match not_halfway(x, text) {
            same if same == x => Ok(text.into()),
            other => Ok(format!("{other:?}").into()),
        },
        Some((text, _)) => Err(MeshError::NonFinite { at: Place::line(line), value: text.to_owned() }),
        None => Err(not_a_number(word, "a coordinate", line)),
    }
}

/// The vertex index of a corner written `v`, `v/vt`, `v//vn` or `v/vt/vn`.
fn corner(word: &[u8], line: u64) -> Result<(&str, i64), MeshError> {
    let index = word.split(|&b| b == b'/').next().unwrap_or_default();
    std::str::from_utf8(index)
        .ok()
        .and_then(|text| Some((text, text.parse().ok()?)))
        .ok_or_else(|| not_a_number(word, "a vertex index", line))
}

fn not_a_number(word: &[u8], wanted: &str, line: u64) -> MeshError {
    MeshError::Malformed { at: Place::line(line), what: format!("'{}' is not {wanted}", word.escape_ascii()) }
}
