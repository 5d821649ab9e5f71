//! A mesh that lies on a device is made ready there: what `raykd::mesh` does to one of the host.

use super::built::{Facts, Given, KeptIn, MeshBuffers};
use crate::{
    Error,
    exec::{Buffer, Device, Launch, Step},
    mesh::{Measure, MeshError, Place},
};
use raykd_kernels::build::{
    bin::unordered,
    survey::{BLOCK, Found, Job, MARKS, collect, indices, offsets, settle, sift, vertices},
};
use raykd_shared::limits::MAX_TRIANGLES;

/// The mesh as it was surveyed.
#[derive(Debug)]
pub(crate) struct Surveyed {
    facts: Facts,
    on_device: MeshBuffers,
    /// The triangles that take part.
    pub(crate) kept: Buffer<u32>,
}

impl Surveyed {
    /// To be built from.
    pub(crate) fn given(&self) -> Given<'_> {
        Given { facts: self.facts, on_device: self.on_device.clone(), kept: KeptIn::Device(&self.kept) }
    }

    /// How many triangles take part.
    pub(crate) const fn count(&self) -> u32 {
        self.facts.kept
    }
}

/// The buffers of a survey.
#[derive(Debug)]
pub(crate) struct Room {
    job: Buffer<u32>,
    found: Buffer<u32>,
    positions: Buffer<u32>,
    indices: Buffer<u32>,
    marks: Buffer<u32>,
    counts: Buffer<u32>,
    kept: Buffer<u32>,
}

/// What the kernels write that copy a mesh: with the mesh itself, wherever it is, all that they bind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Copies<'a> {
    pub job: &'a Buffer<u32>,
    pub positions: &'a Buffer<u32>,
    pub indices: &'a Buffer<u32>,
    pub found: &'a Buffer<u32>,
}

impl Copies<'_> {
    /// The steps that copy it from other buffers of the device.
    pub(crate) fn steps<'a>(
        &'a self,
        positions: &'a Buffer<u32>,
        triangles: &'a Buffer<u32>,
    ) -> [Step<'a>; 2] {
        let Self { job, found, .. } = *self;
        let (coordinates, corners) = (positions.elements() as u32, triangles.elements() as u32);
        let vertices =
            vertices::Buffers { job, given: positions, positions: self.positions.out(), found: found.out() };
        let indices =
            indices::Buffers { job, given: triangles, indices: self.indices.out(), found: found.out() };
        [vertices.over(coordinates), indices.over(corners)]
    }
}

impl Room {
    fn new(device: &Device, vertices: u32, triangles: u32) -> Result<Self, Error> {
        let (vertices, triangles) = (u64::from(vertices), u64::from(triangles));
        let blocks = triangles.div_ceil(BLOCK.into());
        Ok(Self {
            // The largest first: if they fit, no number of elements is too large for a word.
            positions: device.room("positions", 3 * vertices)?,
            indices: device.room("indices", 3 * triangles)?,
            kept: device.room("kept", triangles)?,
            marks: device.room("marks", blocks * u64::from(MARKS))?,
            counts: device.room("counts", blocks)?,
            job: device.room::<Job>("survey", 1)?.view(),
            found: device.room::<Found>("found", 1)?.view(),
        })
    }

    /// Marks the triangles that take part, lists and measures them: the one look at the device.
    fn sift(&self, device: &Device, triangles: u32) -> Result<Found, Error> {
        let Self { job, found, indices, marks, counts, .. } = self;
        let positions = &self.positions;
        let sift = sift::Buffers {
            job,
            positions,
            indices,
            marks: marks.out(),
            counts: counts.out(),
            found: found.out(),
        };
        let offsets = offsets::Buffers { job, positions, indices, counts: counts.out(), found: found.out() };
        let collect = collect::Buffers { job, marks, counts, kept: self.kept.out() };
        let steps = [sift.groups(triangles.div_ceil(BLOCK)), offsets.groups(1), collect.over(triangles)];
        Ok(device.dispatch_and_read(&steps, false, &found.view())?.1)
    }
}

