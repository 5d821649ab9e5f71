//! glTF 2.0, as JSON (`.gltf`) and in one binary file (`.glb`).
//!
//! `serde_json` reads the structure, `base64` and `percent-encoding` the addresses of buffers. The crate `gltf` would
//! read the transforms of nodes as `f32`, and refuse files for materials and textures, which play no part here.
//!
//! Triangles are those of the nodes of the file's scene, or of its first one, or of all nodes if there is none, or of
//! the meshes if there are no nodes either: node by node, children after their parent in the order of its list, then
//! primitive by primitive. Corners keep the file's order, in mirrored nodes too; strips turn every other triangle
//! round, as glTF says.

use crate::mesh::error::{MeshError, Place, check_triangles, malformed, quoted_bytes, too_many, truncated};
use crate::mesh::load;
use crate::mesh::raw::{Raw, Source, fits, unmarked};
use crate::read;
use base64::{Engine as _, engine};
use serde::{Deserialize, de::IgnoredAny};
use std::borrow::Cow;
use std::cell::{Cell, OnceCell};
use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{self, Path, PathBuf};

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Document {
    asset: Asset,
    scene: Option<usize>,
    scenes: Vec<Scene>,
    nodes: Vec<Node>,
    meshes: Vec<Shape>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<View>,
    buffers: Vec<Buffer>,
    extensions_used: Vec<String>,
    extensions_required: Vec<String>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Asset {
    version: String,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Scene {
    nodes: Vec<usize>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Node {
    children: Vec<usize>,
    mesh: Option<usize>,
    skin: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Shape {
    primitives: Vec<Primitive>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Primitive {
    attributes: BTreeMap<String, usize>,
    indices: Option<usize>,
    mode: Option<u32>,
    targets: Vec<IgnoredAny>,
    extensions: BTreeMap<String, IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: u64,
    count: u64,
    component_type: u32,
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    normalized: bool,
    sparse: Option<Sparse>,
}

#[derive(Deserialize)]
struct Sparse {
    count: u64,
    indices: SparsePart,
    values: SparsePart,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct SparsePart {
    buffer_view: usize,
    #[serde(default)]
    byte_offset: u64,
    /// Of indices.
    component_type: Option<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: Option<u64>,
    #[serde(default)]
    extensions: BTreeMap<String, IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Buffer {
    uri: Option<String>,
    byte_length: u64,
}

/// Extensions that move or multiply triangles, even where a file says that one may do without them.
const GEOMETRY: [&str; 2] = ["EXT_mesh_gpu_instancing", "CESIUM_RTC"];
/// Extensions, or how their names begin, that a file may require: triangles are the same without them, or they are
/// understood.
const HARMLESS: [&str; 8] = [
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_animation_pointer",
    "KHR_xmp",
];

/// The mesh of a glTF file. Buffers in files of their own are read from `folder`, if there is one: with the file itself
/// no more than `limit` bytes.
pub(super) fn parse(Source { bytes, folder, most }: Source<'_>) -> Result<Raw, MeshError> {
    let limit = most.unwrap_or_else(read::default_max_bytes);
    let (document, blob) = document(bytes)?;
    if !document.asset.version.starts_with("2.") {
        let version = quoted_bytes(document.asset.version.as_bytes());
        return Err(malformed(Place::header(), format!("glTF of version '{version}', but 2.0 is read")));
    }
    let refused = |name: &&String| GEOMETRY.contains(&name.as_str());
    let unknown = |name: &&String| !HARMLESS.iter().any(|known| name.starts_with(known));
    let used = document.extensions_used.iter().find(refused);
    if let Some(name) = used.or_else(|| document.extensions_required.iter().find(unknown)) {
        return Err(extension(Place::header(), name));
    }
    let buffers = document.buffers.iter().map(|_| OnceCell::new()).collect();
    let changes = document.accessors.iter().map(|_| OnceCell::new()).collect();
    let left = Cell::new(limit.saturating_sub(bytes.len() as u64));
    let size = bytes.len() as u64;
    let drawn = document.meshes.iter().map(|_| OnceCell::new()).collect();
    let file = File { document: &document, blob, folder, buffers, changes, drawn, size, limit, left };
    let mut raw = Raw::default();
    file.read(&mut raw)?;
    if raw.triangles.is_empty() {
        return Err(MeshError::NoFaces { at: Place::default() });
    }
    Ok(raw)
}

/// The structure of a file, and its binary part.
fn document(bytes: &[u8]) -> Result<(Document, Option<&[u8]>), MeshError> {
    let bytes = unmarked(bytes);
    let (json, blob) = if bytes.starts_with(b"glTF") { chunks(bytes)? } else { (bytes, None) };
    let document = serde_json::from_slice(json).map_err(|e| {
        let (at, what) = (Place::line(e.line() as u64), quoted_bytes(e.to_string().as_bytes()));
        if e.is_eof() { truncated(at, what) } else { malformed(at, what) }
    })?;
    Ok((document, blob))
}

fn extension(at: Place, name: &str) -> MeshError {
    MeshError::Extension { at, name: quoted_bytes(name.as_bytes()) }
}

/// JSON and binary part of a `.glb` file.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), MeshError> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(truncated(Place::header(), "a binary glTF file has a header of 12 bytes"));
    };
    if version != 2 {
        return Err(malformed(Place::header(), format!("binary glTF of version {version}, but 2 is read")));
    }
    if length as usize != bytes.len() {
        let what = format!("its header says {length} bytes, but there are {}", bytes.len());
        let short = bytes.len() < length as usize;
        return Err(if short { truncated(Place::header(), what) } else { malformed(Place::header(), what) });
    }
    let chunk = |number: u64, at: usize, kind: &str| {
        let place = || Place::element("chunk", number);
        let end = || truncated(place(), format!("the file ends within its {kind} part"));
        let length = word(at).ok_or_else(end)? as usize;
        if bytes.get(at + 4..at + 8).ok_or_else(end)? != format!("{kind:\0<4}").as_bytes() {
            return Err(malformed(place(), format!("this is not the {kind} part")));
        }
        bytes[at + 8..].get(..length).ok_or_else(end)
    };
    let json = chunk(0, 12, "JSON")?;
    let next = 20 + json.len();
    let blob = if next < bytes.len() { Some(chunk(1, next, "BIN")?) } else { None };
    Ok((json, blob))
}

/// A 3 x 4 matrix, by its columns.
type Matrix = [[f64; 3]; 4];

const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];

/// A direction times a matrix, plus a point.
fn apply(m: &Matrix, p: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|a| m[0][a] * p[0] + m[1][a] * p[1] + m[2][a] * p[2] + from[a])
}

impl Node {
    fn transform(&self, number: usize) -> Result<Matrix, MeshError> {
        let bad = |what: &str| malformed(Place::element("node", number as u64), what);
        if let Some(m) = self.matrix {
            if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
                return Err(bad("its matrix is no affine transform"));
            }
            return Ok([0, 1, 2, 3].map(|column| [0, 1, 2].map(|row| m[4 * column + row])));
        }
        let [x, y, z, w] = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let square = x * x + y * y + z * z + w * w;
        if !(square.is_normal()) {
            return Err(bad("its rotation is no unit quaternion"));
        }
        // Written with few digits, it is not quite of unit length.
        let s = 2.0 / square;
        let turned = [
            [1.0 - s * (y * y + z * z), s * (x * y + z * w), s * (x * z - y * w)],
            [s * (x * y - z * w), 1.0 - s * (x * x + z * z), s * (y * z + x * w)],
            [s * (x * z + y * w), s * (y * z - x * w), 1.0 - s * (x * x + y * y)],
        ];
        let scale = self.scale.unwrap_or([1.0; 3]);
        let [i, j, k] = [0, 1, 2].map(|column| turned[column].map(|x| x * scale[column]));
        Ok([i, j, k, self.translation.unwrap_or_default()])
    }
}

/// What a mesh that many nodes may have gives each of them.
struct Drawn {
    /// Primitives with triangles.
    primitives: Vec<usize>,
    /// How many of the others are points or lines.
    ignored: u32,
    /// Whether it has morph targets.
    morphs: bool,
}

/// A document with its bytes.
struct File<'a> {
    document: &'a Document,
    /// The binary part.
    blob: Option<&'a [u8]>,
    folder: Option<&'a Path>,
    /// Bytes that may be read in all, and how many are left.
    limit: u64,
    left: Cell<u64>,
    /// Those that were needed so far.
    buffers: Vec<OnceCell<Cow<'a, [u8]>>>,
    /// What sparse accessors change, of those that were needed so far.
    changes: Vec<OnceCell<Vec<Change>>>,
    /// Of meshes that a node had.
    drawn: Vec<OnceCell<Drawn>>,
    /// Bytes of the file.
    size: u64,
}

impl File<'_> {
    fn read(&self, raw: &mut Raw) -> Result<(), MeshError> {
        let Document { scene, scenes, nodes, meshes, .. } = self.document;
        if nodes.is_empty() {
            return (0..meshes.len()).try_for_each(|mesh| self.mesh(mesh, &IDENTITY, false, raw));
        }
        let mut child = vec![false; nodes.len()];
        for &number in nodes.iter().flat_map(|node| &node.children) {
            *child.get_mut(number).ok_or_else(|| no_such("node", number, nodes.len()))? = true;
        }
        let roots = match scene.or_else(|| (!scenes.is_empty()).then_some(0)) {
            Some(number) => get(scenes, number, "scene")?.nodes.clone(),
            None => (0..nodes.len()).filter(|&number| !child[number]).collect(),
        };
        let mut seen = vec![false; nodes.len()];
        let mut waiting: Vec<_> = roots.into_iter().rev().map(|root| (root, IDENTITY)).collect();
        while let Some((number, parent)) = waiting.pop() {
            let node = get(nodes, number, "node")?;
            if std::mem::replace(&mut seen[number], true) {
                let what = "it is reached twice; nodes must form trees";
                return Err(malformed(Place::element("node", number as u64), what));
            }
            let own = node.transform(number)?;
            let [i, j, k, origin] = own;
            let [i, j, k] = [i, j, k].map(|column| apply(&parent, column, [0.0; 3]));
            let matrix = [i, j, k, apply(&parent, origin, parent[3])];
            if let Some(mesh) = node.mesh {
                self.mesh(mesh, &matrix, node.skin.is_some(), raw)?;
            }
            waiting.extend(node.children.iter().rev().map(|&child| (child, matrix)));
        }
        Ok(())
    }

    fn mesh(&self, number: usize, matrix: &Matrix, skin: bool, raw: &mut Raw) -> Result<(), MeshError> {
        let mesh = get(&self.document.meshes, number, "mesh")?;
        let primitive = |index: usize, raw: &mut Raw| {
            let at = || Place::element(&format!("mesh {number}, primitive"), index as u64);
            self.primitive(&mesh.primitives[index], &at, matrix, raw)
        };
        let morphs = match self.drawn[number].get() {
            Some(Drawn { primitives, ignored, morphs }) => {
                raw.repairs.ignored = raw.repairs.ignored.saturating_add(*ignored);
                primitives.iter().try_for_each(|&index| primitive(index, raw))?;
                *morphs
            }
            None => {
                let (before, mut primitives) = (raw.repairs.ignored, Vec::new());
                for index in 0..mesh.primitives.len() {
                    let triangles = raw.triangles.len();
                    primitive(index, raw)?;
                    if raw.triangles.len() > triangles {
                        primitives.push(index);
                    }
                }
                let morphs = mesh.primitives.iter().any(|primitive| !primitive.targets.is_empty());
                let ignored = raw.repairs.ignored - before;
                self.drawn[number].get_or_init(|| Drawn { primitives, ignored, morphs }).morphs
            }
        };
        raw.repairs.unposed = raw.repairs.unposed.saturating_add((skin || morphs).into());
        Ok(())
    }

    fn primitive(
        &self,
        primitive: &Primitive,
        at: &dyn Fn() -> Place,
        matrix: &Matrix,
        raw: &mut Raw,
    ) -> Result<(), MeshError> {
        let positions = primitive.attributes.get("POSITION").copied();
        let given = positions.map(|number| get(&self.document.accessors, number, "accessor")).transpose()?;
        let empty = given.is_none_or(|given| given.buffer_view.is_none() && given.sparse.is_none());
        if let Some(name) = primitive.extensions.keys().next().filter(|_| empty) {
            return Err(extension(at(), name));
        }
        let positions = positions.ok_or_else(|| malformed(at(), "it has no attribute 'POSITION'"))?;
        let vertices = self.elements::<3>(positions, "VEC3")?;
        let mode = primitive.mode.unwrap_or(4);
        // Before its corners are listed: any number of primitives may have the same ones, which nothing else limits.
        if mode <= 3 {
            raw.repairs.ignored = raw.repairs.ignored.saturating_add(1);
            return Ok(());
        }
        let corners: Vec<u32> = match primitive.indices {
            None if vertices.count > u64::from(u32::MAX) => return Err(too_many()),
            None => (0..vertices.count as u32).collect(),
            Some(indices) => {
                let indices = self.elements::<1>(indices, "SCALAR")?;
                let corner = |i| {
                    let [index] = indices.get(i);
                    if index < vertices.count as f64 && index <= f64::from(u32::MAX) {
                        return Ok(index as u32);
                    }
                    let (index, vertices) = (index as i64, vertices.count);
                    Err(MeshError::IndexOutOfRange { at: at(), index, first: 0, vertices })
                };
                (0..indices.count).map(corner).collect::<Result<_, _>>()?
            }
        };
        let triangles: Vec<[u32; 3]> = match mode {
            4 if corners.len().is_multiple_of(3) => corners.as_chunks().0.to_vec(),
            4 => return Err(malformed(at(), format!("{} corners are no whole triangles", corners.len()))),
            5 | 6 if corners.len() < 3 => {
                return Err(MeshError::TooFewCorners { at: at(), corners: corners.len() as u64 });
            }
            5 => (0..corners.len() - 2)
                .map(|i| [corners[i], corners[i + 1 + i % 2], corners[i + 2 - i % 2]])
                .collect(),
            6 => corners[1..].windows(2).map(|pair| [pair[0], pair[1], corners[0]]).collect(),
            mode => return Err(malformed(at(), format!("there is no mode {mode}"))),
        };
        check_triangles((raw.triangles.len() + triangles.len()) as u64)?;
        // Many primitives may share the vertices of a large buffer: only those that this one uses.
        let mut used = corners;
        used.sort_unstable();
        used.dedup();
        let base = u32::try_from(raw.positions.len()).map_err(|_| too_many())?;
        if base.checked_add(used.len() as u32).is_none() {
            return Err(too_many());
        }
        // A small file may name the same numbers any number of times. It counts as if each were written out.
        let written = raw.positions.len() + used.len() + raw.triangles.len() + triangles.len();
        if 12 * written as u64 > self.limit {
            return Err(MeshError::TooLong { at: at(), limit: self.limit });
        }
        raw.positions.reserve(used.len());
        for &vertex in &used {
            let position = apply(matrix, vertices.get(vertex.into()), matrix[3]);
            if let Some(x) = position.iter().find(|x| !fits(**x)) {
                return Err(MeshError::NonFinite { at: at(), value: format!("{x:?}") });
            }
            raw.positions.push(position);
        }
        // Mostly all are used, and a vertex has its own number.
        let all = used.last().is_some_and(|&last| last as usize + 1 == used.len());
        let new = |v: u32| base + if all { v } else { used.partition_point(|&u| u < v) as u32 };
        raw.triangles.extend(triangles.into_iter().map(|corners| corners.map(new)));
        Ok(())
    }

    fn elements<const N: usize>(&self, number: usize, kind: &str) -> Result<Elements<'_, N>, MeshError> {
        let accessor = get(&self.document.accessors, number, "accessor")?;
        let at = || Place::element("accessor", number as u64);
        let part = Component::new(accessor.component_type, accessor.normalized)
            .filter(|part| N == 3 && part.bytes != 0 || part.is_index())
            .filter(|_| accessor.kind == kind);
        let Some(part) = part else {
            let (kind, part) = (quoted_bytes(accessor.kind.as_bytes()), accessor.component_type);
            return Err(malformed(at(), format!("type '{kind}' of component type {part} cannot serve here")));
        };
        let items = match accessor.buffer_view {
            Some(view) => {
                Some(self.items(view, accessor.byte_offset, accessor.count, N * part.bytes, &at)?)
            }
            // Zeros, but not more than the file has bytes.
            None if accessor.count > self.size => {
                return Err(malformed(at(), format!("{} elements without data", accessor.count)));
            }
            None => None,
        };
        let changed = match &accessor.sparse {
            Some(sparse) => self.changes::<N>(number, sparse, accessor.count, part, &at)?,
            None => &[],
        };
        Ok(Elements { count: accessor.count, part, items, changed })
    }

    /// The elements that a sparse accessor changes. They are read once: many primitives may use it.
    fn changes<const N: usize>(
        &self,
        number: usize,
        Sparse { count, indices, values }: &Sparse,
        elements: u64,
        part: Component,
        at: &dyn Fn() -> Place,
    ) -> Result<&[Change], MeshError> {
        if let Some(known) = self.changes[number].get() {
            return Ok(known);
        }
        let index_part = indices.component_type.and_then(|kind| Component::new(kind, false));
        let Some(index_part) = index_part.filter(Component::is_index) else {
            return Err(malformed(at(), "its sparse indices are no unsigned integers"));
        };
        let places = self.items(indices.buffer_view, indices.byte_offset, *count, index_part.bytes, at)?;
        let values = self.items(values.buffer_view, values.byte_offset, *count, N * part.bytes, at)?;
        let mut changed: Vec<Change> = Vec::new();
        for i in 0..*count {
            let place = index_part.read(places.get(i)) as u64;
            let risen = changed.last().is_none_or(|(last, _)| *last < place);
            if place >= elements || !risen {
                return Err(malformed(at(), format!("sparse index {place} is out of range or order")));
            }
            let value: [f64; N] = part.read_all(values.get(i));
            changed.push((place, std::array::from_fn(|i| value.get(i).copied().unwrap_or_default())));
        }
        Ok(self.changes[number].get_or_init(|| changed))
    }

    /// So many items of so many bytes each, in a buffer view.
    fn items(
        &self,
        number: usize,
        offset: u64,
        count: u64,
        size: usize,
        at: &dyn Fn() -> Place,
    ) -> Result<Items<'_>, MeshError> {
        let view = get(&self.document.buffer_views, number, "bufferView")?;
        let buffer = self.buffer(view)?;
        let start = usize::try_from(view.byte_offset).ok();
        let length = usize::try_from(view.byte_length).ok();
        let bytes = start.zip(length).and_then(|(start, length)| buffer.get(start..)?.get(..length));
        let Some(bytes) = bytes else {
            let at = Place::element("bufferView", number as u64);
            return Err(truncated(at, format!("it does not fit its buffer of {} bytes", buffer.len())));
        };
        let stride = view.byte_stride.unwrap_or(size as u64);
        if stride < size as u64 {
            let what = format!("a stride of {stride} bytes, but an element has {size}");
            return Err(malformed(Place::element("bufferView", number as u64), what));
        }
        let end = |count: u64| (count - 1).checked_mul(stride)?.checked_add(size as u64)?.checked_add(offset);
        if count > 0 && end(count).is_none_or(|end| end > bytes.len() as u64) {
            let what = format!("{count} elements do not fit its buffer view of {} bytes", bytes.len());
            return Err(truncated(at(), what));
        }
        let bytes = bytes.get(offset as usize..).unwrap_or_default();
        Ok(Items { bytes, stride: stride as usize, size })
    }

    fn buffer(&self, view: &View) -> Result<&[u8], MeshError> {
        let (number, buffer) = (view.buffer, get(&self.document.buffers, view.buffer, "buffer")?);
        if let Some(known) = self.buffers[number].get() {
            return Ok(known);
        }
        let at = || Place::element("buffer", number as u64);
        let bytes: Cow<'_, [u8]> = match (&buffer.uri, self.blob) {
            (None, Some(blob)) if number == 0 => blob.into(),
            (None, _) => {
                return Err(match view.extensions.keys().next() {
                    Some(name) => extension(at(), name),
                    None => malformed(at(), "it has neither address nor data"),
                });
            }
            (Some(uri), _) => match uri.strip_prefix("data:") {
                Some(data) => decode(data).ok_or_else(|| malformed(at(), "its data are no base64"))?.into(),
                None => self.beside(uri, buffer.byte_length, &at)?.into(),
            },
        };
        if (bytes.len() as u64) < buffer.byte_length {
            let what = format!("it has {} bytes of {} announced", bytes.len(), buffer.byte_length);
            return Err(truncated(at(), what));
        }
        let bytes = match bytes {
            Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[..buffer.byte_length as usize]),
            Cow::Owned(mut bytes) => {
                bytes.truncate(buffer.byte_length as usize);
                Cow::Owned(bytes)
            }
        };
        Ok(self.buffers[number].get_or_init(|| bytes))
    }

    /// What stands in a file beside this one, up to a length.
    fn beside(&self, uri: &str, length: u64, at: &dyn Fn() -> Place) -> Result<Vec<u8>, MeshError> {
        let short = quoted_bytes(uri.as_bytes());
        let Some(name) = name_beside(uri) else {
            return Err(malformed(
                at(),
                format!("'{short}' is no file beside this one, or in a folder there"),
            ));
        };
        let Some(folder) = self.folder else {
            return Err(malformed(
                at(),
                format!("it is the file '{short}', which bytes in memory or from a pipe cannot name"),
            ));
        };
        let path = folder.join(&*name);
        let read = || {
            // A pipe may never open, and a device never end.
            let about = std::fs::metadata(&path)?;
            if !about.is_file() {
                return Err(std::io::Error::other("not a regular file"));
            }
            read::up_to(std::fs::File::open(&path)?.take(length), self.left.get(), about.len().min(length))
        };
        let bytes = read().map_err(|source| MeshError::Buffer { at: at(), path: path.clone(), source })?;
        let bytes = bytes.ok_or_else(|| MeshError::TooLong { at: at(), limit: self.limit })?;
        self.left.set(self.left.get() - bytes.len() as u64);
        Ok(bytes)
    }
}

