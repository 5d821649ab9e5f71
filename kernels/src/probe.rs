//! Whether a device computes our float operations exactly: one row of results for the host to compare.

use crate::{
    glam::Vec4,
    math::{abs, exp2, two_product},
    mem::{Buf, Slots},
};

/// Results per input.
pub const RESULTS: u32 = 9;

/// Expressions that go wrong where a driver contracts, reassociates, rounds otherwise or flushes subnormals.
pub fn probe(i: u32, inputs: &Buf<Vec4>, results: &mut Buf<f32>, count: &Buf<u32>) {
    if i < count.at(0) {
        let v = inputs.at(i);
        let at = i * RESULTS;
        // Contraction into a fused multiply-add.
        results.put(at, v.x * v.y + v.z);
        results.put(at + 1, v.x * v.y - v.z * v.w);
        // Rearrangement.
        results.put(at + 2, v.x * v.y + v.x * v.z);
        results.put(at + 3, (v.x + v.y) - v.y);
        results.put(at + 4, (v.x + 1.25) + 2.5);
        // Rounding.
        results.put(at + 5, v.x + v.y);
        results.put(at + 6, v.x * v.y);
        // Subnormals: a tiny product.
        results.put(at + 7, (v.x * 1.0e-20) * (v.y * 1.0e-20));
        // What rounding takes from a product, in which a device may round once; not of tiny or huge ones.
        let size = abs(v.x * v.y);
        let within = (size > exp2(-70)) & (size < exp2(100));
        results.put(at + 8, if within { two_product(v.x, v.y).1 } else { 0.0 });
    }
}

kernel! {
    /// [`probe`] over all inputs.
    map PROBE = probe, threads 64, { 0 inputs: read Vec4, 1 results: write f32, 2 count: read u32 }
}

/// The same for doubles.
pub mod doubles {
    use super::*;
    use crate::trace::intersect::wide::product;

    /// Results per input: three floats for each of four numbers, one for another.
    pub const RESULTS: u32 = 13;

    /// A double as three floats, exactly.
    #[inline(always)]
    fn put(results: &mut Buf<f32>, at: u32, x: f64) {
        let (first, rest) = (x as f32, x - f64::from(x as f32));
        results.put(at, first);
        results.put(at + 1, rest as f32);
        results.put(at + 2, (rest - f64::from(rest as f32)) as f32);
    }

    /// Of two doubles, made of two floats each: the sum, the product, what rounding took from that, times a power of
    /// two so that it is no tiny float, a difference that goes wrong if anything is rearranged, and a float.
    pub fn probe(i: u32, inputs: &Buf<Vec4>, results: &mut Buf<f32>, count: &Buf<u32>) {
        if i < count.at(0) {
            let v = inputs.at(i);
            let at = i * RESULTS;
            let small = f64::from(exp2(-30));
            let (a, b) = (f64::from(v.x) + f64::from(v.y) * small, f64::from(v.z) + f64::from(v.w) * small);
            let (all, rest) = product(a, b);
            put(results, at, a + b);
            put(results, at + 3, all);
            put(results, at + 6, rest * f64::from(exp2(90)));
            put(results, at + 9, (a + b) - b);
            results.put(at + 12, a as f32);
        }
    }

    kernel! {
        /// [`probe`] over all inputs.
        map_by_doubles PROBE_DOUBLES = probe, threads 64,
        { 0 inputs: read Vec4, 1 results: write f32, 2 count: read u32 }
    }
}

/// How quick doubles are beside floats.
pub mod race {
    use super::*;

    /// Products and sums of each lane.
    pub const ROUNDS: u32 = 64;

    /// Some arithmetic, by doubles if the first word of `by` is not 0, else by floats.
    pub fn race(i: u32, by: &Buf<u32>, results: &mut Buf<f32>) {
        let start = 1.0 + (i as f32) * exp2(-24);
        let mut round = 0;
        if by.at(0) != 0 {
            let (mut x, by) = (f64::from(start), f64::from(start));
            while round < ROUNDS {
                x = x * by - by;
                round += 1;
            }
            results.put(i, x as f32);
        } else {
            let mut x = start;
            while round < ROUNDS {
                x = x * start - start;
                round += 1;
            }
            results.put(i, x);
        }
    }

    kernel! {
        /// All lanes.
        map_by_doubles RACE = race, threads 64, { 0 by: read u32, 1 results: write f32 }
    }
}
