//! Meshes: from files, from the built-in scenes, or handed over as vertices and indices.
//!
//! # Which triangles take part
//! Triangles are numbered in file order, before anything else happens to them, and keep that number.
//!
//! - **Polygons** of n corners become n - 2 triangles, and are counted: the fan from the first corner if that covers
//!   the polygon, as it does any convex one, else a triangulation inside it, counted as concave. If its edges cross or
//!   a corner touches it from outside, it stays a fan, counted as crossed. If it is thicker than a thousandth of its
//!   extent, it is counted as bent. All of that is decided in the projection along the axis from which most of it is
//!   seen. A face with fewer than three corners is an error. Points, lines and curves are ignored, and counted.
//! - **Zero-area** triangles, whose corners lie exactly on one line or coincide, are kept out of the tree, and
//!   counted. The test is exact, not a threshold.
//! - **Duplicates**, with the same three positions in the same order as an earlier triangle, stay in the tree,
//!   and are counted; of equal hits the lowest number wins.
//! - **Dust**: coordinates that are smaller in size than 2⁻⁶⁰ of the mesh's largest extent (rounded down to a
//!   power of two) are 0 for the kernels, and counted: they are residues of rounding, and a GPU may or may not flush
//!   them. A triangle without area after that counts as zero-area. One that has area only after that takes part if
//!   triangles with area have such coordinates, too, and the mesh does not get so large by it that more would be dust.
//! - **Errors**: coordinates that are not finite, indices out of range, damaged, truncated or empty files, a
//!   mesh without faces. Each names file and line or element. A mesh whose triangles all have no area is fine:
//!   its tree is empty.
//!
//! # Formats
//! Only positions are kept. To look up what else a file says of a point that was hit, take its triangle's corners `a`,
//! `b` and `c` in the order of the file: normals, texture coordinates and colours there have the weights `1 - u - v`,
//! `u` and `v`. Triangles are numbered
//!
//! - in **OBJ** and **PLY** in the order of the faces, a polygon's triangles one after the other;
//! - in **STL** in the order of the facets; vertices are not joined: corner `k` of triangle `i` is vertex `3 i + k`;
//! - in **glTF** (with the feature `gltf`) node by node of the default scene, or else the first one, or else all nodes:
//!   a node's mesh before its children, primitives in the order of their list. Nodes' transforms are applied in `f64`.
//!   Strips and fans are cut into triangles, points and lines ignored. Skins and morph targets are not applied, but
//!   counted. `KHR_mesh_quantization` is understood; other extensions that a file requires, or that hold or multiply
//!   its triangles, are refused by name.
//!
//! # Numbers
//! Positions are read as `f64` and rounded to `f32`. If some coordinate is not an `f32`, and larger than eight times
//! the mesh's largest extent, the mesh is moved first: on each axis where that is so, the middle of its box, rounded
//! to few binary digits, is subtracted from all coordinates ([`Mesh::translation`]). Triangles without area have no
//! part in the box. Rays are given in the mesh's own coordinates and moved in the same way, in `f64`, before they are
//! rounded ([`Ray64`](crate::Ray64)); hits have nothing that could be moved. [`Repairs`] tells how many coordinates
//! were rounded, by how much at most, and how many triangles lost their area by that. In a tree and its file the mesh
//! is where it was moved to.
//!
//! # Scale
//! Kernels compute in 32-bit floats. If the largest extent of the triangles that take part lies outside
//! 2⁻¹⁰ to 2²⁰, they get coordinates multiplied with a power of two ([`Mesh::scale`]) that brings it into
//! 1 to 2, exactly: no digit is lost or gained. At the far ends of the range of `f32` the multiplier stays a
//! normal number: extents from 2¹²⁷ end below 8, subnormal ones down to 2⁻¹³⁷ end above 2⁻¹⁰, and smaller ones
//! are an error.

mod digest;
mod edges;
mod error;
mod fetched;
mod formats;
mod load;
mod polygon;
mod raw;
mod repair;
mod rounding;
mod scenes;
mod teapot;

