//! Calls of the library in any order: errors or right answers.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| raykd_fuzz::api(bytes));