/// The name of a file beside a glTF file or in a folder there, if the address of a buffer is one. A file from somebody
/// else is not to name what lies elsewhere.
fn name_beside(uri: &str) -> Option<Cow<'_, str>> {
    let name = percent_encoding::percent_decode_str(uri).decode_utf8().ok()?;
    let below = |part| matches!(part, path::Component::Normal(_) | path::Component::CurDir);
    let is_below = Path::new(&*name).components().all(below);
    (is_below && !uri.contains(':') && !name.starts_with('\\')).then_some(name)
}

/// The files that a glTF file at a path reads its buffers from; none if it is no such file, or cannot be read. Of the
/// file so many bytes are read at most, or as many as is usual.
#[doc(hidden)]
pub fn files_beside(path: &Path, most: Option<u64>) -> Vec<PathBuf> {
    let bytes = load::bytes_of_format(path, most, "glTF").unwrap_or_default();
    let buffers = document(&bytes).map(|(document, _)| document.buffers).unwrap_or_default();
    let names = buffers.iter().filter_map(|buffer| name_beside(buffer.uri.as_deref()?));
    names.map(|name| path.with_file_name(&*name)).collect()
}

fn no_such(kind: &str, number: usize, count: usize) -> MeshError {
    malformed(
        Place::element(kind, number as u64),
        format!("there is none of that number, but {count} in all"),
    )
}

