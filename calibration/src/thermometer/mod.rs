//! From frequency to temperature: the calibration curve ([`curve`]), how a resonator follows its case ([`lag`]), static points
//! ([`points`]).

pub mod curve;
pub mod lag;
pub mod points;
