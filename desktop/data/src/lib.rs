//! Recordings and calibration files in and out, and the numerics that every tool shares.
//!
//! | module | contents |
//! |---|---|
//! | [`recording`] | recordings: readers, writers, defects, other programs' files, model steps |
//! | [`image_file`] | the calibration image as a text file |
//! | [`cards`] | one card for each effect: what the desktop knows of it beyond its equation |
//! | [`cost`] | cost of a calibration image on the unit |
//! | [`numeric`] | least squares, statistics, Allan deviation |
//! | [`log`] | the unit's log, decoded |
//! | [`plot`] | pictures |
//! | [`files`], [`output`] | the one reader and the one writer of files |
//! | [`error`] | bad input, and how a program ends |
//!
//! Regressors are produced by `hrg_core`, by the code that runs on the unit.
#![forbid(unsafe_code)]

pub mod axes;
pub mod cards;
pub mod cost;
pub mod error;
pub mod files;
pub mod image_file;
pub mod load;
pub mod log;
pub mod numeric;
pub mod output;
pub mod page;
pub mod plot;
pub mod recording;
