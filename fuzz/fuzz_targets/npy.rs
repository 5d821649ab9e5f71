//! Any bytes as an array of points or rays.
#![no_main]

#[expect(dead_code, reason = "writing is not for any bytes")]
#[path = "../../cli/src/npy.rs"]
mod npy;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = npy::rows::<3>(bytes, "points");
    let _ = npy::rows::<8>(bytes, "rays");
});