pub(crate) use digest::digest;
pub use edges::{EdgeCount, Edges};
pub(crate) use edges::{edges, places};
pub(crate) use error::check_triangles;
pub use error::{MeshError, Place, Spot};
#[cfg(feature = "gltf")]
pub use formats::files_beside;
#[doc(hidden)]
pub use formats::{extensions as mesh_extensions, known as known_formats, ply_vertices};
pub(crate) use repair::Measure;
pub use repair::Repairs;
pub use scenes::MeshSource;
#[cfg(feature = "plan")]
pub(crate) use scenes::of_user;
#[doc(hidden)]
pub use teapot::teapot_level_for;

use crate::vector::below;
use raw::{Raw, fits};
use raykd_shared::TreeHeader;
use std::borrow::Cow;
use std::path::Path;

/// A triangle mesh that has been checked.
#[derive(Clone, Debug)]
pub struct Mesh {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    kept: Vec<u32>,
    repairs: Repairs,
    bounds: ([f32; 3], [f32; 3]),
    scale: f32,
    /// Coordinates of smaller magnitude are 0 for the kernels.
    dust: f64,
    /// The mesh's own coordinates less `positions`.
    translation: [f64; 3],
}

impl Mesh {
    /// A mesh of vertices and triangles, each three indices of vertices.
    ///
    /// # Errors
    /// If a coordinate is not finite, an index is out of range, there is no triangle or there are more than
    /// [`MAX_TRIANGLES`](raykd_shared::limits::MAX_TRIANGLES), or all of them together are smaller than 2⁻¹³⁷.
    pub fn new(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        check(&positions, &triangles)?;
        Self::checked(positions, triangles, Repairs::default(), [0.0; 3])
    }

    /// The same of vertices in `f64`. They are rounded to `f32`, after the mesh was moved if that saves digits: see
    /// [the module](crate::mesh). [`Mesh::repairs`] tells what rounding changed.
    ///
    /// # Errors
    /// Those of [`Mesh::new`]; a coordinate must be finite in `f32` too.
    pub fn from_f64(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        Self::with_repairs(Raw { positions, triangles, ..Raw::default() })
    }

    fn with_repairs(Raw { positions: given, triangles, mut repairs, .. }: Raw) -> Result<Self, MeshError> {
        check(&given, &triangles)?;
        let rounding::Rounded { positions, translation, coordinates, largest_change } =
            rounding::round(&given, &triangles);
        (repairs.rounded, repairs.largest_change) = (coordinates, largest_change);
        let mut mesh = Self::checked(positions, triangles, repairs, translation)?;
        if coordinates > 0 {
            mesh.repairs.collapsed = mesh.collapsed(&given);
        }
        Ok(mesh)
    }

    /// How many triangles have area in the positions given, but none as they were rounded.
    fn collapsed(&self, given: &[[f64; 3]]) -> u32 {
        let mut kept = self.kept.iter().copied().peekable();
        let left_out = (0..self.triangles.len() as u32).filter(|t| kept.next_if_eq(t).is_none());
        let corners = |t: u32| self.triangles[t as usize];
        let lost = left_out.filter(|&t| {
            !repair::has_area(corners(t).map(|v| self.positions[v as usize]))
                && repair::has_area(corners(t).map(|v| given[v as usize]))
        });
        lost.count() as u32
    }

    /// The mesh of a scene, of positions without dust. Which triangles take part is known: of one without area a corner
    /// may be 0 that was not, so that it has area now.
    pub(crate) fn of_scene(
        positions: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        kept: Vec<u32>,
        header: &TreeHeader,
    ) -> Result<Self, MeshError> {
        check(&positions, &triangles)?;
        let larger = 1.0 / header.scale;
        let bounds = (header.lo.map(|x| x * larger), header.hi.map(|x| x * larger));
        let survey = repair::Survey { kept, bounds, scale: header.scale, dust: 0.0 };
        Ok(Self::surveyed(positions, triangles, survey, Repairs::default(), [0.0; 3]))
    }

    fn checked(
        positions: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        repairs: Repairs,
        translation: [f64; 3],
    ) -> Result<Self, MeshError> {
        let survey = repair::survey(&positions, &triangles)?;
        Ok(Self::surveyed(positions, triangles, survey, repairs, translation))
    }

