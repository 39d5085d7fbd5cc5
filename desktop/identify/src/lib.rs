//! Identification: from recordings to a thermometer, a bias model, the effects that the model lacks, the scale factors, and the accelerometers.
//!
//! | module | contents |
//! |---|---|
//! | [`thermometer`] | frequency to temperature, the lag of a resonator, static points |
//! | [`fit`] | recordings made ready, enough data behind a fit, a run corrected by the unit's code |
//! | [`trace`] | the effects that a model lacks |
//! | [`family`] | what the units of one design share, and what that spares the next one |
//! | [`rates`] | scale factor and misalignment over temperature from runs on a rate table |
//! | [`forces`] | accelerometers over temperature from runs in positions |
#![forbid(unsafe_code)]

pub mod family;
pub mod fit;
pub mod forces;
mod matrices;
pub mod rates;
pub mod thermometer;
pub mod trace;
