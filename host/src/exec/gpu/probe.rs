//! Whether a device computes our float operations as the CPU does, to the bit.

use crate::{
    Error,
    exec::{Buffer, Device, Launch, Out, Step},
};
use raykd_kernels::{
    glam::Vec4,
    probe::{self, RESULTS, doubles, race},
};
use std::time::Duration;

/// Inputs of the probe, in four families.
const INPUTS: u32 = 4096;
/// How many numbers a device computes of them: `u32`s in one buffer.
pub(super) const VALUES: u64 = (INPUTS * RESULTS) as u64;

/// What the start-up probe says about an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AdapterVerdict {
    /// It computes float operations exactly.
    Exact {
        /// Whether it keeps subnormal results rather than flushing them to zero. raykd's results do not depend
        /// on it.
        subnormals: bool,
    },
    /// It does not, for this reason, and is refused.
    Inexact(String),
    /// It cannot run the kernels at all, for this reason.
    Unusable(String),
}

/// Runs the probe on a device and on the CPU. Also says whether the device finds what rounding takes from products.
pub(super) fn check(device: &Device) -> Result<(AdapterVerdict, bool), Error> {
    Ok(judge(&results(&Device::cpu())?, &results(device)?))
}

/// Deterministic inputs: pseudo-random numbers near 1 and over a wider range, never near overflow or underflow,
/// and combinations that show one fault clearly.
fn inputs() -> impl Iterator<Item = [f32; 4]> {
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    let mut number = move |spread: u64| {
        state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
        let bits = state >> 33;
        let exponent = 127 - spread + (state >> 8) % (2 * spread + 1);
        f32::from_bits(
            ((bits << 31) as u32 & 0x8000_0000) | (exponent as u32) << 23 | (bits >> 8) as u32 & 0x7F_FFFF,
        )
    };
    (0..INPUTS).map(move |i| match i % 4 {
        0 => [number(1), number(1), number(1), number(1)],
        1 => [number(20), number(20), number(20), number(20)],
        2 => {
            // x * y + z is the rounding error of x * y if contracted, and 0 if not.
            let (x, y) = (number(4), number(4));
            [x, y, -(x * y), -1.0]
        }
        _ => {
            // x is of the size of y's last bit: (x + y) - y is x if rearranged, and a multiple of it if not.
            let (x, y) = (number(1), number(1));
            [x, y * 8_388_608.0, y, x]
        }
    })
}

/// What a device makes of the inputs.
fn results(device: &Device) -> Result<Vec<u32>, Error> {
    asked(device, RESULTS, |inputs, results, count| probe::Buffers { inputs, results, count }.over(INPUTS))
}

/// The same by doubles.
fn results_of_doubles(device: &Device) -> Result<Vec<u32>, Error> {
    asked(device, doubles::RESULTS, |inputs, results, count| {
        doubles::Buffers { inputs, results, count }.over(INPUTS)
    })
}

/// What a probe of so many results an input makes of the inputs.
fn asked(
    device: &Device,
    each: u32,
    probe: impl for<'a> Fn(&'a Buffer<Vec4>, Out<'a, f32>, &'a Buffer<u32>) -> Step<'a>,
) -> Result<Vec<u32>, Error> {
    let values = u64::from(INPUTS * each);
    let inputs = device.upload("probe inputs", &inputs().map(Vec4::from_array).collect::<Vec<_>>())?;
    let results = device.alloc("probe results", values)?;
    let count = device.upload("probe count", &[INPUTS])?;
    device.dispatch(&[probe(&inputs, results.out(), &count)], false)?;
    device.read(&results.view(), 0, values as usize)
}

/// Whether a device computes doubles as the CPU does, by such numbers.
pub(super) fn doubles_are_right(device: &Device) -> Result<bool, Error> {
    Ok(results_of_doubles(device)? == results_of_doubles(&Device::cpu())?)
}

/// Whether a product and a sum of doubles take it at most twice the time of one of floats.
pub(super) fn doubles_are_quick(device: &Device) -> Result<bool, Error> {
    /// Enough for a card to be busy with.
    const LANES: u32 = 1 << 16;
    let results = device.alloc("race results", u64::from(LANES))?;
    let by = [device.upload("race by", &[0])?, device.upload("race by", &[1])?];
    let mut times = [Duration::MAX; 2];
    for _ in 0..4 {
        for (by, time) in by.iter().zip(&mut times) {
            let race = race::Buffers { by, results: results.out() };
            *time = (*time).min(device.dispatch(&[race.over(LANES)], false)?.total);
        }
    }
    Ok(times[1] <= 2 * times[0])
}