    fn surveyed(
        positions: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        survey: repair::Survey,
        mut repairs: Repairs,
        translation: [f64; 3],
    ) -> Self {
        let repair::Survey { kept, bounds, scale, dust } = survey;
        repairs.zero_area = (triangles.len() - kept.len()) as u32;
        repairs.zero_area_at = repair::first_left_out(triangles.len(), &kept);
        (repairs.duplicates, repairs.duplicate_at) = repair::duplicates(&positions, &triangles, &kept);
        let flushed =
            positions.as_flattened().iter().filter(|&&x| x != 0.0 && repair::settle(x, dust) == 0.0);
        repairs.flushed = flushed.count().try_into().unwrap_or(u32::MAX);
        Self { positions, triangles, kept, repairs, bounds, scale, dust, translation }
    }

    /// Reads an OBJ, PLY, STL or glTF file, each of them also gzipped. The format is told by the extension (`.obj`,
    /// `.ply`, `.stl`, `.gltf`, `.glb`, each also with `.gz`), or else by the first bytes. Buffers of a glTF file may
    /// be files beside it, or in folders there.
    ///
    /// No more than [`default_max_bytes`](crate::default_max_bytes) are read, after unpacking too; of a gzipped file
    /// no more than a hundred times its size, or 256 MiB if that is more.
    ///
    /// # Errors
    /// If the file cannot be read or used, or is larger than that; the message names the line or element.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, MeshError> {
        Self::load_at_most(path.as_ref(), None)
    }

    /// Like [`Mesh::load`], but so many bytes are read, packed or unpacked, before it is an error.
    ///
    /// # Errors
    /// If the file cannot be read or used, or is larger.
    pub fn load_up_to(path: impl AsRef<Path>, max_bytes: u64) -> Result<Self, MeshError> {
        Self::load_at_most(path.as_ref(), Some(max_bytes))
    }

    fn load_at_most(path: &Path, most: Option<u64>) -> Result<Self, MeshError> {
        load::load(path, most).and_then(Self::with_repairs).map_err(|e| e.in_file(path))
    }

    /// Like [`Mesh::load`], of a file that is in memory already. Its name tells the format, by the extension, and is
    /// named in errors; it is not opened, nor is any other file.
    ///
    /// # Errors
    /// If the bytes cannot be used.
    pub fn from_bytes(name: impl AsRef<Path>, bytes: Vec<u8>) -> Result<Self, MeshError> {
        let name = name.as_ref();
        load::parse(name, bytes, None, None).and_then(Self::with_repairs).map_err(|e| e.in_file(name))
    }

    /// The Utah teapot, each of its 32 patches cut into `level` by `level` quads of two triangles: from 1
    /// to 1000, and other levels count as the nearest of these.
    /// It is about 32 x 16 x 20 large, y up, around the origin; its poles hold `8 * level` zero-area triangles, and
    /// at level 1 there are four more.
    pub fn teapot(level: u32) -> Self {
        let (positions, triangles) = teapot::tessellate(level);
        Self::new(positions, triangles).expect("the teapot is a valid mesh at every level")
    }

    /// Vertices as they were given, less [`Mesh::translation`], rounded to `f32`.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// What [`Mesh::positions`] lack of the mesh's own coordinates: zeros, unless the mesh was moved to save digits
    /// (see [the module](crate::mesh)).
    pub fn translation(&self) -> [f64; 3] {
        self.translation
    }

    /// A vertex in the mesh's own coordinates, as far as rounding left them: its position and [`Mesh::translation`].
    ///
    /// # Panics
    /// There is no such vertex.
    pub fn vertex(&self, number: u32) -> [f64; 3] {
        let position = self.positions[number as usize];
        [0, 1, 2].map(|a| f64::from(position[a]) + self.translation[a])
    }

    /// The mesh with its positions taken for coordinates less a translation.
    #[doc(hidden)]
    #[must_use]
    pub fn moved(self, translation: [f64; 3]) -> Self {
        Self { translation, ..self }
    }

    /// The mesh with its positions taken for its own coordinates: its translation is forgotten.
    #[must_use]
    pub fn into_local(self) -> Self {
        self.moved([0.0; 3])
    }

    /// The same, or this mesh if it was not moved.
    #[doc(hidden)]
    pub fn local(&self) -> Cow<'_, Self> {
        if self.translation == [0.0; 3] { Cow::Borrowed(self) } else { Cow::Owned(self.clone().into_local()) }
    }

    /// All triangles in file order, zero-area ones included.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Numbers of the triangles that enter the tree, ascending.
    pub fn kept(&self) -> &[u32] {
        &self.kept
    }

    /// What was set aside or changed.
    pub fn repairs(&self) -> &Repairs {
        &self.repairs
    }

    /// Lower and upper corner of the box around the triangles that take part, as the kernels see them but
    /// unscaled; zeros if there are none. In the mesh's own coordinates: of a mesh that was moved, rounded outward.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let (lo, hi) = self.bounds;
        let moved = |p: [f32; 3], axis: usize| f64::from(p[axis]) + self.translation[axis];
        let lo = [0, 1, 2].map(|a| below(moved(lo, a)));
        (lo, [0, 1, 2].map(|a| -below(-moved(hi, a))))
    }

    /// The power of two that positions are multiplied with for the kernels, mostly 1.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// The box the kernels see: that of [`Mesh::bounds`], less [`Mesh::translation`], times [`Mesh::scale`]: `lo` and
    /// `hi` of its trees' headers.
    #[doc(hidden)]
    pub fn scaled_bounds(&self) -> ([f32; 3], [f32; 3]) {
        let scaled = |corner: [f32; 3]| corner.map(|x| self.scaled(x));
        (scaled(self.bounds.0), scaled(self.bounds.1))
    }

    /// Coordinates for the kernels, x y z of one vertex after the other: no dust, no -0, times
    /// [`Mesh::scale`]. Exact and finite for every vertex of a triangle in [`Mesh::kept`]; where the scaled
    /// coordinate of another vertex does not fit an `f32`, it is 0.
    pub fn scaled_positions(&self) -> Cow<'_, [f32]> {
        let given = self.positions.as_flattened();
        let unchanged = self.scale == 1.0 && given.iter().all(|x| self.scaled(*x).to_bits() == x.to_bits());
        if unchanged { given.into() } else { given.iter().map(|&x| self.scaled(x)).collect() }
    }

    /// Two words that differ for meshes whose trees do, but for one case in 2^64: see
    /// [`TreeHeader::mesh`](raykd_shared::TreeHeader::mesh).
    pub fn tree_key(&self) -> [u32; 2] {
        digest(&self.scaled_positions(), &self.triangles, &self.kept)
    }

    /// One coordinate for the kernels.
    fn scaled(&self, x: f32) -> f32 {
        repair::scaled(x, self.dust, self.scale)
    }
}

/// Makes sure of what the rest relies on: finite numbers in the range of `f32`, and indices of vertices that are there.
fn check<T: Copy + Into<f64>>(positions: &[[T; 3]], triangles: &[[u32; 3]]) -> Result<(), MeshError> {
    if triangles.is_empty() {
        return Err(MeshError::NoFaces { at: Place::default() });
    }
    check_triangles(triangles.len() as u64)?;
    let bad = |p: &[T; 3]| p.iter().map(|&x| x.into()).find(|&x| !fits(x));
    if let Some((i, x)) = positions.iter().enumerate().find_map(|(i, p)| Some((i, bad(p)?))) {
        return Err(MeshError::NonFinite { at: Place::element("vertex", i as u64), value: format!("{x:?}") });
    }
    let vertices = positions.len() as u64;
    let outside = |t: &[u32; 3]| t.iter().copied().find(|&v| u64::from(v) >= vertices);
    if let Some((i, index)) = triangles.iter().enumerate().find_map(|(i, t)| Some((i, outside(t)?))) {
        let at = Place::element("triangle", i as u64);
        return Err(MeshError::IndexOutOfRange { at, index: index.into(), first: 0, vertices });
    }
    Ok(())
}
