//! Ties the virtual board to recordings of HRG runs.
//!
//! | module | does |
//! |---|---|
//! | [`wires`] | turns a recording into edges and ADC codes, and collects what the unit sends |
//! | [`twin`] | runs `hrg_core` on the desktop over the same time stamps and codes, and compares every frame |
//! | [`bring_up`] | the program for a bare board with jumpers, on the virtual board |
//! | [`replay`] | a whole run: ELF, calibration, recording in; corrected recording, log and figures out |
#![forbid(unsafe_code)]

pub mod bring_up;
pub mod chip_tests;
pub mod cost;
pub mod host;
pub mod motion;
pub mod replay;
pub mod serve;
pub mod twin;
pub mod wires;

/// The variable of the firmware that holds the states kept over a reset.
pub const KEPT_STATES: &str = "_kept_states";
/// The word that says that the unit was at rest before a reset, and its value then.
pub const KEPT_REST: (&str, u32) = ("_kept_rest", 0x4852_4701);
/// The word of RAM that says which program ran last, by its sum.
pub const RAN_LAST: &str = "_ran_last";

/// Functions that are functions of their own in the ELF, and whose calls the board counts: their paths.
pub mod symbol {
    /// A model step of the three axes.
    pub const UPDATE: &str = "hrg_core::compensator::Model<P>::update";
    /// The bias model of an axis, without effects.
    pub const BIAS: &str = "hrg_core::bias::Coefficients::bias_dph";
    /// The temperature curve.
    pub const CURVE: &str = "hrg_core::temperature::TemperatureCurve::value_and_slope";
    /// An ADC frame.
    pub const DECODE: &str = "hrg_fast::receive";
    /// A sample corrected.
    pub const SAMPLE: &str = "hrg_fast::sample";
    /// A rate frame as it is sent.
    pub const ENCODE: &str = "hrg_fast::encode";
}
