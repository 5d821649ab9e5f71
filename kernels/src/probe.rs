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
