//! Random numbers that are the same everywhere.

use crate::vector::{dot, normalize};

/// A small random number generator (SplitMix64, Steele, Lea & Flood 2014): the same numbers everywhere. For
/// raykd's own scenes and tests.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Starts a sequence.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 random bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number in `0 <= x < 1`.
    pub const fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// A whole number below `n`, which is not 0.
    pub const fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// A number from -1 to 1.
    pub const fn signed(&mut self) -> f32 {
        (self.unit() * 2.0 - 1.0) as f32
    }

    /// A point of the cube from -1 to 1.
    pub fn point(&mut self) -> [f32; 3] {
        [(); 3].map(|()| self.signed())
    }

    /// A point at most `size` from `p` along every axis.
    pub fn near(&mut self, p: [f32; 3], size: f32) -> [f32; 3] {
        p.map(|x| x + size * self.signed())
    }

    /// A point inside the unit ball.
    pub(crate) fn ball(&mut self) -> [f64; 3] {
        loop {
            let p = [(); 3].map(|()| self.unit() * 2.0 - 1.0);
            let length = dot(p, p);
            if length <= 1.0 && length > 1e-6 {
                return p;
            }
        }
    }

    /// A point on the unit sphere.
    pub(crate) fn sphere(&mut self) -> [f64; 3] {
        normalize(self.ball())
    }
}
