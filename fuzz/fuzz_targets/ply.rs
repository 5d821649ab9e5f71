//! Any bytes as an PLY file: a mesh or an error, and a mesh can be built and traced.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| raykd_fuzz::mesh("fuzz.ply", bytes));
