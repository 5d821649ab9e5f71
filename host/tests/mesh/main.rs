//! Meshes: files, the rules of what takes part, the scenes that have names, polygons, and meshes far from the origin.

mod files;
#[cfg(feature = "gltf")]
mod formats;
mod moved;
mod polygons;
mod rules;
mod scenes;

use flate2::{Compression, write::GzEncoder};
use raykd::mesh::{Mesh, MeshError};
use std::{io::Write as _, path::Path};

fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, MeshError> {
    Mesh::from_bytes(Path::new(name), bytes.as_ref().to_vec())
}

/// The message of the error that reading gives.
fn refusal(name: &str, bytes: impl AsRef<[u8]>) -> String {
    read(name, bytes).expect_err("this file should be refused").to_string()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// The corners of every triangle, in order: what a mesh is whatever its vertices are numbered like.
fn corners(mesh: &Mesh) -> Vec<[[f64; 3]; 3]> {
    mesh.triangles().iter().map(|t| t.map(|v| mesh.vertex(v))).collect()
}

const A: [f64; 3] = [0.0, 0.0, 0.0];
const B: [f64; 3] = [1.0, 0.0, 0.0];
const C: [f64; 3] = [1.0, 1.0, 0.5];
const D: [f64; 3] = [0.0, 1.0, 0.25];

/// Whether it is the square that samples of all formats hold.
fn is_the_quad(mesh: &Mesh) {
    assert_eq!(corners(mesh), [[A, B, C], [A, C, D]]);
    assert_eq!(mesh.kept(), [0, 1]);
}
