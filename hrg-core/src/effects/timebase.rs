//! `timebase`: what is common to all three frequencies in fractional terms and is not temperature, in ppm: the mean
//! over the axes of resonator temperature less that of the case behind its thermal lag. A clock that drifts
//! shifts all three resonators alike. Needs the case sensors. State: the three lagged case temperatures,
//! starting in equilibrium. Source: dong2023 Table 1, whose residuals are alike in all three gyros.
//!
//! The lag matters: a resonator is some 11 C behind its case on a ramp of 1 C per minute, a thousand times what a
//! clock that drifts by 0.1 ppm does.

use super::parameters::Lag;
use super::{lag_share, Effect, Inputs, Reach};
use crate::AXES;

/// Fractional frequency change of a fused-silica resonator, ppm per C: dong2023 Table 1, 42.3 Hz of 4901 Hz
/// over 89.5 C.
const PPM_PER_C: f32 = 96.4;

/// Common fractional deviation of the three frequencies from the lagged case temperatures; ppm.
#[derive(Debug, Clone)]
pub struct Timebase {
    share: f32,
    case_c: [f32; AXES],
}

impl Effect for Timebase {
    const NAME: &'static str = "timebase";
    const ID: u16 = 13;
    const REACH: Reach = Reach::NeedsChamber("case_?_c");

    type Parameters = Lag;
    type Regressors = [f32; 1];

    fn new(parameters: Lag, step_s: f32) -> Self {
        Self { share: lag_share(step_s, parameters.lag_s), case_c: [f32::NAN; AXES] }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let mut sum = 0.0;
        for axis in 0..AXES {
            let now = inputs.quantities.case_c(axis);
            let state = &mut self.case_c[axis];
            if state.is_nan() {
                *state = now;
            }
            if !now.is_nan() {
                *state += self.share * (now - *state);
            }
            sum += inputs.other_c(axis) - inputs.scaling.t_ref_c - *state;
        }
        [sum * (PPM_PER_C / AXES as f32)]
    }
}
