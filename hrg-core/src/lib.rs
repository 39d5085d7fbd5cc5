#![doc = include_str!("../README.md")]
//!
//! # The field in one page
//! An HRG is a wine glass of fused silica that rings at a few kilohertz. In *force-rebalance* mode a loop
//! holds the vibration pattern still relative to the case; the force that takes is the *rate*. A small error
//! of that rate, the *bias*, changes with temperature. The *resonator frequency* changes with temperature
//! too (about 100 ppm per degree), smoothly and repeatably, so the resonator is its own thermometer, and a
//! better one than any sensor outside the vacuum.
//!
//! The chain, each link one module:
//!
//! | step | module | rate |
//! |---|---|---|
//! | timer captures of the pick-off's edges to frequency | [`frequency`] | each edge; a result each 0.1 s gate |
//! | frequency to temperature | [`temperature`] | 1 Hz |
//! | temperature to its rate of change | [`rate_of_change`] | 1 Hz |
//! | temperature and its rate to bias | [`bias`], [`effects`] | 1 Hz |
//! | the thermal state of the three axes | [`thermal`] | 1 Hz |
//! | their biases | [`compensator`] | 1 Hz |
//! | their scale factors and misalignments | [`rate_factors`] | 1 Hz |
//! | raw rate to corrected rate | [`rate_path`] | 1 kHz in, 200 Hz out |
//! | bytes on the wire | [`link`] | 200 Hz |
//! | coefficients, in flash and in a file | [`calibration`] | at start |
//!
//! # One sign rule
//! `corrected = M(T) * S(T) * (raw - bias)`, everywhere; it stands in [`rate_factors`]. Without a scale factor and misalignment over
//! temperature in the image, `M` and `S` are exactly one.
//!
//! # What is calibrated is what flies
//! The desktop tools call this very crate to make the regressors of a fit, so a coefficient means the same
//! to the fit and to the unit. Nothing here depends on scheduling: given the same time stamps and ADC
//! codes, the results are the same bit for bit on a desktop and on the target. Arithmetic is plain f32 (f64
//! where a carrier must be subtracted), transcendental functions come from `libm` and [`math`], and the compiler never
//! fuses a multiply with an add in Rust.
#![no_std]
#![forbid(unsafe_code)]

pub mod accelerometers;
pub mod adc;
pub mod align_mode;
pub mod bias;
pub mod bytes;
pub mod calibration;
pub mod chip;
pub mod compensator;
pub mod effects;
pub mod events;
pub mod filter;
pub mod frequency;
pub mod gnss;
pub mod half;
pub mod history;
pub mod increments;
pub mod inputs;
pub mod link;
pub mod maintenance;
pub mod math;
pub mod mavlink;
pub mod option_bytes;
pub mod output;
pub mod parts;
#[cfg(test)]
mod power_cut;
pub mod pps;
pub mod rate_factors;
pub mod rate_of_change;
pub mod rate_output;
pub mod rate_path;
pub mod reset;
pub mod schema;
pub mod sectors;
pub mod self_test;
pub mod sensors;
pub mod signature;
pub mod slots;
pub mod specific_force;
pub mod status;
pub mod still;
pub mod stopped;
pub mod supervision;
pub mod telemetry;
pub mod temperature;
pub mod thermal;
pub mod timebase;
pub mod unit_name;
pub mod update;
pub mod uptime;
pub mod visited;
pub mod zero;

/// Axes of a unit: x, y, z.
pub const AXES: usize = 3;

/// The interval of the bias model, in seconds.
///
/// Frequencies are combined to gates of this length and every state of the model (windows, lags) advances
/// once per step. A recording is brought to this interval before a fit, so the states mean the same there.
pub const MODEL_STEP_S: f32 = 1.0;
