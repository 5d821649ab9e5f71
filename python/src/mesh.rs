//! Meshes.

use crate::{
    arrays::{Threes, copied},
    device::same_process,
    error,
};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::{prelude::*, types::PyDict};
use raykd::{Error, mesh::MeshSource};
use std::{path::PathBuf, sync::Arc};

/// A checked triangle mesh.
#[pyclass(frozen, module = "raykd._raykd")]
#[derive(Debug)]
pub(crate) struct Mesh(pub(crate) Arc<raykd::Mesh>);

impl Mesh {
    fn of(mesh: Result<raykd::Mesh, raykd::mesh::MeshError>) -> PyResult<Self> {
        mesh.map(|mesh| Self(Arc::new(mesh))).map_err(|e| error(Error::from(e)))
    }
}

#[pymethods]
impl Mesh {
    #[new]
    fn new(py: Python<'_>, vertices: &Bound<'_, PyAny>, faces: PyReadonlyArray2<'_, u32>) -> PyResult<Self> {
        same_process()?;
        let vertices: Threes<'_> = vertices.extract()?;
        let faces = copied(&faces, "faces")?;
        match vertices {
            Threes::Narrow(vertices) => {
                let vertices = copied(&vertices, "vertices")?;
                Self::of(py.detach(|| raykd::Mesh::new(vertices, faces)))
            }
            Threes::Wide(vertices) => {
                let vertices = copied(&vertices, "vertices")?;
                Self::of(py.detach(|| raykd::Mesh::from_f64(vertices, faces)))
            }
        }
    }

    /// The mesh of these positions, moved by what they lack.
    #[staticmethod]
    fn moved(
        py: Python<'_>,
        positions: PyReadonlyArray2<'_, f32>,
        faces: PyReadonlyArray2<'_, u32>,
        translation: [f64; 3],
    ) -> PyResult<Self> {
        same_process()?;
        let (positions, faces) = (copied(&positions, "positions")?, copied(&faces, "faces")?);
        Self::of(py.detach(|| Ok(raykd::Mesh::new(positions, faces)?.moved(translation))))
    }

    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, max_bytes: Option<u64>) -> PyResult<Self> {
        same_process()?;
        Self::of(py.detach(|| match max_bytes {
            None => raykd::Mesh::load(&path),
            Some(most) => raykd::Mesh::load_up_to(&path, most),
        }))
    }

    #[staticmethod]
    fn scene(py: Python<'_>, name: &str) -> PyResult<Self> {
        same_process()?;
        Self::of(py.detach(|| name.parse::<MeshSource>()?.load()))
    }

    fn __len__(&self) -> usize {
        self.0.triangles().len()
    }

    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let count = self.0.positions().len() as u32;
        let vertices: Vec<f64> = (0..count).flat_map(|i| self.0.vertex(i)).collect();
        square(PyArray1::from_vec(py, vertices))
    }

    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        square(PyArray1::from_slice(py, self.0.positions().as_flattened()))
    }

    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        square(PyArray1::from_slice(py, self.0.triangles().as_flattened()))
    }

    #[getter]
    fn translation(&self) -> [f64; 3] {
        self.0.translation()
    }

    #[getter]
    fn bounds(&self) -> [[f64; 3]; 2] {
        // Where the mesh was moved to, with all digits; `Mesh::bounds` of a mesh that was moved are rounded to `f32`.
        let ((lo, hi), scale, moved) = (self.0.scaled_bounds(), self.0.scale(), self.0.translation());
        [lo, hi].map(|corner| [0, 1, 2].map(|axis| f64::from(corner[axis]) / f64::from(scale) + moved[axis]))
    }

    fn is_closed(&self, py: Python<'_>) -> PyResult<bool> {
        same_process()?;
        Ok(py.detach(|| self.0.edges().are_closed()))
    }

    fn repairs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let repairs = self.0.repairs();
        let told = PyDict::new(py);
        for (name, count) in [
            ("zero_area", repairs.zero_area),
            ("duplicates", repairs.duplicates),
            ("flushed", repairs.flushed),
            ("rounded", repairs.rounded),
            ("collapsed", repairs.collapsed),
        ] {
            told.set_item(name, count)?;
        }
        told.set_item("largest_change", repairs.largest_change)?;
        Ok(told)
    }
}

/// Rows of three.
fn square<T: numpy::Element>(flat: Bound<'_, PyArray1<T>>) -> PyResult<Bound<'_, PyArray2<T>>> {
    use numpy::{PyArrayMethods as _, PyUntypedArrayMethods as _};
    let rows = flat.len() / 3;
    flat.reshape([rows, 3])
}
