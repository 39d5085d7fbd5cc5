//! The library behind the program `hrg`: a unit on a port, data sheets, calibration images side by side, chamber profiles.
//!
//! | module | contents |
//! |---|---|
//! | [`mod@unit`] | a unit on a port: recordings from it, its log, its screen, sensors beside it |
//! | [`report`] | figures of a data sheet from recordings alone |
//! | [`judge`] | does a unit stay within a limit over a range of temperatures |
//! | [`images`] | calibration images of one unit side by side: differences, trends |
//! | [`profiles`] | the effects that each chamber profile can distinguish |
#![forbid(unsafe_code)]

pub mod fleet;
pub mod images;
pub mod judge;
pub mod profiles;
pub mod report;
pub mod unit;
