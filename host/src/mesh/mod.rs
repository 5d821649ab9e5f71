//! Meshes: from files, from the built-in scenes, or handed over as vertices and indices.
//!
//! # Which triangles take part
//! Triangles are numbered in file order, before anything else happens to them, and keep that number.
//!
//! - **Polygons** are cut into triangles, and counted: one of n corners takes n - 2 numbers. Where the fan from the
//!   first corner covers it, it is that fan, as always if it is convex; a concave one is cut so that no ray beside it
//!   hits, and counted. One whose edges cross, or that a corner touches from outside, stays a fan; that, and one thicker
//!   than a thousandth of its extent, so that nothing says what surface it is, is counted and named. All of that is
//!   decided where the axis looks from which most of the face is seen. A face with fewer than three corners is an
//!   error. Points, lines and curves are ignored, and counted.
//! - **Zero-area** triangles, whose corners lie exactly on one line or coincide, are kept out of the tree, and
//!   counted. The test is exact, not a threshold.
//! - **Duplicates**, with the same three positions in the same order as an earlier triangle, stay in the tree,
//!   and are counted; of equal hits the lowest number wins.
//! - **Dust**: coordinates that are smaller in size than 2⁻⁶⁰ of the mesh's largest extent (rounded down to a
//!   power of two) are 0 for the kernels, and counted. They are there because somebody's arithmetic left
//!   them, and a GPU may or may not flush them. A triangle without area after that counts as zero-area.
//! - **Errors**: coordinates that are not finite, indices out of range, damaged, truncated or empty files, a
//!   mesh without faces. Each names file and line or element. A mesh whose triangles all have no area is fine:
//!   its tree is empty.
//!
//! # Scale
//! Kernels compute in 32-bit floats. If the largest extent of the triangles that take part lies outside
//! 2⁻¹⁰ to 2²⁰, they get coordinates multiplied with a power of two ([`Mesh::scale`]) that brings it into
//! 1 to 2, exactly: no digit is lost or gained. At the far ends of the range of `f32` the multiplier stays a
//! normal number: extents from 2¹²⁷ end below 8, subnormal ones down to 2⁻¹³⁷ end above 2⁻¹⁰, and smaller ones
//! are an error.

mod error;
mod load;
mod obj;
mod ply;
mod polygon;
mod repair;
mod scenes;
mod teapot;

pub use error::{MeshError, Place, Spot};
pub use repair::Repairs;
pub use scenes::{Scene, folder as scenes_folder, scene};
pub use teapot::teapot_level_for;

use load::Raw;
use raykd_shared::limits::MAX_TRIANGLES;
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
}

impl Mesh {
    /// A mesh of vertices and triangles, each three indices of vertices.
    ///
    /// # Errors
    /// If a coordinate is not finite, an index is out of range, there is no triangle or there are more than
    /// [`MAX_TRIANGLES`], or all of them together are smaller than 2⁻¹³⁷.
    pub fn new(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        Self::with_repairs(Raw { positions, triangles, ..Raw::default() })
    }

    fn with_repairs(Raw { positions, triangles, mut repairs, .. }: Raw) -> Result<Self, MeshError> {
        if triangles.is_empty() {
            return Err(MeshError::NoFaces { at: Place::default() });
        }
        if triangles.len() > MAX_TRIANGLES as usize {
            return Err(MeshError::TooManyTriangles { at: Place::default(), limit: MAX_TRIANGLES });
        }
        if let Some(i) = positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            let value = positions[i].iter().find(|x| !x.is_finite()).map(f32::to_string).unwrap_or_default();
            return Err(MeshError::NonFinite { at: Place::element("vertex", i as u64), value });
        }
        let vertices = positions.len() as u64;
        let outside = |t: &[u32; 3]| t.iter().copied().find(|&v| u64::from(v) >= vertices);
        if let Some((i, index)) = triangles.iter().enumerate().find_map(|(i, t)| Some((i, outside(t)?))) {
            let at = Place::element("triangle", i as u64);
            return Err(MeshError::IndexOutOfRange { at, index: index.into(), first: 0, vertices });
        }

        let repair::Survey { kept, bounds, scale, dust } = repair::survey(&positions, &triangles)?;
        repairs.zero_area = (triangles.len() - kept.len()) as u32;
        repairs.duplicates = repair::count_duplicates(&positions, &triangles, &kept);
        let flushed =
            positions.as_flattened().iter().filter(|&&x| x != 0.0 && repair::settle(x, dust) == 0.0);
        repairs.flushed = flushed.count().try_into().unwrap_or(u32::MAX);
        Ok(Self { positions, triangles, kept, repairs, bounds, scale, dust })
    }

    /// Reads an OBJ or PLY file, either of them also gzipped. The format is told by the extension (`.obj`,
    /// `.ply`, `.obj.gz`, `.ply.gz`), or else by the first bytes.
    ///
    /// No more than [`usual_max_bytes`](crate::usual_max_bytes) are read, after unpacking too; of a gzipped file
    /// no more than a hundred times its size, or 256 MiB if that is more.
    ///
    /// # Errors
    /// If the file cannot be read or used, or is larger than that; the message names the line or element.
    pub fn load(path: &Path) -> Result<Self, MeshError> {
        load::load(path, None)
    }

    /// Like [`Mesh::load`], but so many bytes are read, packed or unpacked, before it is an error.
    ///
    /// # Errors
    /// If the file cannot be read or used, or is larger.
    pub fn load_up_to(path: &Path, max_bytes: u64) -> Result<Self, MeshError> {
        load::load(path, Some(max_bytes))
    }

    /// Like [`Mesh::load`], of a file that is in memory already. The path serves to tell the format, and in
    /// messages.
    ///
    /// # Errors
    /// If the bytes cannot be used.
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, MeshError> {
        load::from_bytes(path, bytes, None)
    }

    /// The Utah teapot, each of its 32 patches cut into `level` by `level` quads of two triangles (1 to 1000).
    /// It is about 32 x 16 x 20 large, y up, around the origin; its poles hold `8 * level` zero-area triangles, and
    /// at level 1 there are four more.
    pub fn teapot(level: u32) -> Self {
        let (positions, triangles) = teapot::tessellate(level);
        Self::new(positions, triangles).expect("the teapot is a valid mesh at every level")
    }

    /// Vertices as they were given.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
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
    /// unscaled; zeros if there are none.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        self.bounds
    }

    /// The power of two that positions are multiplied with for the kernels, mostly 1.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// [`Mesh::bounds`] times [`Mesh::scale`]: the box the kernels see.
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

    /// One coordinate for the kernels.
    fn scaled(&self, x: f32) -> f32 {
        // By way of f64, where neither subnormal nor large factors are special.
        let x = f64::from(repair::settle(x, self.dust)) * f64::from(self.scale);
        if x.abs() <= f64::from(f32::MAX) { x as f32 } else { 0.0 }
    }
}