fn get<'a, T>(all: &'a [T], number: usize, kind: &str) -> Result<&'a T, MeshError> {
    all.get(number).ok_or_else(|| no_such(kind, number, all.len()))
}

/// What a data address holds.
fn decode(data: &str) -> Option<Vec<u8>> {
    let (head, body) = data.split_once(',')?;
    if !head.ends_with(";base64") {
        return Some(percent_encoding::percent_decode_str(body).collect());
    }
    let how =
        engine::GeneralPurposeConfig::new().with_decode_padding_mode(engine::DecodePaddingMode::Indifferent);
    engine::GeneralPurpose::new(&base64::alphabet::STANDARD, how).decode(body).ok()
}

/// Items in a buffer view.
struct Items<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl Items<'_> {
    /// One of those that are there.
    fn get(&self, i: u64) -> &[u8] {
        &self.bytes[i as usize * self.stride..][..self.size]
    }
}

/// How a number is written.
#[derive(Clone, Copy)]
struct Component {
    kind: u32,
    bytes: usize,
    /// What an integer is divided by: the largest of its kind, if it is normalized.
    whole: f64,
}

impl Component {
    fn new(kind: u32, normalized: bool) -> Option<Self> {
        let (bytes, whole) = match kind {
            5120 => (1, i8::MAX.into()),
            5121 => (1, u8::MAX.into()),
            5122 => (2, i16::MAX.into()),
            5123 => (2, u16::MAX.into()),
            5125 => (4, u32::MAX.into()),
            5126 => (4, 1.0),
            _ => return None,
        };
        Some(Self { kind, bytes, whole: if normalized { whole } else { 1.0 } })
    }

