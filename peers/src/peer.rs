//! What every peer is asked, and what it answers.

use raykd::{Ray, shared::MISS};
use std::time::{Duration, Instant};

/// How far, relative to `t`, an answer may lie from the exact one: grazing rays reach 5e-3 in f32.
pub const NEAR: f32 = 5.0e-3;

/// What a peer found.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    pub triangle: u32,
    pub t: f32,
}

impl Answer {
    pub const MISS: Self = Self { triangle: MISS, t: f32::INFINITY };

    pub const fn is_hit(self) -> bool {
        self.triangle != MISS
    }

    /// The same up to rounding, whichever of two triangles at an edge it is.
    pub fn agrees(self, other: Self) -> bool {
        let tolerance = if self.triangle == other.triangle { NEAR } else { 1.0e-4 };
        let near = (self.t - other.t).abs() <= tolerance * self.t.abs();
        self.is_hit() == other.is_hit() && (!self.is_hit() || near)
    }
}

pub type Trace<'a> = Box<dyn Fn(&[Ray]) -> (Duration, Vec<Answer>) + 'a>;

/// A crate with its tree.
pub struct Peer<'a> {
    pub name: &'static str,
    pub build: Duration,
    pub closest: Trace<'a>,
    pub any: Option<Trace<'a>>,
}

pub fn timed<T>(work: impl FnOnce() -> T) -> (Duration, T) {
    let start = Instant::now();
    let done = work();
    (start.elapsed(), done)
}

/// A trace, ray by ray.
pub fn each<'a>(one: impl Fn(&Ray) -> Answer + 'a) -> Trace<'a> {
    Box::new(move |rays| timed(|| rays.iter().map(&one).collect()))
}
