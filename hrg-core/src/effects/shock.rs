//! `shock`: `exp(-(t - time_s) / tau_s)` from a time on, and beside it a step at that time: the gyro was bumped and recovers, in part
//! or in full. No unit can predict it; it is taken out of a fit so that it does not bend the other coefficients. Stateless.

use super::parameters::Pulse;
use super::{Effect, Inputs, Reach};

/// A jump at `time_s` that decays with `tau_s`, and the part of it that stays.
#[derive(Debug, Clone)]
pub struct Shock {
    time_s: f32,
    tau_s: f32,
}

impl Effect for Shock {
    const NAME: &'static str = "shock";
    const ID: u16 = 41;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unpredictable;

    type Parameters = Pulse;
    type Regressors = [f32; 2];

    fn new(parameters: Pulse, _: f32) -> Self {
        Self { time_s: parameters.time_s, tau_s: if parameters.tau_s > 0.0 { parameters.tau_s } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let since_s = inputs.thermal.time_s - self.time_s;
        if since_s >= 0.0 {
            [libm::expf(-since_s / self.tau_s), 1.0]
        } else {
            [0.0; 2]
        }
    }
}
