//! Random numbers that are the same everywhere.

use crate::dot;
use raykd_kernels::glam::Vec3;

/// A step of [`noise`]. What is divided in a constant is not divided on the GPU.
const STEP: f32 = 1.0 / 8_388_608.0;

/// A number from -1 to 1, made of an integer by PCG's hash. An `f32` has room for 24 bits.
fn noise(seed: u32) -> f32 {
    let state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (((word >> 22) ^ word) >> 8) as f32 * STEP - 1.0
}

/// A point of the unit ball.
pub(crate) fn in_ball(seed: u32) -> Vec3 {
    let (mut i, mut found) = (0, Vec3::new(1.0, 0.0, 0.0));
    while i < 24 {
        let d = Vec3::new(noise(seed + i), noise(seed + i + 1), noise(seed + i + 2));
        let inside = dot(d, d) < 1.0;
        found = if inside { d } else { found };
        i = if inside { 24 } else { i + 3 };
    }
    found
}
