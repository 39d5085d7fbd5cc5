//! `periodic`: sine and cosine of a period: chamber compressor, a beat with a neighbour, a mains alias. Its
//! phase is not known to a unit, so it is named and taken out of a fit, not compensated. Stateless.

use super::{two, Effect, Inputs, Reach, MAX_OUTPUTS, MAX_PARAMETERS};

/// Sine and cosine of time with period `period_s`.
#[derive(Debug, Clone)]
pub struct Periodic {
    period_s: f32,
}

impl Effect for Periodic {
    const NAME: &'static str = "periodic";
    const ID: u16 = 12;
    const PARAMETERS: &'static [&'static str] = &["period_s"];
    const OUTPUTS: usize = 2;
    const REACH: Reach = Reach::Unpredictable;

    fn new(parameters: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self { period_s: if parameters[0] > 0.0 { parameters[0] } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; MAX_OUTPUTS] {
        let turns = inputs.time_s / self.period_s;
        let angle = core::f32::consts::TAU * (turns - libm::floorf(turns));
        two(libm::sinf(angle), libm::cosf(angle))
    }
}