    fn is_index(&self) -> bool {
        matches!(self.kind, 5121 | 5123 | 5125) && self.whole == 1.0
    }

    fn read(&self, b: &[u8]) -> f64 {
        let number: f64 = match self.kind {
            5120 => i8::from_le_bytes([b[0]]).into(),
            5121 => b[0].into(),
            5122 => i16::from_le_bytes([b[0], b[1]]).into(),
            5123 => u16::from_le_bytes([b[0], b[1]]).into(),
            5125 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]).into(),
            _ => f32::from_le_bytes([b[0], b[1], b[2], b[3]]).into(),
        };
        if self.whole == 1.0 { number } else { (number / self.whole).max(-1.0) }
    }

    fn read_all<const N: usize>(&self, item: &[u8]) -> [f64; N] {
        std::array::from_fn(|i| self.read(&item[i * self.bytes..]))
    }
}

/// What an accessor gives.
struct Elements<'a, const N: usize> {
    count: u64,
    part: Component,
    /// None where all are zeros but those changed.
    items: Option<Items<'a>>,
    /// By rising number.
    changed: &'a [Change],
}

/// The number of an element, and what it is instead: of a scalar the first.
type Change = (u64, [f64; 3]);

impl<const N: usize> Elements<'_, N> {
    /// One of those that are there.
    fn get(&self, i: u64) -> [f64; N] {
        if let Ok(found) = self.changed.binary_search_by_key(&i, |(place, _)| *place) {
            let value = self.changed[found].1;
            return std::array::from_fn(|i| value[i]);
        }
        self.items.as_ref().map_or([0.0; N], |items| self.part.read_all(items.get(i)))
    }
}