/// Makes a mesh of so many vertices and triangles ready, once `copy` has made the device copy it.
pub(crate) fn survey(
    device: &Device,
    vertices: u32,
    triangles: u32,
    copy: impl FnOnce(Copies<'_>) -> Result<(), Error>,
) -> Result<Surveyed, Error> {
    if triangles == 0 {
        return Err(MeshError::NoFaces { at: Place::default() }.into());
    }
    if triangles > MAX_TRIANGLES {
        return Err(MeshError::TooManyTriangles { at: Place::default(), limit: MAX_TRIANGLES }.into());
    }
    let room = Room::new(device, vertices, triangles)?;
    let mut job = Job { vertices, triangles, dust: dust_bits(0.0), again: 0, scale: 1f32.to_bits() >> 23 };
    let write = |job: Job, found: Option<Found>| {
        device.write(&room.job.view(), 0, &[job])?;
        found.map_or(Ok(()), |found| device.write(&room.found.view(), 0, &[found]))
    };
    write(job, Some(Found::NOTHING))?;
    let Room { positions, indices, .. } = &room;
    copy(Copies { job: &room.job, positions, indices, found: &room.found })?;
    let mut found = room.sift(device, triangles)?;
    check(&found, vertices)?;
    let mut facts = Facts { triangles, kept: 0, bounds: ([0.0; 3], [0.0; 3]), scale: 1.0 };
    // As for a mesh of the host: without dust triangles may have no area, and without those the mesh be smaller.
    while found.kept > 0 {
        let (measure, kept) = (measure(&found), found.kept);
        job.dust = dust_bits(measure.dust());
        if measure.has_dust() {
            job.again = 1;
            write(job, Some(Found::NOTHING))?;
            found = room.sift(device, triangles)?;
        }
        if found.kept == kept {
            let scale = measure.scale()?;
            facts = Facts { kept, bounds: measure.scaled(scale), scale, ..facts };
            job.scale = scale.to_bits() >> 23;
            break;
        }
        job.dust = dust_bits(0.0);
    }
    write(job, None)?;
    let settle = settle::Buffers { job: &room.job, positions: room.positions.out() };
    device.begin(&[settle.over(3 * vertices)])?;
    let positions = room.positions.view();
    let on_device = MeshBuffers { positions, coordinates: 3 * vertices as usize, indices: room.indices };
    Ok(Surveyed { facts, on_device, kept: room.kept })
}

/// Bits of the least `f32` that is no dust. Zeros are, that of the wrong sign too.
fn dust_bits(dust: f64) -> u32 {
    // Powers of two, and down to the least f32 each is one.
    (dust as f32).to_bits().max(1)
}

/// The box of the triangles found.
fn measure(found: &Found) -> Measure {
    Measure {
        lo: found.lo.map(unordered),
        hi: found.hi.map(unordered),
        smallest: f32::from_bits(found.smallest),
    }
}

/// Refuses a mesh with numbers that cannot be used.
fn check(found: &Found, vertices: u32) -> Result<(), MeshError> {
    if found.vertex != u32::MAX {
        let coordinates = found.words.map(f32::from_bits);
        let value = coordinates.into_iter().find(|x| !x.is_finite()).unwrap_or(f32::NAN);
        let at = Place::element("vertex", found.vertex.into());
        return Err(MeshError::NonFinite { at, value: format!("{value:?}") });
    }
    if found.triangle != u32::MAX {
        let index = found.words.into_iter().find(|&v| v >= vertices).unwrap_or_default().into();
        let at = Place::element("triangle", found.triangle.into());
        return Err(MeshError::IndexOutOfRange { at, index, first: 0, vertices: vertices.into() });
    }
    Ok(())
}
