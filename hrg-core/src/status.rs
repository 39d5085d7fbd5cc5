//! Status bits: what the unit says about the numbers it sends.
//!
//! A rate whose axis bits and unit bits are all zero is one that the unit stands behind. The bits of an axis and those of the unit
//! are two types, which do not mix.
//!
//! # Example
//! ```
//! use hrg_core::status::AxisStatus;
//!
//! let status = AxisStatus::SETTLING | AxisStatus::TEMPERATURE_RANGE;
//! assert!(status.intersects(AxisStatus::UNTRUSTED_TEMPERATURE));
//! assert_eq!(AxisStatus::NAMES[status.bits().trailing_zeros() as usize], "temperature-range");
//! ```

use bitflags::bitflags;

bitflags! {
    /// Bits of one axis.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct AxisStatus: u16 {
        /// No calibration of this unit is loaded, or it holds nothing of this axis: the rate is raw. Or the one that is gives a number that is not finite.
        const UNCALIBRATED = 1 << 0;
        /// The temperature is outside the calibrated range: the model is continued linearly.
        const TEMPERATURE_RANGE = 1 << 1;
        /// The rate of change of temperature is outside the calibrated range, or changed within a second by twice that.
        const RAMP_RANGE = 1 << 2;
        /// No frequency in the last model step, or an implausible one ([`crate::thermal::BEYOND_C`]), or a jump beyond what is
        /// physically possible ([`crate::thermal::MAX_STEP_C`]): the last bias is held.
        const FREQUENCY_LOST = 1 << 3;
        /// The temperature is older than [`crate::compensator::HOLD_S`] seconds, or there never was one, or the model has not
        /// given a bias for [`crate::rate_path::STALE_MS`].
        const TEMPERATURE_STALE = 1 << 4;
        /// The ADC of the rate is at its end of scale.
        const OVER_RANGE = 1 << 5;
        /// Edges were rejected or missing in the last model step (the frequency is good all the same).
        const EDGE_ERRORS = 1 << 6;
        /// The model's states are still filling (first [`crate::rate_of_change::WINDOW`] seconds, and as long after a jump of
        /// the frequency that stays).
        const SETTLING = 1 << 7;
        /// An effect of the calibration does not know its past: power was switched on less than three of its time constants ago, or
        /// the temperature has not yet swept its width ([`crate::history`]). The stated uncertainty holds what that means.
        const HISTORY_UNKNOWN = 1 << 8;
        /// An effect of the calibration looks at the temperature of another axis, and that axis is flagged
        /// ([`AxisStatus::UNTRUSTED_TEMPERATURE`]); or the misalignment takes a share of the rate of another axis, and that one is
        /// over its range.
        const NEIGHBOUR = 1 << 9;
        /// The temperature or its ramp is outside the range of the fit of scale factor and misalignment, whose value at the end of the
        /// range is used; or they were impossible and are limited ([`crate::rate_factors`]).
        const SCALE_FACTOR = 1 << 10;
        /// The fit has not seen this temperature and this ramp together ([`crate::visited`]), though each may lie in its range: the stated
        /// uncertainty is that much larger, and grows with the distance beyond a range.
        const EXTRAPOLATED = 1 << 11;
        /// An input that the calibration needs beside the frequencies is missing, stale ([`crate::inputs::Input::counts_s`]) or outside
        /// the range in which it was learnt: the stated uncertainty is larger by what the input's effects were ([`crate::inputs`]).
        const INPUT = 1 << 12;
    }
}

bitflags! {
    /// Bits of the unit.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct UnitStatus: u16 {
        /// The ADC sent nothing, or a frame with a wrong checksum, or samples were lost, repeated or not at their rate, since the last frame
        /// out; or a rate channel has given the same
        /// code for [`crate::rate_path::STUCK_SAMPLES`].
        const ADC_FAULT = 1 << 0;
        /// A bias arrived after the sample at which it was due.
        const BIAS_LATE = 1 << 1;
        /// Garbage was seen on the link in the last second, or an alignment command was refused.
        const LINK_ERRORS = 1 << 2;
        /// Frames out were dropped because the link could not keep up.
        const FRAMES_DROPPED = 1 << 3;
        /// The compiled-in default is used: no valid image in flash.
        const DEFAULT_CALIBRATION = 1 << 4;
        /// The clock is not to be trusted: the crystal is dead or wrong and the unit runs on the chip's own oscillator (off by up to some
        /// percent, so no temperature is right), or it is further off its pulse per second than [`crate::pps::BOUND`].
        const TIMEBASE = 1 << 5;
        /// An image in flash was refused (wrong length, version, checksum or number).
        const IMAGE_REFUSED = 1 << 6;
        /// The program in flash has changed, or bits of memory do not hold what is written ([`crate::self_test`]): what the unit computes is not to be
        /// trusted.
        const PROGRAM = 1 << 7;
        /// The supply is below what the processor needs at its full speed (2.75 V at the least, in the last 0.1 s).
        const SUPPLY = 1 << 8;
        /// The watchdog's oscillator does not run: a program that hangs is not started anew.
        const WATCHDOG = 1 << 9;
    }
}

impl AxisStatus {
    /// The temperature of the axis is not to be trusted.
    pub const UNTRUSTED_TEMPERATURE: Self =
        Self::TEMPERATURE_RANGE.union(Self::RAMP_RANGE).union(Self::FREQUENCY_LOST).union(Self::TEMPERATURE_STALE);

    /// Name of each bit in files and on screens, bit 0 first.
    pub const NAMES: [&str; 13] = [
        "uncalibrated",
        "temperature-range",
        "ramp-range",
        "frequency-lost",
        "temperature-stale",
        "over-range",
        "edge-errors",
        "settling",
        "history-unknown",
        "neighbour",
        "scale-factor",
        "extrapolated",
        "input",
    ];
}

impl UnitStatus {
    /// Name of each bit in files and on screens, bit 0 first.
    pub const NAMES: [&str; 10] = [
        "adc-fault",
        "bias-late",
        "link-errors",
        "frames-dropped",
        "default-calibration",
        "timebase",
        "image-refused",
        "program",
        "supply",
        "watchdog",
    ];
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn each_bit_has_the_name_of_its_flag() {
        let name = |constant: &str| constant.to_lowercase().replace('_', "-");
        for (k, (constant, flag)) in AxisStatus::all().iter_names().enumerate() {
            assert_eq!((flag.bits(), AxisStatus::NAMES[k]), (1 << k, name(constant).as_str()));
        }
        for (k, (constant, flag)) in UnitStatus::all().iter_names().enumerate() {
            let place = flag.bits().trailing_zeros() as usize;
            assert_eq!((place >= k, UnitStatus::NAMES[place]), (true, name(constant).as_str()));
        }
    }
}
