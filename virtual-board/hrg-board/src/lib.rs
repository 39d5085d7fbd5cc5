//! Ties the virtual board to recordings of HRG runs.
//!
//! | module | does |
//! |---|---|
//! | [`wires`] | turns a recording into edges and converter codes, and collects what the unit sends |
//! | [`twin`] | runs `hrg_core` on the desktop over the same time stamps and codes, and compares every frame |
//! | [`demo`] | the main job from end to end |
//! | [`faults`] | attacks the promises of docs/promises.md |
//! | [`replay`] | a whole run: ELF, calibration, recording in; corrected recording, log and figures out |
#![forbid(unsafe_code)]

pub mod align;
pub mod bench;
pub mod demo;
pub mod faults;
pub mod methods;
pub mod replay;
pub mod serve;
pub mod twin;
pub mod weigh;
pub mod wires;
