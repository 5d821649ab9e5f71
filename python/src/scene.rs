//! Scenes, and what can be asked of them.

use crate::{
    arrays::{Arrays, Part, Rays, Threes, hits, rows, with_rays, words},
    device::{device, same_process},
    error,
    mesh::Mesh,
    plan::plan,
};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::{
    exceptions::{PyOverflowError, PyTypeError, PyValueError},
    prelude::*,
    types::{PyBytes, PyDict},
};
use raykd::{
    BuildOptions, DeviceKind, Error, Intersector, KdTree, Query, Traversal, internals::reserve, plan::Plan,
};
use std::{
    ops::Range,
    path::PathBuf,
    sync::{Arc, OnceLock},
};

/// A mesh and its tree on a device.
#[pyclass(frozen, module = "raykd._raykd")]
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) scene: raykd::Scene,
    /// Of a scene from a file, made when it is asked for.
    mesh: OnceLock<Arc<raykd::Mesh>>,
    /// If `quality="auto"` chose how to build.
    plan: Option<Plan>,
}

/// Numbers, one a ray.
type Words<'py> = Bound<'py, PyArray1<u32>>;

#[pymethods]
impl Scene {
    #[new]
    fn new(
        py: Python<'_>,
        mesh: &Mesh,
        device: (String, Option<usize>),
        ways: (String, String),
        tree: Option<Vec<u8>>,
        options: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let device = self::device(py, &device.0, device.1)?;
        let mesh = Arc::clone(&mesh.0);
        let options = build_options(options)?;
        let built = py.detach(|| match tree {
            None => raykd::Scene::build(&device, &mesh, &options),
            Some(bytes) => raykd::Scene::with_tree(&device, &mesh, &KdTree::from_bytes(&bytes)?),
        });
        Self { scene: built.map_err(error)?, mesh: mesh.into(), plan: None }.using(&ways.0, &ways.1)
    }

    /// Builds what takes the least time for so many rays.
    #[staticmethod]
    fn planned(
        py: Python<'_>,
        mesh: &Mesh,
        device: (String, Option<usize>),
        test: &str,
        rays: u64,
        costs: Option<PathBuf>,
    ) -> PyResult<Self> {
        let mesh = Arc::clone(&mesh.0);
        let (device, plan) = plan(py, &mesh, (&device.0, device.1), rays, costs)?;
        let built = py.detach(|| raykd::Scene::build(&device, &mesh, &plan.choice.options()));
        let traversal = plan.traversal();
        let scene = Self { scene: built.map_err(error)?, mesh: mesh.into(), plan: Some(plan) };
        scene.using(traversal.name(), test)
    }

