//! Cost of a calibration image on the unit, as `hrg-board cost --json` prints it and `hrg compare` reads it.

use serde::{Deserialize, Serialize};

/// Cost of an image on the unit, as `hrg-board cost` counts it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// The calibration.
    pub calibration: String,
    /// Mean instructions of one update: three axes, frequencies to biases, windows and states included.
    pub update_instructions: f64,
    /// Mean instructions of the bias model of one axis alone.
    pub bias_instructions: f64,
    /// Mean instructions of turning one frequency into a temperature and a slope; zero where the model needs neither.
    pub curve_instructions: f64,
    /// Length of the block.
    pub bytes: usize,
    /// Frames that the ELF sent.
    pub frames: usize,
    /// Frames that differ from hrg-core on the desktop.
    pub differing: usize,
}
