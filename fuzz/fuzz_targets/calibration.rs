//! See `src/calibration.rs`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hrg_fuzz::calibration::run(data));
