//! Arrays of numpy as meshes, rays and points, and hits as arrays.

use crate::error;
use bytemuck::{Pod, allocation::cast_vec};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods as _};
use pyo3::{exceptions::PyValueError, prelude::*};
use raykd::{Error, Hit, Query, Ray, Ray64, Scene, internals::reserve, rays::AnyRay};
use rayon::prelude::*;
use std::ops::Range;

/// Rows of three numbers.
#[derive(FromPyObject)]
pub(crate) enum Threes<'py> {
    Narrow(PyReadonlyArray2<'py, f32>),
    Wide(PyReadonlyArray2<'py, f64>),
}

impl Threes<'_> {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Narrow(rows) => rows.shape()[0],
            Self::Wide(rows) => rows.shape()[0],
        }
    }
}

/// Numbers, one a ray, or one for all.
#[derive(FromPyObject)]
pub(crate) enum Ones<'py> {
    Narrow(PyReadonlyArray1<'py, f32>),
    Wide(PyReadonlyArray1<'py, f64>),
}

/// Origins, directions, `t_min` and `t_max`, of one type.
#[derive(FromPyObject)]
pub(crate) struct Arrays<'py>(Threes<'py>, Threes<'py>, Ones<'py>, Ones<'py>);

/// The rows of a C-contiguous array.
pub(crate) fn rows<'a, T: numpy::Element + Pod>(
    array: &'a PyReadonlyArray2<'_, T>,
) -> PyResult<&'a [[T; 3]]> {
    let numbers = array.as_slice()?;
    if array.shape()[1] != 3 {
        return Err(PyValueError::new_err("rows must have 3 numbers"));
    }
    Ok(bytemuck::cast_slice(numbers))
}

/// A copy of the rows of a C-contiguous array. That there is no room for it is an error, not the end of the process.
pub(crate) fn copied<T: numpy::Element + Pod>(
    array: &PyReadonlyArray2<'_, T>,
    name: &'static str,
) -> PyResult<Vec<[T; 3]>> {
    let (rows, mut copy) = (rows(array)?, Vec::new());
    reserve(&mut copy, name, rows.len() as u64).map_err(error)?;
    copy.extend_from_slice(rows);
    Ok(copy)
}

/// A number of row `i`.
fn one<T: Copy>(numbers: &[T], i: usize) -> T {
    numbers[if numbers.len() == 1 { 0 } else { i }]
}

/// Rays that lie in arrays of their own.
pub(crate) enum Rays<'a> {
    Narrow(Parts<'a, f32>),
    Wide(Parts<'a, f64>),
}

pub(crate) struct Parts<'a, T> {
    origins: &'a [[T; 3]],
    directions: &'a [[T; 3]],
    t_min: &'a [T],
    t_max: &'a [T],
}

impl<'a, T: Copy> Parts<'a, T> {
    fn new(
        origins: &'a [[T; 3]],
        directions: &'a [[T; 3]],
        t_min: &'a [T],
        t_max: &'a [T],
    ) -> PyResult<Self> {
        let rays = origins.len();
        let fit = |len: usize| len == 1 || len == rays;
        if directions.len() != rays || !fit(t_min.len()) || !fit(t_max.len()) {
            return Err(PyValueError::new_err(
                "origins, directions, t_min and t_max are not of as many rays",
            ));
        }
        Ok(Self { origins, directions, t_min, t_max })
    }

    fn rays<R: AnyRay + Pod>(
        &self,
        range: Range<usize>,
        make: impl Fn([[T; 3]; 2], [T; 2]) -> R + Sync,
    ) -> Vec<R>
    where
        T: Sync,
    {
        let ray = |i| make([self.origins[i], self.directions[i]], [one(self.t_min, i), one(self.t_max, i)]);
        range.into_par_iter().with_min_len(1 << 14).map(ray).collect()
    }
}

impl<'a> Rays<'a> {
    pub(crate) fn new(arrays: &'a Arrays<'_>) -> PyResult<Self> {
        match arrays {
            Arrays(Threes::Narrow(o), Threes::Narrow(d), Ones::Narrow(lo), Ones::Narrow(hi)) => {
                Parts::new(rows(o)?, rows(d)?, lo.as_slice()?, hi.as_slice()?).map(Self::Narrow)
            }
            Arrays(Threes::Wide(o), Threes::Wide(d), Ones::Wide(lo), Ones::Wide(hi)) => {
                Parts::new(rows(o)?, rows(d)?, lo.as_slice()?, hi.as_slice()?).map(Self::Wide)
            }
            _ => Err(PyValueError::new_err("origins, directions, t_min and t_max are not of one type")),
        }
    }

    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Narrow(parts) => parts.origins.len(),
            Self::Wide(parts) => parts.origins.len(),
        }
    }

    /// Some of them, as raykd wants them.
    pub(crate) fn part(&self, range: Range<usize>) -> Part {
        match self {
            Self::Narrow(parts) => Part::Narrow(parts.rays(range, narrow)),
            Self::Wide(parts) => Part::Wide(parts.rays(range, wide)),
        }
    }

    /// Traces some of them. Each is made when it is its turn, while others are traced, and with the interpreter's lock
    /// held: a program may write to its arrays meanwhile.
    pub(crate) fn trace(
        &self,
        scene: &Scene,
        query: Query,
        range: Range<usize>,
    ) -> Result<(Vec<Hit>, u64), Error> {
        let (from, count) = (range.start, range.len());
        let there = |range: Range<usize>| from + range.start..from + range.end;
        match self {
            Self::Narrow(parts) => scene.trace_made(query, count, |range| {
                Python::attach(|_| parts.rays(there(range), narrow)).into()
            }),
            Self::Wide(parts) => scene
                .trace_made(query, count, |range| Python::attach(|_| parts.rays(there(range), wide)).into()),
        }
    }
}

fn narrow([origin, direction]: [[f32; 3]; 2], [t_min, t_max]: [f32; 2]) -> Ray {
    Ray { origin, direction, t_min, t_max }
}

fn wide([origin, direction]: [[f64; 3]; 2], [t_min, t_max]: [f64; 2]) -> Ray64 {
    Ray64 { origin, direction, t_min, t_max }
}

/// Rays, one after the other.
pub(crate) enum Part {
    Narrow(Vec<Ray>),
    Wide(Vec<Ray64>),
}

/// Calls a method of a scene with rays of either kind.
macro_rules! with_rays {
    ($part:expr, $rays:ident => $call:expr) => {
        match $part {
            $crate::arrays::Part::Narrow($rays) => $call,
            $crate::arrays::Part::Wide($rays) => $call,
        }
    };
}
pub(crate) use with_rays;

/// Hits as four words each. A miss is infinitely far away.
pub(crate) fn words(py: Python<'_>, mut hits: Vec<Hit>) -> Bound<'_, PyArray1<u32>> {
    py.detach(|| {
        let far = |hit: &mut Hit| {
            if !hit.is_hit() {
                hit.t = f32::INFINITY;
            }
        };
        hits.par_iter_mut().with_min_len(1 << 14).for_each(far);
    });
    PyArray1::from_vec(py, cast_vec(hits))
}

/// The hits of [`words`], with misses as raykd gives them.
pub(crate) fn hits(words: &[u32]) -> PyResult<Vec<Hit>> {
    let hits: &[Hit] = bytemuck::try_cast_slice(words)
        .map_err(|_| PyValueError::new_err("hits have four words each: triangle, t, u, v"))?;
    let plain = |hit: &Hit| if hit.is_hit() { *hit } else { Hit { t: 0.0, ..*hit } };
    Ok(hits.iter().map(plain).collect())
}
