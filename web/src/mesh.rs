//! Meshes.

use crate::{
    stress::case,
    values::{error, fields, floats},
};
use js_sys::{Float32Array, Float64Array, Uint32Array};
use raykd::{Ray, rays::random};
use wasm_bindgen::prelude::*;

/// A checked triangle mesh. If its coordinates lose digits where they are, it is moved by `translation`; rays and
/// pictures know only of where it is then.
#[wasm_bindgen]
#[derive(Clone, Debug)]
pub struct Mesh {
    pub(crate) mesh: raykd::Mesh,
    translation: [f64; 3],
}

impl From<raykd::Mesh> for Mesh {
    fn from(mesh: raykd::Mesh) -> Self {
        Self { translation: mesh.translation(), mesh: mesh.into_local() }
    }
}

/// Rays traced for a picture or a count are at most so many; their memory is that of the page.
const MOST_RAYS: u32 = 1 << 24;

#[wasm_bindgen]
impl Mesh {
    /// Three coordinates a vertex, three vertices a triangle.
    #[wasm_bindgen(constructor)]
    pub fn new(positions: &[f32], indices: &[u32]) -> Result<Self, JsError> {
        let (positions, rest) = positions.as_chunks();
        let (indices, more) = indices.as_chunks();
        if !rest.is_empty() || !more.is_empty() {
            return Err(error(
                "positions and indices: three numbers are wanted for each vertex and triangle",
            ));
        }
        Ok(raykd::Mesh::new(positions.to_vec(), indices.to_vec()).map_err(error)?.into())
    }

    /// From the bytes of an OBJ, PLY, STL or glTF file, gzipped or not. The name tells the format.
    pub fn load(bytes: Vec<u8>, name: &str) -> Result<Self, JsError> {
        Ok(raykd::Mesh::from_bytes(name, bytes).map_err(error)?.into())
    }

    /// The Utah teapot; each of its 32 patches has `level` by `level` quads.
    pub fn teapot(level: u32) -> Result<Self, JsError> {
        if !(1..=1000).contains(&level) {
            return Err(error(format!("a teapot's level is from 1 to 1000, not {level}")));
        }
        Ok(raykd::Mesh::teapot(level).into())
    }

    /// The mesh of a scene in which ray tracers fail; see `choices().stress`.
    pub fn stress(name: &str) -> Result<Self, JsError> {
        let part = case(name)?.parts(1).into_iter().next().ok_or_else(|| error("a scene without a mesh"))?;
        Ok(part.mesh.into())
    }

    /// Triangles, in the order of the file.
    #[wasm_bindgen(getter)]
    pub fn triangles(&self) -> u32 {
        self.mesh.triangles().len() as u32
    }

    /// Least and largest coordinates of what takes part: six numbers.
    #[wasm_bindgen(getter)]
    pub fn bounds(&self) -> Float32Array {
        let (lo, hi) = self.mesh.bounds();
        Float32Array::from([lo, hi].as_flattened())
    }

    /// What was subtracted from all coordinates.
    #[wasm_bindgen(getter)]
    pub fn translation(&self) -> Float64Array {
        Float64Array::from(self.translation.as_slice())
    }

    /// A copy of the coordinates.
    pub fn positions(&self) -> Float32Array {
        Float32Array::from(self.mesh.positions().as_flattened())
    }

    /// A copy of the triangles' vertices.
    pub fn indices(&self) -> Uint32Array {
        Uint32Array::from(self.mesh.triangles().as_flattened())
    }

    /// Rays from the sphere around the mesh into its box, the same everywhere for a seed.
    #[wasm_bindgen(js_name = randomRays, unchecked_return_type = "Rays")]
    pub fn random_rays(&self, count: u32, seed: u32) -> Result<JsValue, JsError> {
        if count > MOST_RAYS {
            return Err(error(format!("{count} rays are more than {MOST_RAYS}; trace them in parts")));
        }
        let rays = random(self.mesh.bounds(), count as usize, seed.into());
        Ok(of_rays(&rays))
    }
}

/// As arrays.
pub(crate) fn of_rays(rays: &[Ray]) -> JsValue {
    let flat = |number: fn(&Ray) -> [f32; 3]| {
        let all: Vec<[f32; 3]> = rays.iter().map(number).collect();
        floats(all.as_flattened(), |&x| x)
    };
    fields([("origins", flat(|ray| ray.origin)), ("directions", flat(|ray| ray.direction))])
}