/// Compares what a device computed with what is right, for [`check`].
fn judge(right: &[u32], found: &[u32]) -> (AdapterVerdict, bool) {
    let mut wrong = [0u32; RESULTS as usize];
    for (right, found) in right.chunks(RESULTS as usize).zip(found.chunks(RESULTS as usize)) {
        for (wrong, (right, found)) in wrong.iter_mut().zip(right.iter().zip(found)) {
            *wrong += u32::from(right != found);
        }
    }
    let rounded = wrong[5] + wrong[6];
    let contracted = wrong[0] + wrong[1];
    let rearranged = wrong[2] + wrong[3] + wrong[4];
    let of = |count: u32, kinds: u32| format!("in {count} of {} cases", kinds * INPUTS);
    let rests = wrong[8] == 0;
    if rounded > 0 {
        let reason = format!("it rounds sums or products otherwise {}", of(rounded, 2));
        return (AdapterVerdict::Inexact(reason), rests);
    }
    let mut faults = Vec::new();
    if contracted > 0 {
        faults.push(format!("contracts a product and a sum into one rounding {}", of(contracted, 2)));
    }
    if rearranged > 0 {
        faults.push(format!("rearranges sums and products {}", of(rearranged, 3)));
    }
    if faults.is_empty() && !rests {
        faults.push(format!("finds what rounding takes from a product wrongly {}", of(wrong[8], 1)));
    }
    let verdict = if faults.is_empty() {
        AdapterVerdict::Exact { subnormals: wrong[7] == 0 }
    } else {
        AdapterVerdict::Inexact(format!("it {}", faults.join(" and ")))
    };
    (verdict, rests)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a device with a fault would compute: one expression of each input replaced.
    fn faulty(result: usize, expression: impl Fn([f32; 4]) -> f32) -> AdapterVerdict {
        let right = results(&Device::cpu()).unwrap();
        let mut found = right.clone();
        for (input, found) in inputs().zip(found.chunks_mut(RESULTS as usize)) {
            found[result] = expression(input).to_bits();
        }
        judge(&right, &found).0
    }

    fn refused(verdict: &AdapterVerdict, word: &str) {
        assert!(matches!(verdict, AdapterVerdict::Inexact(reason) if reason.contains(word)), "{verdict:?}");
    }

    #[test]
    fn faithful_device_passes() {
        assert_eq!(faulty(0, |[x, y, z, _]| x * y + z), AdapterVerdict::Exact { subnormals: true });
    }

    #[test]
    fn rests_of_products_are_looked_at() {
        let right = results(&Device::cpu()).unwrap();
        let mut found = right.clone();
        assert!(judge(&right, &found).1);
        found[8] ^= 1;
        assert!(!judge(&right, &found).1);
    }

    #[test]
    fn flushed_subnormals_are_reported_only() {
        let flush = |v: f32| if v.is_subnormal() { 0.0 } else { v };
        let verdict = faulty(7, |[x, y, ..]| flush((x * 1.0e-20) * (y * 1.0e-20)));
        assert_eq!(verdict, AdapterVerdict::Exact { subnormals: false });
    }

    #[test]
    fn each_fault_is_refused() {
        refused(&faulty(0, |[x, y, z, _]| x.mul_add(y, z)), "contracts");
        refused(&faulty(1, |[x, y, z, w]| x.mul_add(y, -(z * w))), "contracts");
        refused(&faulty(2, |[x, y, z, _]| x * (y + z)), "rearranges");
        refused(&faulty(3, |[x, ..]| x), "rearranges");
        refused(&faulty(4, |[x, ..]| x + 3.75), "rearranges");
        let truncated = |exact: f64| {
            let near = exact as f32;
            if f64::from(near).abs() > exact.abs() { f32::from_bits(near.to_bits() - 1) } else { near }
        };
        refused(&faulty(8, |_| 0.0), "from a product");
        refused(&faulty(5, |[x, y, ..]| truncated(f64::from(x) + f64::from(y))), "rounds");
        refused(&faulty(6, |[x, y, ..]| truncated(f64::from(x) * f64::from(y))), "rounds");
    }

    #[test]
    fn results_that_count_are_never_subnormal() {
        for row in results(&Device::cpu()).unwrap().chunks(RESULTS as usize) {
            for &bits in row[..7].iter().chain(&row[8..]) {
                let value = f32::from_bits(bits);
                assert!(value.is_normal() || value == 0.0, "{value}");
            }
        }
    }

    #[test]
    fn doubles_are_looked_at_to_the_last_digit() {
        let results = results_of_doubles(&Device::cpu()).unwrap();
        let mut seen = [0; doubles::RESULTS as usize];
        for row in results.chunks(doubles::RESULTS as usize) {
            for (seen, &bits) in seen.iter_mut().zip(row) {
                let value = f32::from_bits(bits);
                assert!(value.is_normal() || value == 0.0, "{value}");
                *seen += u32::from(value != 0.0);
            }
        }
        assert!(seen.iter().all(|&seen| seen > 50), "{seen:?}");
    }
}
