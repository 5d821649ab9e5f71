//! The formats of mesh files, and how they are told apart.

#[cfg(feature = "gltf")]
mod gltf;
mod obj;
mod ply;
mod stl;

#[cfg(feature = "gltf")]
pub use gltf::files_beside;
pub use ply::ply_vertices;

use super::error::MeshError;
#[cfg(not(feature = "gltf"))]
use super::error::Place;
use super::raw::{Format, Raw, Source, unmarked};

/// All of them, in the order in which a file without a known extension is held against them.
const FORMATS: [Format; 4] = [
    Format { name: "PLY", extensions: &["ply"], begins: ply::begins, read: |file| ply::parse(file.bytes) },
    Format {
        name: "glTF",
        extensions: &["gltf", "glb"],
        begins: |bytes| {
            let text = unmarked(bytes);
            text.starts_with(b"glTF") || text.trim_ascii_start().starts_with(b"{")
        },
        read: gltf,
    },
    Format { name: "STL", extensions: &["stl"], begins: stl::begins, read: |file| stl::parse(file.bytes) },
    Format { name: "OBJ", extensions: &["obj"], begins: obj::begins, read: |file| obj::parse(file.bytes) },
];

fn gltf(file: Source<'_>) -> Result<Raw, MeshError> {
    #[cfg(feature = "gltf")]
    return gltf::parse(file);
    #[cfg(not(feature = "gltf"))]
    {
        let _ = (file.folder, file.most);
        Err(MeshError::NoGltf { at: Place::default() })
    }
}

/// The format of a file that ends like this.
pub(super) fn named(extension: &str) -> Option<Format> {
    FORMATS.into_iter().find(|format| format.extensions.contains(&extension))
}

/// The format of a file that ends like this, or else of one that begins like this.
pub(super) fn of(extension: &str, bytes: &[u8]) -> Option<Format> {
    named(extension).or_else(|| FORMATS.into_iter().find(|format| (format.begins)(bytes)))
}

/// The names of all formats, in order, and the extensions of each.
pub fn known() -> impl Iterator<Item = (&'static str, &'static [&'static str])> {
    let mut all = FORMATS.map(|format| (format.name, format.extensions));
    all.sort_unstable();
    all.into_iter()
}

/// How files of all formats end, for people.
pub fn extensions() -> String {
    let all: Vec<_> = known().flat_map(|(_, extensions)| extensions).map(|end| format!(".{end}")).collect();
    all.join(", ")
}
