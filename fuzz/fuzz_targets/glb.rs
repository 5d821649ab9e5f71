//! Any bytes as a glTF file, binary or not: a mesh or an error, and a mesh can be built and traced.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| raykd_fuzz::mesh("fuzz.glb", bytes));
