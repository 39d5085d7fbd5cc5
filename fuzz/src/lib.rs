//! Fuzz targets, a module each. `cargo xtask fuzz` drives them by their coverage; `host-tests/tests/all/corpus.rs` runs the kept inputs and
//! others like them with every test run.

pub mod calibration;
pub mod import;
pub mod link;
pub mod log;
pub mod recording;
pub mod unit;
