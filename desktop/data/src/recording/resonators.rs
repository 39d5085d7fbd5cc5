//! Axes that a recording has, and whether the firmware can read it.

use super::thermometer::Thermometer;
use crate::axes::AXIS_NAMES;
use hrg_core::AXES;

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
