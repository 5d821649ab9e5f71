//! Files of rays.

use crate::npy::{self, Rows};
use anyhow::{Context as _, bail};
use bytemuck::allocation::cast_vec;
use raykd::{
    Hit, Ray, Ray64,
    internals::{all_of, quoted},
    rays::AnyRay,
};
use std::{
    borrow::Cow,
    io::{self, Write},
    path::Path,
};

/// The rays of a file, in the mesh's own coordinates.
pub(super) enum Rays {
    Narrow(Vec<Ray>),
    Wide(Vec<Ray64>),
}

impl Rays {
    /// Reads a file whose name ends in `.npy`, or else records of 8 little-endian `f32`, or `f64` if they are wide.
    pub(super) fn read(path: &Path, wide: bool, max_bytes: u64) -> anyhow::Result<Self> {
        let bytes = all_of(path, max_bytes)?;
        if npy::is_named(path) {
            return Self::of_npy(&bytes).with_context(|| quoted(path.display()));
        }
        const _: () =
            assert!(cfg!(target_endian = "little"), "files are read and written as they lie in memory");
        let (record, number) = if wide { (size_of::<Ray64>(), "f64") } else { (size_of::<Ray>(), "f32") };
        let extra = bytes.len() % record;
        if extra != 0 {
            bail!(
                "{}: {} bytes are no whole number of rays of {record} bytes ({extra} left over); \
                 a ray is 8 little-endian {number}: origin, direction, t_min, t_max",
                quoted(path.display()),
                bytes.len()
            );
        }
        Ok(if wide {
            Self::Wide(bytemuck::pod_collect_to_vec(&bytes))
        } else {
            Self::Narrow(bytemuck::pod_collect_to_vec(&bytes))
        })
    }

    /// Rays of a mesh that was moved, where they are seen from the mesh's own coordinates.
    pub(super) fn of_local(rays: Vec<Ray>, translation: [f64; 3]) -> Self {
        if translation == [0.0; 3] {
            return Self::Narrow(rays);
        }
        let [x, y, z] = translation;
        let moved = |ray: &Ray| {
            let ray = ray.wide();
            Ray64 { origin: [ray.origin[0] + x, ray.origin[1] + y, ray.origin[2] + z], ..ray }
        };
        Self::Wide(rays.iter().map(moved).collect())
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Narrow(rays) => rays.len(),
            Self::Wide(rays) => rays.len(),
        }
    }

    /// Writes a file whose name ends in `.npy` as an array of N x 8 numbers, any other as records.
    pub(super) fn write(&self, path: &Path, file: &mut dyn Write) -> io::Result<()> {
        let shape = [self.len(), 8];
        match self {
            Self::Narrow(rays) if npy::is_named(path) => {
                npy::write(file, &shape, bytemuck::cast_slice::<_, f32>(rays).iter().copied())
            }
            Self::Wide(rays) if npy::is_named(path) => {
                npy::write(file, &shape, bytemuck::cast_slice::<_, f64>(rays).iter().copied())
            }
            Self::Narrow(rays) => file.write_all(bytemuck::cast_slice(rays)),
            Self::Wide(rays) => file.write_all(bytemuck::cast_slice(rays)),
        }
    }

    fn of_npy(bytes: &[u8]) -> anyhow::Result<Self> {
        Ok(match npy::rows::<8>(bytes, "rays")? {
            Rows::Narrow(rays) => Self::Narrow(cast_vec(rays)),
            Rows::Wide(rays) => Self::Wide(cast_vec(rays)),
        })
    }

    /// The rays for a mesh that was moved.
    pub(super) fn local(&self, translation: [f64; 3]) -> Cow<'_, [Ray]> {
        match self {
            Self::Narrow(rays) => AnyRay::local(rays, translation),
            Self::Wide(rays) => AnyRay::local(rays, translation),
        }
    }
}

/// Writes hits to a file whose name ends in `.npy` as an array of N records, else as those alone.
pub(super) fn write_hits(path: &Path, file: &mut dyn Write, hits: &[Hit]) -> io::Result<()> {
    if npy::is_named(path) {
        let record = |&Hit { triangle, t, u, v }| Record { triangle, t, u, v };
        return npy::write(file, &[hits.len()], hits.iter().map(record));
    }
    file.write_all(bytemuck::cast_slice(hits))
}

/// Writes numbers, one a ray.
pub(super) fn write_counts(path: &Path, file: &mut dyn Write, counts: &[u32]) -> io::Result<()> {
    if npy::is_named(path) {
        return npy::write(file, &[counts.len()], counts.iter().copied());
    }
    file.write_all(bytemuck::cast_slice(counts))
}

/// A hit, with the names that its numbers have in an array.
#[derive(npyz::AutoSerialize, npyz::Serialize)]
struct Record {
    triangle: u32,
    t: f32,
    u: f32,
    v: f32,
}
