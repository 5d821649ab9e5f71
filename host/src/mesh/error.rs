//! What can be wrong with a mesh, where it is, and what to do about it.

use crate::quoted::{QUOTED, quoted};
use raykd_shared::limits::MAX_TRIANGLES;
use std::fmt;
use std::path::{Path, PathBuf};

/// Where in a mesh something is wrong. Displays as `dragon.ply, vertex 17`; a mesh handed over in memory has
/// no file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Place {
    /// The file, if the mesh came from one.
    pub file: Option<PathBuf>,
    /// The spot inside.
    pub spot: Spot,
}

/// A spot inside a mesh or its file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Spot {
    /// No place in particular.
    #[default]
    Whole,
    /// The header of a file.
    Header,
    /// A line of a text file, counted from 1.
    Line(u64),
    /// An element of a binary file or of the arrays handed over, counted from 0.
    Element(String, u64),
}

impl Place {
    pub(crate) fn line(line: u64) -> Self {
        Self { file: None, spot: Spot::Line(line) }
    }

    pub(crate) fn element(kind: &str, index: u64) -> Self {
        Self { file: None, spot: Spot::Element(kind.to_owned(), index) }
    }

    pub(crate) fn header() -> Self {
        Self { file: None, spot: Spot::Header }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.file {
            Some(file) => write!(f, "{}", quoted(file.display()))?,
            None => f.write_str("mesh")?,
        }
        match &self.spot {
            Spot::Whole => Ok(()),
            spot => write!(f, ", {spot}"),
        }
    }
}

impl fmt::Display for Spot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => f.write_str("whole"),
            Self::Header => f.write_str("header"),
            Self::Line(line) => write!(f, "line {line}"),
            Self::Element(kind, index) => write!(f, "{} {index}", quoted(kind)),
        }
    }
}

/// What a message quotes of a file: the start of it, with what cannot be seen escaped.
pub(crate) fn quoted_bytes(text: &[u8]) -> String {
    // No character takes more than four bytes.
    let text = String::from_utf8_lossy(&text[..text.len().min(4 * QUOTED + 4)]);
    let mut quote = String::new();
    for c in text.chars() {
        if quote.chars().count() >= QUOTED {
            quote.push('…');
            break;
        }
        match c {
            '\'' | '"' | '\\' => quote.push(c),
            _ => quote.extend(c.escape_debug()),
        }
    }
    quote
}

/// Folders as messages name them.
fn either(folders: &[PathBuf]) -> String {
    if folders.is_empty() {
        return "any folder; RAYKD_SCENES may name one".to_owned();
    }
    folders.iter().map(|folder| quoted(folder.display())).collect::<Vec<_>>().join(" or ")
}

