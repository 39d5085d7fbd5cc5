//! From frequency to temperature: the calibration curve ([`curve`]), how a resonator follows its case ([`lag`]), static points
//! ([`points`]), and the soaks of a run from which they come ([`soaks`]).

pub mod curve;
pub mod lag;
pub mod points;
pub mod soaks;
