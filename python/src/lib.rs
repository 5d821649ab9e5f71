//! The compiled half of the Python package: meshes and scenes over arrays that `raykd/*.py` has made plain.
//!
//! Arrays come in as C-contiguous `float32` or `float64`. Rays are copied out of them with the interpreter's lock
//! held, which is released while rays are traced.

#![deny(unsafe_code)]

mod arrays;
mod device;
mod mesh;
mod picture;
mod plan;
mod scene;

use pyo3::{
    exceptions::{PyMemoryError, PyOSError, PyRuntimeError, PyValueError},
    prelude::*,
};
use raykd::{Error, TreeError, mesh::MeshError};
use std::io;

/// What Python calls such an error, with raykd's own sentence.
fn error(error: Error) -> PyErr {
    let mut text = error.to_string();
    if matches!(error, Error::Inexact { .. }) {
        text += "; to use it all the same, name it and set RAYKD_ALLOW_INEXACT=1";
    }
    if matches!(error, Error::Mesh(MeshError::TooLong { .. })) {
        text += " by max_bytes of Mesh.load";
    }
    if let Error::Tree { why, .. } = &error {
        // The functions that raykd's sentences name are Rust's.
        let own = match why {
            TreeError::NoSceneFile => "not a raykd scene file (write one by Scene.save)",
            TreeError::NoMesh => {
                "this is a tree's file, without its mesh; make a scene of the mesh, and save that"
            }
            _ => "",
        };
        if !own.is_empty() {
            text = text.replace(&why.to_string(), own);
        }
    }
    if matches!(error, Error::NoAdapter { wanted: Some(_) }) {
        text += " (raykd.devices() lists the devices there are)";
    }
    match error {
        Error::Io { source, .. }
        | Error::Mesh(MeshError::Read { source, .. } | MeshError::Buffer { source, .. }) => {
            // By its number Python chooses the kind, such as `FileNotFoundError`.
            match source.raw_os_error() {
                Some(number) => PyOSError::new_err((number, text)),
                None => io::Error::new(source.kind(), text).into(),
            }
        }
        Error::OutOfMemory { .. } | Error::TooLarge { .. } => PyMemoryError::new_err(text),
        Error::Threads(_)
        | Error::NoAdapter { .. }
        | Error::Inexact { .. }
        | Error::Lacking { .. }
        | Error::DeviceFailed { .. }
        | Error::Kernel(_)
        | Error::Wgpu(_) => PyRuntimeError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}

#[pymodule(gil_used = true)]
mod _raykd {
    #[pymodule_export]
    use super::{
        device::devices,
        mesh::Mesh,
        picture::{camera_rays, render},
        scene::{Scene, digest},
    };

    use pyo3::prelude::*;
    use raykd::{Builder, Intersector, Traversal, internals::picture::Shading};

    fn names<T: Copy>(all: &[T], name: fn(T) -> &'static str) -> Vec<&'static str> {
        all.iter().copied().map(name).collect()
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("MISS", raykd::shared::MISS)?;
        module.add("BUILDERS", names(Builder::ALL, Builder::name))?;
        module.add("TRAVERSALS", names(Traversal::ALL, Traversal::name))?;
        module.add("TESTS", names(Intersector::ALL, Intersector::name))?;
        module.add("SHADINGS", names(Shading::ALL, Shading::name))
    }
}
