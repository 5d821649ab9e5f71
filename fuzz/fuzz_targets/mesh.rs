//! Any bytes as a mesh file of each format: a mesh or an error, and a mesh can be built and traced.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| raykd_fuzz::mesh(bytes));
