//! `periodic`: sine and cosine of a period: chamber compressor, a beat with a neighbour, a mains alias. Its
//! phase is not known to a unit, so it is named and taken out of a fit, not compensated. Stateless.

use super::parameters::Period;
use super::{Effect, Inputs, Reach};

/// Sine and cosine of time with period `period_s`.
#[derive(Debug, Clone)]
pub struct Periodic {
    period_s: f32,
}

impl Effect for Periodic {
    const NAME: &'static str = "periodic";
    const ID: u16 = 12;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unpredictable;

    type Parameters = Period;
    type Regressors = [f32; 2];

    fn new(parameters: Period, _: f32) -> Self {
        Self { period_s: if parameters.period_s > 0.0 { parameters.period_s } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let turns = inputs.thermal.time_s / self.period_s;
        let angle = core::f32::consts::TAU * (turns - libm::floorf(turns));
        [libm::sinf(angle), libm::cosf(angle)]
    }
}
