//! Devices by name.

use crate::error;
use pyo3::{
    exceptions::{PyRuntimeError, PyValueError},
    prelude::*,
    types::PyDict,
};
use raykd::Device;
use std::{
    collections::HashMap,
    sync::{Mutex, OnceLock, PoisonError},
};

/// Refuses to go on in a process that was forked off one that has used raykd: its threads are not there.
pub(crate) fn same_process() -> PyResult<()> {
    static FIRST: OnceLock<u32> = OnceLock::new();
    let this = std::process::id();
    if *FIRST.get_or_init(|| this) == this {
        return Ok(());
    }
    Err(PyRuntimeError::new_err(
        "this process was forked from one that had used raykd, whose threads are not here; start processes afresh, \
         by multiprocessing.get_context(\"spawn\"), or use raykd in the forked ones only",
    ))
}

/// The device of that name: `auto`, `cpu`, `gpu`, `gpu:` and its number, or a part of an adapter's name. Each is opened
/// once.
pub(crate) fn device(py: Python<'_>, name: &str, threads: Option<usize>) -> PyResult<Device> {
    type Opened = Mutex<HashMap<(String, Option<usize>), Device>>;
    static OPENED: OnceLock<Opened> = OnceLock::new();
    same_process()?;
    // Every adapter's name has this in it.
    if name.is_empty() {
        return Err(PyValueError::new_err(
            "the device's name is empty; raykd.devices() lists the devices there are",
        ));
    }
    if threads.is_some() && !matches!(name, "cpu" | "auto") {
        return Err(PyValueError::new_err(
            "threads are those of the CPU; leave them out, or say device=\"cpu\"",
        ));
    }
    let opened = OPENED.get_or_init(Opened::default);
    let key = (name.to_owned(), threads);
    py.detach(|| {
        let mut opened = opened.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(device) = opened.get(&key) {
            return Ok(device.clone());
        }
        let device = open(name, threads)?;
        opened.insert(key, device.clone());
        Ok(device)
    })
    .map_err(error)
}

fn open(name: &str, threads: Option<usize>) -> Result<Device, raykd::Error> {
    match (name, threads) {
        ("cpu" | "auto", Some(threads)) => Device::cpu_with_threads(threads),
        ("cpu", None) => Ok(Device::cpu()),
        ("auto", None) => Ok(Device::best()),
        #[cfg(feature = "gpu")]
        ("gpu", None) => Device::gpu(None),
        #[cfg(feature = "gpu")]
        (part, _) => Device::gpu(Some(part)),
        #[cfg(not(feature = "gpu"))]
        _ => Err(raykd::Error::Wgpu("this raykd was built for the CPU alone".to_owned())),
    }
}

/// What there is to trace on, a dictionary each. ``device`` is what ``raykd.Scene`` takes.
#[pyfunction]
pub(crate) fn devices(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    same_process()?;
    let cpu = device(py, "cpu", None)?;
    let mut found = vec![];
    let about = PyDict::new(py);
    about.set_item("device", "cpu")?;
    about.set_item("kind", "cpu")?;
    about.set_item("name", cpu.name())?;
    about.set_item("usable", true)?;
    about.set_item("fault", None::<String>)?;
    found.push(about);
    #[cfg(feature = "gpu")]
    for (number, adapter) in py.detach(raykd::adapters).into_iter().enumerate() {
        let about = PyDict::new(py);
        about.set_item("device", format!("gpu:{number}"))?;
        about.set_item("kind", "gpu")?;
        about.set_item("name", &adapter.name)?;
        let fault = match adapter.verdict {
            raykd::AdapterVerdict::Exact { .. } => None,
            raykd::AdapterVerdict::Inexact(reason) | raykd::AdapterVerdict::Unusable(reason) => Some(reason),
            _ => Some("not known to this version".to_owned()),
        };
        about.set_item("usable", fault.is_none())?;
        about.set_item("fault", fault)?;
        about.set_item("type", adapter.device_type)?;
        about.set_item("driver", &adapter.driver)?;
        about.set_item("driver_info", &adapter.driver_info)?;
        about.set_item("max_binding_bytes", adapter.max_binding_bytes)?;
        about.set_item("max_buffer_bytes", adapter.max_buffer_bytes)?;
        found.push(about);
    }
    Ok(found)
}
