//! Align mode of a unit, as link and telemetry see it: commands of the host in, one report each second out. The alignment itself is
//! in the crate `hrg-align`; a firmware without it has [`NotBuiltIn`] in its place.
//!
//! # Example
//! ```
//! use hrg_core::align_mode::{AlignMode, Command, NotBuiltIn, NOT_BUILT_IN};
//! use hrg_core::rate_path::Summary;
//!
//! let mut mode = NotBuiltIn::default();
//! assert_eq!(mode.command(Command::Begin { latitude_deg: 45.0, gravity_mps2: 0.0, velocity_noise_mps: 0.002 }), None);
//! // The host is told once why there is no alignment.
//! let second = Summary {
//!     step: 0,
//!     samples: 1000,
//!     raw_dph: [0.0; 3],
//!     corrected_dph: [0.0; 3],
//!     adc_errors: 0,
//!     accelerometer_codes: [0; 2],
//!     accelerometer_saturated: false,
//! };
//! assert_eq!(mode.second(&second).map(|r| r.refusal), Some(NOT_BUILT_IN));
//! assert!(mode.second(&second).is_none() && !mode.running());
//! ```

use crate::accelerometers::Accelerometers;
use crate::rate_path::Summary;
use crate::AXES;

/// Number of the refusal of a firmware that was built without alignment.
pub const NOT_BUILT_IN: u8 = 13;

/// Alignment command of the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Begin an alignment: latitude (degrees), gravity (m/s^2; 0: normal gravity), noise of a velocity reading (m/s).
    Begin {
        /// Latitude, degrees.
        latitude_deg: f32,
        /// Gravity, m/s^2.
        gravity_mps2: f32,
        /// Velocity noise, m/s.
        velocity_noise_mps: f32,
    },
    /// Drifts and tilts that the next alignment expects, one sigma; 0: as usual (the defaults of the filter).
    Expect {
        /// Drifts, deg/h.
        drift_dph: f32,
        /// Tilts at the start, arc minutes.
        tilt_arcmin: f32,
    },
    /// The turn begins.
    TurnBegins,
    /// The turn has ended.
    TurnEnded {
        /// Its angle about axis 3, clockwise from above, degrees.
        angle_deg: f32,
    },
    /// Leave align mode, the drifts becoming a bias trim.
    Accept,
    /// Leave align mode.
    Abandon,
}

/// Stage of an alignment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Stage {
    /// In the first position.
    First = 1,
    /// Between the positions.
    Turning = 2,
    /// In the second position.
    Second = 3,
    /// Over: refused at its beginning, accepted or abandoned.
    Over = 4,
}

/// Each second of an alignment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Report {
    /// Number of the second, from the start of the alignment.
    pub second: u32,
    /// Stage.
    pub stage: u8,
    /// Number of the refusal (`hrg_align::Refusal`) if there is no result; 0: the numbers are a result.
    pub refusal: u8,
    /// Azimuth, degrees; NaN unless it is a result.
    pub azimuth_deg: f32,
    /// Its standard deviation, arc minutes (given always).
    pub azimuth_std_arcmin: f32,
    /// Tilts, arc minutes.
    pub tilt_arcmin: [f32; 2],
    /// Drifts, deg/h.
    pub drift_dph: [f32; 2],
    /// Their standard deviations, deg/h.
    pub drift_std_dph: [f32; 2],
    /// Check of the two positions; NaN where the filter has none.
    pub integrity: f32,
}

/// The align mode of a unit, whatever it was built with.
pub trait AlignMode {
    /// Takes a command of the host; gives the bias trim, deg/h, to be subtracted, where an alignment was accepted.
    fn command(&mut self, command: Command) -> Option<[f32; AXES]>;
    /// Takes the summary of a second; gives a report while an alignment runs, and once when it ends.
    fn second(&mut self, summary: &Summary) -> Option<Report>;
    /// `true` while an alignment runs.
    fn running(&self) -> bool;
    /// Takes these errors of the accelerometers out of all velocities from now on.
    fn set_accelerometers(&mut self, accelerometers: Accelerometers);
}

/// Align mode of a firmware without alignment: each beginning is refused with [`NOT_BUILT_IN`].
#[derive(Debug, Clone, Copy, Default)]
pub struct NotBuiltIn {
    asked: bool,
}

impl NotBuiltIn {
    /// Nothing was asked.
    pub const IDLE: Self = Self { asked: false };
}

impl AlignMode for NotBuiltIn {
    fn command(&mut self, command: Command) -> Option<[f32; AXES]> {
        self.asked |= matches!(command, Command::Begin { .. });
        None
    }
    fn second(&mut self, _: &Summary) -> Option<Report> {
        let none = Report {
            stage: Stage::Over as u8,
            refusal: NOT_BUILT_IN,
            azimuth_deg: f32::NAN,
            azimuth_std_arcmin: f32::NAN,
            tilt_arcmin: [f32::NAN; 2],
            drift_dph: [f32::NAN; 2],
            drift_std_dph: [f32::NAN; 2],
            integrity: f32::NAN,
            ..Report::default()
        };
        core::mem::take(&mut self.asked).then_some(none)
    }
    fn running(&self) -> bool {
        false
    }
    fn set_accelerometers(&mut self, _: Accelerometers) {}
}
