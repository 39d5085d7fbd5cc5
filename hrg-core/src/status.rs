//! Status bits: what the unit says about the numbers it sends.
//!
//! A rate whose axis byte and unit byte are both zero is one that the unit stands behind.

/// Bits of one axis.
pub mod axis {
    /// No calibration of this unit is loaded: the rate is raw. Or the one that is gives a number that is not finite.
    pub const UNCALIBRATED: u8 = 1 << 0;
    /// The temperature is outside the calibrated range: the model is continued linearly.
    pub const TEMPERATURE_RANGE: u8 = 1 << 1;
    /// The rate of change of temperature is outside the calibrated range, or changed within a second by twice that.
    pub const RAMP_RANGE: u8 = 1 << 2;
    /// No frequency in the last model step, or one that is no resonator's ([`crate::thermal::BEYOND_C`]) or jumped further than one can
    /// ([`crate::thermal::MAX_STEP_C`]): the last bias is held.
    pub const FREQUENCY_LOST: u8 = 1 << 3;
    /// The temperature is older than [`crate::compensator::HOLD_S`] seconds, or there never was one, or the model has not
    /// spoken for [`crate::rate_path::STALE_TICKS`].
    pub const TEMPERATURE_STALE: u8 = 1 << 4;
    /// The rate converter is at its end of scale.
    pub const OVER_RANGE: u8 = 1 << 5;
    /// Edges were rejected or missing in the last model step (the frequency is good all the same).
    pub const EDGE_ERRORS: u8 = 1 << 6;
    /// The model's states are still filling (first [`crate::rate_of_change::WINDOW`] seconds, and as long after a jump of
    /// the frequency that stays).
    pub const SETTLING: u8 = 1 << 7;

    /// Name of each bit, bit 0 first.
    pub const NAMES: [&str; 8] = [
        "uncalibrated",
        "temperature-range",
        "ramp-range",
        "frequency-lost",
        "temperature-stale",
        "over-range",
        "edge-errors",
        "settling",
    ];
}

/// Bits of the unit.
pub mod unit {
    /// The converter sent nothing, or a frame with a wrong checksum, since the last frame out; or a rate channel has given
    /// the same code for [`crate::rate_path::STUCK_SAMPLES`].
    pub const CONVERTER_FAULT: u8 = 1 << 0;
    /// A bias arrived after the sample at which it was due.
    pub const BIAS_LATE: u8 = 1 << 1;
    /// Garbage was seen on the link in the last second.
    pub const LINK_ERRORS: u8 = 1 << 2;
    /// Frames out were dropped because the link could not keep up.
    pub const FRAMES_DROPPED: u8 = 1 << 3;
    /// The compiled-in default is used: no valid block in flash.
    pub const DEFAULT_CALIBRATION: u8 = 1 << 4;
    /// The last reset came from the watchdog.
    pub const WATCHDOG_RESET: u8 = 1 << 5;
    /// A block in flash was refused (wrong length, version, checksum or number).
    pub const BLOCK_REFUSED: u8 = 1 << 6;

    /// Name of each bit, bit 0 first.
    pub const NAMES: [&str; 8] = [
        "converter-fault",
        "bias-late",
        "link-errors",
        "frames-dropped",
        "default-calibration",
        "watchdog-reset",
        "block-refused",
        "-",
    ];
}
