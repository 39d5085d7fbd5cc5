//! What the axes of a recording read their temperature from: their resonators, or sensors.
//!
//! A resonator needs a law from frequency to temperature. A sensor gives the temperature itself; the unit's code then runs with
//! the law `T = T`, so that a unit with sensors is calibrated, corrected and judged by the same code as one with resonators.

use crate::AXIS_NAMES;
use hrg_core::temperature::TemperatureLaw;
use hrg_core::AXES;

/// Where the temperatures of a recording come from.
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
    /// Whether readings are temperatures.
    #[must_use]
    pub fn is_sensor(self) -> bool {
        matches!(self, Self::Sensors | Self::OneSensor)
    }

    /// The column of an axis' readings.
    #[must_use]
    pub fn column(self, a: usize) -> String {
        match self {
            Self::Frequency => format!("f{}_hz", AXIS_NAMES[a]),
            Self::Sensors => format!("temp_{}_c", AXIS_NAMES[a]),
            Self::OneSensor => "temp_c".into(),
            Self::None => String::new(),
        }
    }

    /// What a reading is called in a sentence.
    #[must_use]
    pub fn reading(self) -> &'static str {
        if self.is_sensor() {
            "temperature"
        } else {
            "frequency"
        }
    }

    /// Whether temperatures of two axes can differ: each must have a thermometer of its own.
    #[must_use]
    pub fn parts_axes(self) -> bool {
        matches!(self, Self::Frequency | Self::Sensors)
    }

    /// Digits after the point with which a reading is written.
    pub(crate) fn digits(self) -> usize {
        if self.is_sensor() {
            5
        } else {
            7
        }
    }
}

/// The law of a sensor that has read from `low_c` to `high_c`: a reading is a temperature.
#[must_use]
pub fn sensor_law(low_c: f64, high_c: f64) -> TemperatureLaw {
    // The centre is a number that single precision holds, so that the law gives back what it is given.
    let centre = (0.5 * (low_c + high_c)).round() as f32;
    let scale = (0.5 * (high_c - low_c)).ceil().max(1.0) as f32;
    TemperatureLaw {
        f0_hz: f64::from(centre),
        scale_hz: scale,
        c: [centre, scale, 0.0, 0.0],
        min_c: low_c as f32,
        max_c: high_c as f32,
    }
}

/// Refuses what the firmware cannot read: it has inputs for three resonators.
///
/// # Errors
/// A sentence that says what can be done with such a recording.
pub fn require_resonators(r: &crate::recording::Recording) -> Result<(), crate::BadInput> {
    if r.thermometer == Thermometer::Frequency && !r.absent.contains(&true) {
        return Ok(());
    }
    Err(crate::BadInput::new(
        "the recording has no three resonators, which is what the firmware reads its temperatures from; hrg correct computes on the desktop what a unit would send",
    ))
}

/// The axes of a recording in words: "x and y".
#[must_use]
pub fn named(present: [bool; AXES]) -> String {
    let names: Vec<String> = (0..AXES).filter(|&a| present[a]).map(|a| AXIS_NAMES[a].to_string()).collect();
    crate::trace::list(&names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_of_a_sensor_gives_back_what_it_reads() {
        let law = sensor_law(-17.63, 74.1);
        assert!(law.is_of_sensor() && (law.min_c, law.max_c) == (-17.63, 74.1));
        for k in 0..=1000 {
            let t = -17.63 + 0.0917 * f64::from(k);
            assert!((f64::from(law.temperature_c(t)) - t).abs() < 1e-5, "{t}");
        }
        assert!((law.slope_c_per_hz(20.0) - 1.0).abs() < 1e-6);
        let resonator = hrg_core::calibration::Calibration::uncalibrated().axes[0].law;
        assert!(!resonator.is_of_sensor());
    }
}
