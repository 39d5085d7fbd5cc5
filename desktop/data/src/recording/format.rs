//! Thermometers of the axes of a recording: their resonators, or sensors.
//!
//! A resonator needs a curve from frequency to temperature. A sensor gives the temperature itself; the unit's code then runs with
//! the curve `T = T`, so that a unit with sensors is calibrated, corrected and judged by the same code as one with resonators.

use super::columns::{self, Column, Role};
use crate::axes::AXIS_NAMES;
use hrg_core::AXES;

/// Source of the temperatures of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Thermometer {
    /// Each axis' resonator: `f?_hz`, Hz.
    #[default]
    Frequency,
    /// A sensor for each axis: `temp_?_c`, C.
    Sensors,
    /// One sensor for all axes: `temp_c`, C.
    OneSensor,
    /// None (`# thermometer: none`): for what needs no temperature, as an Allan deviation at rest.
    None,
}

impl Thermometer {
    /// `true` if readings are temperatures.
    #[must_use]
    pub fn is_sensor(self) -> bool {
        matches!(self, Self::Sensors | Self::OneSensor)
    }

    /// The column of an axis' readings.
    #[must_use]
    pub fn column(self, a: usize) -> &'static str {
        self.columns().map_or("", |c| c.name(a))
    }

    /// The columns of the readings.
    #[must_use]
    pub fn columns(self) -> Option<&'static Column> {
        columns::ALL.iter().find(|c| c.role == Role::Reading(self))
    }

    /// Name of a reading in a sentence.
    #[must_use]
    pub fn reading(self) -> &'static str {
        if self.is_sensor() {
            "temperature"
        } else {
            "frequency"
        }
    }

    /// `true` if temperatures of two axes can differ: each must have a thermometer of its own.
    #[must_use]
    pub fn parts_axes(self) -> bool {
        matches!(self, Self::Frequency | Self::Sensors)
    }
}

/// Refuses what the firmware cannot read: it has inputs for three resonators.
///
/// # Errors
/// A sentence that says what can be done with such a recording.
pub fn require_resonators(r: &crate::recording::Recording) -> Result<(), crate::error::BadInput> {
    if r.thermometer == Thermometer::Frequency && !r.absent.contains(&true) {
        return Ok(());
    }
    Err(crate::error::BadInput::new(
        "the recording has no three resonators, which is what the firmware reads its temperatures from; hrg correct computes on the desktop what a unit would send",
    ))
}

/// The axes of a recording in words: "x and y".
#[must_use]
pub fn named(present: [bool; AXES]) -> String {
    let names: Vec<String> = (0..AXES).filter(|&a| present[a]).map(|a| AXIS_NAMES[a].to_string()).collect();
    crate::error::list(&names)
}
