//! `periodic`: sine and cosine of a period: chamber compressor, a beat with a neighbour, a mains alias. Its
//! phase is not known to a unit, so it is named and taken out of a fit, not compensated. Stateless.

use super::{Effect, Inputs, Reach, MAX_PARAMETERS};

/// Sine and cosine of time with period `period_s`.
#[derive(Debug, Clone)]
pub struct Periodic {
    period_s: f32,
}

impl Effect for Periodic {
    const NAME: &'static str = "periodic";
    const ID: u16 = 12;
    const PARAMETERS: &'static [&'static str] = &["period_s"];
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unpredictable;

    type Regressors = [f32; 2];

    fn new(parameters: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self { period_s: if parameters[0] > 0.0 { parameters[0] } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let turns = inputs.thermal.time_s / self.period_s;
        let angle = core::f32::consts::TAU * (turns - libm::floorf(turns));
        [libm::sinf(angle), libm::cosf(angle)]
    }
}