/// Why a mesh cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file could not be read.
    #[error("cannot read {}: {source}; {}", quoted(path.display()), remedy(source))]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file of a glTF file's buffer could not be read.
    #[error(
        "{at}: cannot read {}: {source}; put this file there, or export the mesh as one .glb file",
        quoted(path.display())
    )]
    Buffer {
        /// The buffer.
        at: Place,
        /// Its file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file, unpacked, is larger than what is read of one: [`Mesh::load_up_to`](super::Mesh::load_up_to) allows
    /// more.
    #[error(
        "{at}: this is more than {limit} bytes, unpacked, and no more are read; if all is as it should be, \
         allow more"
    )]
    TooLong {
        /// The file.
        at: Place,
        /// The most that is read.
        limit: u64,
    },
    /// The file's gzip layer is broken.
    #[error("{at}: the gzip data is damaged or ends early ({reason}); fetch or pack the file again")]
    Gzip {
        /// The file.
        at: Place,
        /// What the decoder said.
        reason: String,
    },
    /// The file has none of the formats that are read.
    #[error("{at}: neither {formats}; convert it to one of them ({extensions}, each also .gz)")]
    UnknownFormat {
        /// The file.
        at: Place,
        /// The names of those that are read.
        formats: String,
        /// How their files end.
        extensions: String,
    },
    /// A glTF file has its triangles in an extension, or needs one that may change them.
    #[error("{at}: it needs the glTF extension '{name}', which is not read; export the mesh without it")]
    Extension {
        /// Where.
        at: Place,
        /// The extension's name.
        name: String,
    },
    /// The library was built without the format.
    #[error("{at}: glTF is read only by a raykd that was built with the feature 'gltf'")]
    NoGltf {
        /// The file.
        at: Place,
    },
    /// The file does not follow its format.
    #[error("{at}: {what}; repair the file or export it again")]
    Malformed {
        /// Where.
        at: Place,
        /// What is wrong there.
        what: String,
    },
    /// The file ends before everything it announced.
    #[error("{at}: {what}; the file is incomplete, fetch or export it again")]
    Truncated {
        /// Where the data end.
        at: Place,
        /// What is missing.
        what: String,
    },
    /// A coordinate is NaN, infinite, or too large for an `f32`.
    #[error("{at}: coordinate '{value}' is not a finite 32-bit float; correct or remove this vertex")]
    NonFinite {
        /// Where.
        at: Place,
        /// The coordinate as found.
        value: String,
    },
    /// A face names a vertex that does not exist.
    #[error(
        "{at}: vertex index {index} is out of range, {}; correct or remove this face",
        range_of(*.first, *.vertices)
    )]
    IndexOutOfRange {
        /// Where.
        at: Place,
        /// The index as found.
        index: i64,
        /// Index of the first vertex: 1 in OBJ files, else 0.
        first: u32,
        /// Number of vertices.
        vertices: u64,
    },
    /// A face has fewer than three corners.
    #[error("{at}: a face needs at least 3 corners, this one has {corners}; correct or remove it")]
    TooFewCorners {
        /// Where.
        at: Place,
        /// Corners found.
        corners: u64,
    },
    /// There are no faces at all.
    #[error("{at}: there are no faces; export the mesh with polygons (points and lines do not count)")]
    NoFaces {
        /// The file.
        at: Place,
    },
    /// There are more triangles than a tree can number.
    #[error("{at}: more than {limit} triangles; split the mesh into parts")]
    TooManyTriangles {
        /// The file.
        at: Place,
        /// The most there may be.
        limit: u32,
    },
    /// The whole mesh is so small that 32-bit floats have no digits left for it.
    #[error("{at}: the mesh is only {extent:e} large, less than 2^-137 (5.7e-42); scale its coordinates up")]
    TooSmall {
        /// The file.
        at: Place,
        /// Largest extent of the box.
        extent: f64,
    },
    /// A named scene has not been fetched.
    #[error(
        "scene '{name}' is not here: there is no {file} in {}; in a checkout of raykd run: cargo xtask scenes, and \
         --to FOLDER puts it there",
        either(folders)
    )]
    MissingScene {
        /// Its name.
        name: String,
        /// The file looked for.
        file: String,
        /// Where it was looked for, see [`MeshSource::Fetched`](super::MeshSource::Fetched).
        folders: Vec<PathBuf>,
    },
    /// Neither a scene's name nor a file.
    #[error(
        "'{}' is neither a file nor a scene; the scenes are teapot, teapot:LEVEL (1 to {}), {}",
        quoted(name),
        super::teapot::MAX_LEVEL,
        super::fetched::names()
    )]
    UnknownScene {
        /// What was asked for.
        name: String,
    },
}

/// What to do about a file that cannot be read.
fn remedy(source: &std::io::Error) -> String {
    match source.kind() {
        std::io::ErrorKind::IsADirectory => format!("name a file in it ({})", super::formats::extensions()),
        _ => "check the path and its permissions".to_owned(),
    }
}

/// The valid indices, in words.
fn range_of(first: u32, vertices: u64) -> String {
    match vertices {
        0 => "there are no vertices".to_owned(),
        n => format!("the vertices are {first} to {}", u64::from(first) + n - 1),
    }
}

/// The file does not follow its format.
pub(super) fn malformed(at: Place, what: impl Into<String>) -> MeshError {
    MeshError::Malformed { at, what: what.into() }
}

/// The file ends early.
pub(super) fn truncated(at: Place, what: impl Into<String>) -> MeshError {
    MeshError::Truncated { at, what: what.into() }
}

/// There are more triangles than a tree can number.
pub(super) fn too_many() -> MeshError {
    MeshError::TooManyTriangles { at: Place::default(), limit: MAX_TRIANGLES }
}

/// Refuses so many.
pub(crate) fn check_triangles(count: u64) -> Result<(), MeshError> {
    if count > MAX_TRIANGLES.into() { Err(too_many()) } else { Ok(()) }
}

impl MeshError {
    /// Names the file in an error that does not name one yet.
    pub(crate) fn in_file(mut self, path: &Path) -> Self {
        match &mut self {
            Self::Buffer { at, .. }
            | Self::TooLong { at, .. }
            | Self::Gzip { at, .. }
            | Self::UnknownFormat { at, .. }
            | Self::Extension { at, .. }
            | Self::NoGltf { at }
            | Self::Malformed { at, .. }
            | Self::Truncated { at, .. }
            | Self::NonFinite { at, .. }
            | Self::IndexOutOfRange { at, .. }
            | Self::TooFewCorners { at, .. }
            | Self::NoFaces { at }
            | Self::TooManyTriangles { at, .. }
            | Self::TooSmall { at, .. } => {
                at.file.get_or_insert_with(|| path.to_owned());
            }
            Self::Read { .. } | Self::MissingScene { .. } | Self::UnknownScene { .. } => {}
        }
        self
    }
}