    /// Opens a scene's file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, device: (String, Option<usize>)) -> PyResult<Self> {
        let device = self::device(py, &device.0, device.1)?;
        // SAFETY: nobody may change the file as long as the scene lives, and the documentation says so; Python has no
        // other way to ask.
        #[allow(unsafe_code, reason = "the one promise that Python's users make")]
        let opened = py.detach(|| unsafe { raykd::Scene::open_mapped(&device, &path) });
        Ok(Self { scene: opened.map_err(error)?, mesh: OnceLock::new(), plan: None })
    }

    /// Writes a scene's file.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        same_process()?;
        py.detach(|| self.scene.save(&path)).map_err(error)
    }

    /// The same scene with another traversal and triangle test; both share all memory.
    fn using(&self, traversal: &str, test: &str) -> PyResult<Self> {
        same_process()?;
        let traversal: Traversal = traversal.parse().map_err(error)?;
        let test: Intersector = test.parse().map_err(error)?;
        test.goes_with(traversal).map_err(error)?;
        let mut scene = self.scene.clone();
        scene.traverse_by(traversal).map_err(error)?;
        scene.intersect_by(test).map_err(error)?;
        Ok(Self { scene, mesh: self.mesh.clone(), plan: self.plan.clone() })
    }

    /// Hits as words, and how many rays were invalid.
    fn trace<'py>(
        &self,
        py: Python<'py>,
        any: bool,
        rays: Arrays<'_>,
        exclude: Option<PyReadonlyArray1<'_, u32>>,
    ) -> PyResult<(Words<'py>, u64)> {
        let rays = Rays::new(&rays)?;
        let query = if any { Query::Any } else { Query::Closest };
        let exclude = exclude.as_ref().map(PyReadonlyArray1::as_slice).transpose()?;
        if let Some(exclude) = exclude
            && exclude.len() != rays.len()
        {
            return Err(error(Error::Excluded { rays: rays.len(), excluded: exclude.len() }));
        }
        let (mut found, mut invalid) = (Vec::new(), 0);
        for range in self.ranges(rays.len())? {
            let hits = match exclude {
                None => py.detach(|| rays.trace(&self.scene, query, range)),
                Some(exclude) => {
                    let (part, exclude) = (rays.part(range.clone()), exclude[range].to_vec());
                    py.detach(|| with_rays!(part, part => self.scene.trace_except(query, &part, &exclude)))
                        .map(|traced| (traced.hits, traced.invalid))
                }
            };
            let (hits, none) = hits.map_err(error)?;
            invalid += none;
            // Hits of many rays take longer to copy than to find.
            if found.is_empty() {
                found = hits;
            } else {
                let more = rays.len() - found.len();
                reserve(&mut found, "hits", more as u64).map_err(error)?;
                found.extend_from_slice(&hits);
            }
            py.check_signals()?;
        }
        Ok((words(py, found), invalid))
    }

    /// Where each ray's hits begin among all of them, the hits as words, and how many rays were invalid.
    fn all<'py>(
        &self,
        py: Python<'py>,
        rays: Arrays<'_>,
        limit: Option<u32>,
    ) -> PyResult<(Bound<'py, PyArray1<u64>>, Words<'py>, u64)> {
        let rays = Rays::new(&rays)?;
        let (mut begins, mut found, mut invalid) = (vec![0], Vec::new(), 0);
        reserve(&mut begins, "begin", rays.len() as u64).map_err(error)?;
        self.in_parts(py, &rays, |_, part| {
            let all = with_rays!(part, rays => self.scene.all(&rays, limit.unwrap_or(u32::MAX))?);
            // Room for as many again, so that few parts move what there is.
            if found.capacity() - found.len() < all.hits.len() {
                let more = all.hits.len().max(found.len());
                reserve(&mut found, "hits", more as u64)?;
            }
            begins.extend(all.begins[1..].iter().map(|&begin| (found.len() + begin) as u64));
            found.extend(all.hits);
            invalid += all.invalid;
            Ok(())
        })?;
        Ok((PyArray1::from_vec(py, begins), words(py, found), invalid))
    }

    /// How many hits each ray has, and how many rays were invalid.
    fn count<'py>(&self, py: Python<'py>, rays: Arrays<'_>) -> PyResult<(Words<'py>, u64)> {
        let rays = Rays::new(&rays)?;
        let (mut counts, mut invalid) = (Vec::new(), 0);
        reserve(&mut counts, "counts", rays.len() as u64).map_err(error)?;
        self.in_parts(py, &rays, |_, part| {
            let all = with_rays!(part, rays => self.scene.all(&rays, 0)?);
            invalid += all.invalid;
            counts.extend_from_slice(&all.totals);
            Ok(())
        })?;
        Ok((PyArray1::from_vec(py, counts), invalid))
    }

    /// How often each ray leaves, how often it enters, and how many rays were invalid.
    fn crossings<'py>(&self, py: Python<'py>, rays: Arrays<'_>) -> PyResult<(Words<'py>, Words<'py>, u64)> {
        let rays = Rays::new(&rays)?;
        let (mut leaving, mut entering, mut invalid) = (Vec::new(), Vec::new(), 0);
        for counts in [&mut leaving, &mut entering] {
            reserve(counts, "crossings", rays.len() as u64).map_err(error)?;
        }
        self.in_parts(py, &rays, |_, part| {
            let counted = with_rays!(part, rays => self.scene.crossings(&rays)?);
            invalid += counted.invalid;
            leaving.extend(counted.counts.iter().map(|it| it.leaving));
            entering.extend(counted.counts.iter().map(|it| it.entering));
            Ok(())
        })?;
        Ok((PyArray1::from_vec(py, leaving), PyArray1::from_vec(py, entering), invalid))
    }

    /// Winding numbers of points, and how many points were invalid.
    fn winding<'py>(
        &self,
        py: Python<'py>,
        points: Threes<'_>,
    ) -> PyResult<(Bound<'py, PyArray1<i32>>, u64)> {
        let (mut windings, mut invalid) = (Vec::new(), 0);
        reserve(&mut windings, "windings", points.len() as u64).map_err(error)?;
        for range in self.ranges(points.len())? {
            // Copied while the interpreter's lock is held.
            let counted = match &points {
                Threes::Narrow(points) => {
                    let part = rows(points)?[range].to_vec();
                    py.detach(|| self.scene.winding(&part))
                }
                Threes::Wide(points) => {
                    let part = rows(points)?[range].to_vec();
                    py.detach(|| self.scene.winding(&part))
                }
            };
            let counted = counted.map_err(error)?;
            invalid += counted.invalid;
            windings.extend(counted.counts);
            py.check_signals()?;
        }
        Ok((PyArray1::from_vec(py, windings), invalid))
    }

    /// Inner nodes, leaves and triangle tests that the closest hit of each ray took.
    fn steps<'py>(&self, py: Python<'py>, rays: Arrays<'_>) -> PyResult<[Words<'py>; 3]> {
        let rays = Rays::new(&rays)?;
        let mut counts = [const { Vec::new() }; 3];
        for counts in &mut counts {
            reserve(counts, "steps", rays.len() as u64).map_err(error)?;
        }
        self.in_parts(py, &rays, |_, part| {
            let stepped = with_rays!(part, rays => self.scene.steps(&rays)?);
            for step in stepped.steps {
                for (counts, count) in counts.iter_mut().zip([step.inner, step.leaves, step.tests]) {
                    counts.push(count);
                }
            }
            Ok(())
        })?;
        Ok(counts.map(|counts| PyArray1::from_vec(py, counts)))
    }

    #[getter]
    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        self.shared_mesh(py).map(Mesh)
    }

    #[getter]
    fn device(&self) -> (&'static str, &str) {
        (self.scene.device().kind().name(), self.scene.device().name())
    }

    #[getter]
    fn traversal(&self) -> &'static str {
        self.scene.traversal().name()
    }

    #[getter]
    fn test(&self) -> &'static str {
        self.scene.intersector().name()
    }

    /// The bytes of a tree file.
    fn tree<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        same_process()?;
        let bytes = py.detach(|| self.scene.tree().map(|tree| tree.to_bytes())).map_err(error)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// What `quality="auto"` chose, and the seconds that it predicted.
    fn plan<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(plan) = &self.plan else { return Ok(None) };
        let about = PyDict::new(py);
        about.set_item("choice", plan.choice.name)?;
        about.set_item("rays", plan.rays)?;
        about.set_item("build_seconds", plan.cost.before_ms() * 1e-3)?;
        about.set_item("seconds", plan.total_ms() * 1e-3)?;
        Ok(Some(about))
    }

    /// What the tree is, and what building it took.
    fn about<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        same_process()?;
        let tree = py.detach(|| self.scene.tree()).map_err(error)?;
        let about = PyDict::new(py);
        about.set_item("digest", tree.digest())?;
        about.set_item("nodes", self.scene.header().nodes)?;
        about.set_item("references", self.scene.header().refs)?;
        about.set_item("bytes", self.scene.tree_bytes())?;
        about.set_item("build_seconds", self.scene.times().build.as_secs_f64())?;
        Ok(about)
    }
}

