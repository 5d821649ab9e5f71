//! `quality="auto"`: device, builder and traversal by what a scene and a number of rays need.

use crate::{device::device, error};
use pyo3::{exceptions::PyUserWarning, prelude::*};
use raykd::{
    Device, DeviceKind, Mesh,
    plan::{Calibration, Plan, choose_tree, create_cache_file},
};
use std::{
    ffi::CString,
    path::{Path, PathBuf},
};

/// The device to use, and how to build and trace there. There is a tree, as scenes answer all queries.
pub(crate) fn plan(
    py: Python<'_>,
    mesh: &Mesh,
    wish: (&str, Option<usize>),
    rays: u64,
    file: Option<PathBuf>,
) -> PyResult<(Device, Plan)> {
    let mut devices = candidates(py, wish)?;
    let costs: Vec<Calibration> =
        devices.iter().map(|device| costs(py, device, file.as_deref())).collect::<PyResult<_>>()?;
    let plan = py.detach(|| choose_tree(mesh, rays, &costs.iter().collect::<Vec<_>>()));
    Ok((devices.swap_remove(plan.calibration), plan))
}

/// The device that was asked for; if none was, the CPU and, if there is one, a real GPU.
fn candidates(py: Python<'_>, wish: (&str, Option<usize>)) -> PyResult<Vec<Device>> {
    if wish != ("auto", None) {
        return Ok(vec![device(py, wish.0, wish.1)?]);
    }
    let best = device(py, "auto", None)?;
    if best.kind() == DeviceKind::Cpu { Ok(vec![best]) } else { Ok(vec![device(py, "cpu", None)?, best]) }
}

/// The costs of a device: from the file given, or the cache, or measured now and kept there.
fn costs(py: Python<'_>, device: &Device, file: Option<&Path>) -> PyResult<Calibration> {
    if let Some(path) = file {
        return Calibration::load(path, device).map_err(error);
    }
    match Calibration::from_cache(device) {
        Some(Ok(found)) => return Ok(found),
        Some(Err(error)) => warn(py, &format!("{error}; `raykd calibrate` measures anew"))?,
        None => {}
    }
    let place = create_cache_file(device);
    let kind = device.kind().name().to_uppercase();
    warn(
        py,
        &format!("measuring what trees cost on this {kind}, which takes about a minute; later it is known"),
    )?;
    let measured = py.detach(|| Calibration::measure(device, |_| ())).map_err(error)?;
    if let Err(error) = place.and_then(|path| measured.save(&path)) {
        warn(py, &format!("costs could not be kept: {error}"))?;
    }
    Ok(measured)
}

/// Warns whoever called `raykd.Scene`.
fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    let text = CString::new(text.replace('\0', " "))?;
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 2)
}
