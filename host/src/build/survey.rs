//! A mesh that lies on a device is made ready there: what `raykd::mesh` does to one of the host.

use super::built::{Facts, Given, KeptIn, MeshBuffers};
use crate::{
    Error,
    exec::{Buffer, Device, Launch, Step},
    mesh::{Measure, MeshError, Place, check_triangles},
};
use raykd_kernels::{
    build::{
        bin::unordered,
        survey::{BLOCK, Found, Job, MARKS, collect, indices, offsets, root, settle, sift, vertices},
    },
    glam::UVec4,
};

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

/// A survey that is under way: the device copies the mesh, and sifts it.
#[derive(Debug)]
pub(crate) struct Survey {
    vertices: u32,
    triangles: u32,
    job: Buffer<u32>,
    pub(super) found: Buffer<u32>,
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

impl Survey {
    /// Takes memory for a mesh of so many vertices and triangles, and has `copy` make the device copy it there and run
    /// some steps then.
    pub(crate) fn begin(
        device: &Device,
        vertices: u32,
        triangles: u32,
        copy: impl FnOnce(Copies<'_>, &[Step<'_>]) -> Result<(), Error>,
    ) -> Result<Self, Error> {
        if triangles == 0 {
            return Err(MeshError::NoFaces { at: Place::default() }.into());
        }
        check_triangles(triangles.into())?;
        let blocks = u64::from(triangles.div_ceil(BLOCK));
        let survey = Self {
            vertices,
            triangles,
            // The largest first: if they fit, no number of elements is too large for a word.
            positions: device.room("positions", 3 * u64::from(vertices))?,
            indices: device.room("indices", 3 * u64::from(triangles))?,
            kept: device.room("kept", triangles.into())?,
            marks: device.room("marks", blocks * u64::from(MARKS))?,
            counts: device.room("counts", blocks)?,
            job: device.room::<Job>("survey", 1)?.view(),
            found: device.room::<Found>("found", 1)?.view(),
        };
        survey.write(device, survey.job())?;
        device.write(&survey.found.view(), 0, &[Found::NOTHING])?;
        let Self { job, positions, indices, found, .. } = &survey;
        copy(Copies { job, positions, indices, found }, &survey.sift())?;
        Ok(survey)
    }

    /// What is asked first.
    fn job(&self) -> Job {
        let Self { vertices, triangles, .. } = *self;
        Job { vertices, triangles, dust: dust_bits(0.0), scale: 1f32.to_bits() >> 23, ..Job::default() }
    }

    fn write(&self, device: &Device, job: Job) -> Result<(), Error> {
        device.write(&self.job.view(), 0, &[job])
    }

    /// What marks the triangles that take part, lists and measures them.
    fn sift(&self) -> [Step<'_>; 3] {
        let Self { triangles, job, found, positions, indices, marks, counts, kept, .. } = self;
        let sift = sift::Buffers {
            job,
            positions,
            indices,
            marks: marks.out(),
            counts: counts.out(),
            found: found.out(),
        };
        let offsets = offsets::Buffers { job, positions, indices, counts: counts.out(), found: found.out() };
        let collect = collect::Buffers { job, marks, counts, kept: kept.out() };
        [sift.groups(triangles.div_ceil(BLOCK)), offsets.groups(1), collect.over(*triangles)]
    }