impl Scene {
    /// The mesh, brought from the device if the scene was loaded.
    pub(crate) fn shared_mesh(&self, py: Python<'_>) -> PyResult<Arc<raykd::Mesh>> {
        same_process()?;
        if let Some(mesh) = self.mesh.get() {
            return Ok(Arc::clone(mesh));
        }
        let mesh = py.detach(|| self.scene.mesh()).map_err(error)?;
        Ok(Arc::clone(self.mesh.get_or_init(|| Arc::new(mesh))))
    }

    /// Parts of so many rays that a person who wants to stop need not wait.
    fn ranges(&self, rays: usize) -> PyResult<impl Iterator<Item = Range<usize>> + use<>> {
        same_process()?;
        let most = 1 << if self.scene.device().kind() == DeviceKind::Cpu { 18 } else { 24 };
        Ok((0..rays).step_by(most).map(move |start| start..rays.min(start + most)))
    }

    fn in_parts(
        &self,
        py: Python<'_>,
        rays: &Rays<'_>,
        mut ask: impl FnMut(Range<usize>, Part) -> Result<(), Error> + Send,
    ) -> PyResult<()> {
        for range in self.ranges(rays.len())? {
            let part = rays.part(range.clone());
            py.detach(|| ask(range, part)).map_err(error)?;
            py.check_signals()?;
        }
        Ok(())
    }
}

fn build_options(given: &Bound<'_, PyDict>) -> PyResult<BuildOptions> {
    let mut options = BuildOptions::default();
    for (key, value) in given.iter() {
        let key: String = key.extract()?;
        choose(&mut options, &key, &value).map_err(|error| {
            // Python's own sentence does not say which option it is about.
            let py = value.py();
            if !error.is_instance_of::<PyTypeError>(py) {
                return error;
            }
            PyTypeError::new_err(format!("{key}: {}", error.value(py)))
        })?;
    }
    Ok(options)
}

/// Sets one of them.
fn choose(options: &mut BuildOptions, key: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    match key {
        "builder" => options.builder = value.extract::<String>()?.parse().map_err(error)?,
        "cost_step" => options.cost_step = value.extract()?,
        "cost_test" => options.cost_test = value.extract()?,
        "price" => options.price = value.extract()?,
        "long" => options.long = whole(value, "long")?,
        "budget" => options.budget = value.extract()?,
        "empty" => options.empty = value.extract()?,
        "max_depth" => options.max_depth = whole(value, "max_depth")?,
        "clip" => options.clip = value.extract()?,
        _ => {
            return Err(PyValueError::new_err(format!(
                "there is no build option {key:?}; there are builder, cost_step, cost_test, price, long, budget, \
                 empty, max_depth, clip"
            )));
        }
    }
    Ok(())
}

/// A whole number of 32 bits; one that is out of range is bad input like any other.
fn whole(value: &Bound<'_, PyAny>, name: &str) -> PyResult<u32> {
    value.extract().map_err(|error: PyErr| {
        if !error.is_instance_of::<PyOverflowError>(value.py()) {
            return error;
        }
        PyValueError::new_err(format!("{name} must be from 0 to {}, but is {value}", u32::MAX))
    })
}

/// SHA-256 of hits, as the program `raykd` prints it.
#[pyfunction]
pub(crate) fn digest(words: PyReadonlyArray1<'_, u32>) -> PyResult<String> {
    Ok(raykd::internals::hits_digest(&hits(words.as_slice()?)?))
}
