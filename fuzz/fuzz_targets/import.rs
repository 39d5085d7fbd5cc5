//! See `src/import.rs`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hrg_fuzz::import::run(data));
