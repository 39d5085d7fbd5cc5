//! `step`: 0 before a time, 1 from it on: something came loose, was switched, or was bumped. No unit can
//! predict it; it is taken out of a fit so that it does not bend the other coefficients. Stateless.

use super::parameters::Moment;
use super::{Effect, Inputs, Reach};

/// A jump at `time_s`.
#[derive(Debug, Clone)]
pub struct Step {
    time_s: f32,
}

impl Effect for Step {
    const NAME: &'static str = "step";
    const ID: u16 = 11;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unpredictable;

    type Parameters = Moment;
    type Regressors = [f32; 1];

    fn new(parameters: Moment, _: f32) -> Self {
        Self { time_s: parameters.time_s }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [if inputs.thermal.time_s >= self.time_s { 1.0 } else { 0.0 }]
    }
}
