//! `rate-saturation`: `tanh(r / r0)`, r = dT/dt: a gradient that no longer grows with the ramp. Stateless.

use super::{Effect, Inputs, Reach, MAX_PARAMETERS};

/// Saturating dT/dt.
#[derive(Debug, Clone)]
pub struct RateSaturation {
    per_ramp: f32,
}

impl Effect for RateSaturation {
    const NAME: &'static str = "rate-saturation";
    const ID: u16 = 37;
    const PARAMETERS: &'static [&'static str] = &["r0_c_per_min"];
    const REACH: Reach = Reach::Unit;

    type Regressors = [f32; 1];

    fn new(p: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self { per_ramp: if p[0] > 0.0 { 1.0 / p[0] } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [libm::tanhf(inputs.own().rate_c_per_min * self.per_ramp)]
    }
}
