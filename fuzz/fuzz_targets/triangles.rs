//! Any bytes as triangles and rays.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| raykd_fuzz::triangles(bytes));
