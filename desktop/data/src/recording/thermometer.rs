//! Thermometers of the axes of a recording: their resonators, or sensors.
//!
//! A resonator needs a curve from frequency to temperature. A sensor gives the temperature itself; the unit's code then runs with
//! the curve `T = T`, so that a unit with sensors is calibrated, corrected and judged by the same code as one with resonators.

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
