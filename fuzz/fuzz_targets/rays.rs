//! Any bytes as a file of rays at the teapot.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| raykd_fuzz::rays(bytes));
