//! Any bytes as a tree file, and any bytes as a tree with a right checksum: refused, or traced without harm.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| raykd_fuzz::tree(bytes));