    /// What brings coordinates to what the kernels see.
    fn settle(&self) -> Step<'_> {
        settle::Buffers { job: &self.job, positions: self.positions.out() }.over(3 * self.vertices)
    }

    /// How many triangles the mesh has.
    pub(super) const fn triangles(&self) -> u32 {
        self.triangles
    }

    fn on_device(&self) -> MeshBuffers {
        let positions = self.positions.view();
        MeshBuffers { positions, coordinates: 3 * self.vertices as usize, indices: self.indices.clone() }
    }

    /// The mesh as it is expected to be, to be built from while it is surveyed.
    pub(super) fn expected(&self, device: &Device, kept: u32) -> Result<Given<'_>, Error> {
        self.write(device, Job { expected: kept, ..self.job() })?;
        let facts = Facts { kept, ..self.nothing() };
        Ok(Given { facts, on_device: self.on_device(), kept: KeptIn::Device(&self.kept) })
    }

    /// What makes a root of what was found.
    pub(super) fn steps<'a>(&'a self, root: Root<'a>) -> [Step<'a>; 2] {
        let Root { params, item, header, level, args, round, state } = root;
        let root = root::Buffers {
            found: &self.found,
            job: self.job.out(),
            params: params.out(),
            item: item.out(),
            header: header.out(),
            level: level.out(),
            args: args.out(),
            round: round.out(),
            state: state.out(),
        };
        [root.over(1), self.settle()]
    }

    /// The facts of a mesh of which nothing takes part.
    const fn nothing(&self) -> Facts {
        Facts { triangles: self.triangles, kept: 0, bounds: ([0.0; 3], [0.0; 3]), scale: 1.0 }
    }

    /// The facts of a mesh of which something does.
    fn facts(&self, found: &Found) -> Result<Facts, Error> {
        let measure = measure(found);
        let scale = measure.scale()?;
        Ok(Facts { kept: found.kept, bounds: measure.scaled(scale), scale, ..self.nothing() })
    }

    fn surveyed(self, facts: Facts) -> Surveyed {
        Surveyed { facts, on_device: self.on_device(), kept: self.kept }
    }

    /// The mesh that was found, which is as it was expected to be.
    pub(super) fn done(self, found: &Found) -> Result<Surveyed, Error> {
        let facts = self.facts(found)?;
        Ok(self.surveyed(facts))
    }

    /// What is found.
    fn look(&self, device: &Device) -> Result<Found, Error> {
        let mut found = [Found::NOTHING];
        device.read_into(&self.found.view(), 0, &mut found)?;
        Ok(found[0])
    }

    /// Marks triangles as a job says. Returns what is found.
    fn sift_again(&self, device: &Device, job: Job) -> Result<Found, Error> {
        self.write(device, job)?;
        device.write(&self.found.view(), 0, &[Found::NOTHING])?;
        device.begin(&self.sift())?;
        self.look(device)
    }

    /// With those triangles that have area only without dust, if dust is the same then. Else those of before are marked
    /// once more, in rounds of so much dust.
    fn others_too(&self, device: &Device, job: Job, dusts: &[u32]) -> Result<Found, Error> {
        let mut found = self.sift_again(device, job)?;
        if dust_bits(measure(&found).dust()) != job.dust {
            found = self.sift_again(device, self.job())?;
            for &dust in dusts {
                found = self.sift_again(device, Job { dust, again: 1, ..job })?;
            }
        }
        Ok(found)
    }

    /// Looks at what is found, and makes the mesh ready.
    pub(crate) fn finish(self, device: &Device) -> Result<Surveyed, Error> {
        let mut found = self.look(device)?;
        check(&found, self.vertices)?;
        let (mut job, mut facts) = (self.job(), self.nothing());
        // As for a mesh of the host: without dust triangles may have no area, and without those the mesh be smaller.
        let mut dusts = Vec::new();
        while found.kept > 0 {
            let (measured, kept) = (measure(&found), found.kept);
            job.dust = dust_bits(measured.dust());
            if measured.has_dust() {
                dusts.push(job.dust);
                found = self.sift_again(device, Job { again: 1, ..job })?;
                if found.kept < kept {
                    job.dust = dust_bits(0.0);
                    continue;
                }
                found = self.others_too(device, job, &dusts)?;
            }
            facts = self.facts(&found)?;
            break;
        }
        job.scale = facts.scale.to_bits() >> 23;
        self.write(device, job)?;
        device.begin(&[self.settle()])?;
        Ok(self.surveyed(facts))
    }
}

/// What a survey tells of the root.
#[derive(Clone, Copy, Debug)]
pub(super) struct Root<'a> {
    pub params: &'a Buffer<u32>,
    pub item: &'a Buffer<UVec4>,
    pub header: &'a Buffer<u32>,
    pub level: &'a Buffer<u32>,
    pub args: &'a Buffer<u32>,
    pub round: &'a Buffer<u32>,
    pub state: &'a Buffer<u32>,
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
