//! Files of rays.

use anyhow::bail;
use raykd::{
    Ray, Ray64,
    internals::{all_of, quoted},
    rays::AnyRay,
};
use std::{borrow::Cow, path::Path};

/// The rays of a file, in the mesh's own coordinates.
pub(super) enum Rays {
    Narrow(Vec<Ray>),
    Wide(Vec<Ray64>),
}

impl Rays {
    /// Reads records of 8 little-endian `f32`, or `f64` if they are wide.
    pub(super) fn read(path: &Path, wide: bool, max_bytes: u64) -> anyhow::Result<Self> {
        const _: () =
            assert!(cfg!(target_endian = "little"), "files are read and written as they lie in memory");
        let bytes = all_of(path, max_bytes)?;
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

    /// The rays for a mesh that was moved.
    pub(super) fn local(&self, translation: [f64; 3]) -> Cow<'_, [Ray]> {
        match self {
            Self::Narrow(rays) => AnyRay::local(rays, translation),
            Self::Wide(rays) => AnyRay::local(rays, translation),
        }
    }
}
