//! `timebase`: what is common to all three frequencies in fractional terms and is not temperature: the mean
//! over the axes of resonator less shell temperature, in ppm of frequency. A clock that wanders shifts all
//! three resonators alike. Needs the shell sensors. Stateless.

use super::{one, Effect, Inputs, Reach, MAX_OUTPUTS, MAX_PARAMETERS};
use crate::AXES;

/// Fractional frequency change of a fused-silica resonator, ppm per C: dong2023 Table 1, 42.3 Hz of 4901 Hz
/// over 89.5 C.
const PPM_PER_C: f32 = 96.4;

/// Common fractional deviation of the three frequencies from the shell temperatures; ppm.
#[derive(Debug, Clone)]
pub struct Timebase;

impl Effect for Timebase {
    const NAME: &'static str = "timebase";
    const ID: u16 = 13;
    const PARAMETERS: &'static [&'static str] = &[];
    const OUTPUTS: usize = 1;
    const REACH: Reach = Reach::NeedsInput("shell_c");

    fn new(_: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; MAX_OUTPUTS] {
        let mut sum = 0.0;
        for axis in 0..AXES {
            sum += inputs.temperature_c[axis] - inputs.recorded.shell_c[axis];
        }
        one(sum * (PPM_PER_C / AXES as f32))
    }
}
