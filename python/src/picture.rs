//! Pictures, as the program draws them.

use crate::{device::same_process, error, scene::Scene};
use numpy::{PyArray1, PyArray3, PyArrayMethods as _};
use pyo3::{exceptions::PyValueError, prelude::*};
use raykd::{
    Error, Mesh,
    internals::{
        picture::{self, Shading},
        reserve,
    },
    rays::Camera,
};

/// Pixels along a side, and samples along a pixel's, as for the program.
const MOST_PIXELS: u32 = 16384;
const MOST_SAMPLES: u32 = 8;

/// Width, height; eye and target, if given; up; and the angle of view from bottom to top, in degrees.
#[derive(FromPyObject)]
pub(crate) struct View(u32, u32, Option<[f64; 3]>, Option<[f64; 3]>, [f64; 3], f64);

impl View {
    /// The camera where the mesh was moved to: by how much, and the mesh there.
    fn camera(&self, moved: [f64; 3], mesh: &Mesh) -> PyResult<Camera> {
        let &Self(width, height, eye, target, up, fov) = self;
        within("width and height", width.min(height), 1, MOST_PIXELS)?;
        within("width and height", width.max(height), 1, MOST_PIXELS)?;
        within("fov", fov, 0.1, 170.0)?;
        let local = |point: [f64; 3]| [0, 1, 2].map(|axis| point[axis] - moved[axis]);
        let ends = [eye, target].map(|end| end.map(local));
        let camera = picture::camera(mesh, f64::from(width) / f64::from(height), ends, up, fov);
        if camera.eye == camera.target {
            return Err(PyValueError::new_err("eye and target are the same point; move one of them"));
        }
        Ok(camera)
    }
}

/// Why a picture was not finished.
enum Ended {
    Failed(Error),
    /// What Python's handler raised, as on Ctrl-C.
    Signal(PyErr),
}

impl From<Error> for Ended {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}

/// Refuses a number that is not in a range.
fn within<T: PartialOrd + std::fmt::Display>(what: &str, number: T, least: T, most: T) -> PyResult<()> {
    if (&least..=&most).contains(&&number) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{what} must be from {least} to {most}, but {number} is given")))
}

/// Where the camera is, and the directions of rays through pixel centres, three numbers each.
#[pyfunction]
pub(crate) fn camera_rays<'py>(
    py: Python<'py>,
    scene: &Scene,
    view: View,
) -> PyResult<([f64; 3], Bound<'py, PyArray1<f32>>)> {
    let mesh = scene.shared_mesh(py)?;
    let moved = mesh.translation();
    let camera = view.camera(moved, &mesh.local())?;
    let (width, height) = (view.0, view.1);
    let mut directions: Vec<f32> = Vec::new();
    reserve(&mut directions, "directions", 3 * u64::from(width) * u64::from(height)).map_err(error)?;
    py.detach(|| {
        for row in 0..height {
            directions.extend(camera.rows(width, height, row..row + 1).iter().flat_map(|ray| ray.direction));
        }
    });
    let eye = [0, 1, 2].map(|axis| camera.eye[axis] + moved[axis]);
    Ok((eye, PyArray1::from_vec(py, directions)))
}

/// Red, green and blue of each pixel.
#[pyfunction]
pub(crate) fn render<'py>(
    py: Python<'py>,
    scene: &Scene,
    view: View,
    shading: &str,
    samples: Option<u32>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    same_process()?;
    let shading: Shading = shading.parse().map_err(error)?;
    let samples = samples.unwrap_or_else(|| picture::samples_of(shading));
    within("samples", samples, 1, MOST_SAMPLES)?;
    let mesh = scene.shared_mesh(py)?;
    let (local, size) = (mesh.local(), [view.0, view.1]);
    let camera = view.camera(mesh.translation(), &local)?;
    let scene = scene.scene.clone().into_local();
    let signals = || Python::attach(|py| py.check_signals()).map_err(Ended::Signal);
    let drawn = py
        .detach(|| picture::render_while(&scene, &local, &camera, size, samples, shading, signals))
        .map_err(|ended| match ended {
            Ended::Failed(failed) => error(failed),
            Ended::Signal(signal) => signal,
        })?;
    PyArray1::from_vec(py, drawn.rgb).reshape([size[1] as usize, size[0] as usize, 3])
}
