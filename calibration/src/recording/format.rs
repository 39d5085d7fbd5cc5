//! The columns of a recording: their names, and what the axes read their temperature from (their resonators, or sensors).
//!
//! A resonator needs a curve from frequency to temperature. A sensor gives the temperature itself; the unit's code then runs with
//! the curve `T = T`, so that a unit with sensors is calibrated, corrected and judged by the same code as one with resonators.

use crate::AXIS_NAMES;
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
    crate::list(&names)
}

/// Optional columns that are kept, by name.
pub const OPTIONAL: [&str; 12] = [
    "case_x_c",
    "case_y_c",
    "case_z_c",
    "chamber_c",
    "board_c",
    "supply_v",
    "drive_x_v",
    "drive_y_v",
    "drive_z_v",
    "quad_x_v",
    "quad_y_v",
    "quad_z_v",
];

/// What older files call some of them.
const FORMER: [(&str, &str); 3] = [("shell_x_c", "case_x_c"), ("shell_y_c", "case_y_c"), ("shell_z_c", "case_z_c")];

/// The name that a column has today.
#[must_use]
pub fn column_name(name: &str) -> &str {
    FORMER.iter().find(|(former, _)| *former == name).map_or(name, |(_, today)| today)
}

/// Columns of a unit's status.
pub(super) const STATUS: [&str; 4] = ["status_x", "status_y", "status_z", "status_unit"];

/// Beginnings of columns that a unit's recording has beside those that a fit uses.
pub(super) const FROM_UNIT: [&str; 5] = ["temperature_", "bias_", "status_", "raw_", "corrected_"];

/// Whether a column is one that some thermometer has.
pub(super) fn is_reading(name: &str) -> bool {
    [Thermometer::Frequency, Thermometer::Sensors, Thermometer::OneSensor]
        .iter()
        .any(|t| (0..AXES).any(|a| t.column(a) == name))
}
