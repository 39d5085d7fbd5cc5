//! `ripple`: sine and cosine of temperature with a period of `period_c`: interference, a mode that passes others. Stateless.

use super::parameters::Cycle;
use super::{Effect, Inputs, Reach};
use crate::math::single;

/// `sin` and `cos` of `2 pi T / period_c`.
#[derive(Debug, Clone)]
pub struct Ripple {
    per_c: f32,
}

impl Effect for Ripple {
    const NAME: &'static str = "ripple";
    const ID: u16 = 28;
    const REACH: Reach = Reach::Unit;

    type Parameters = Cycle;
    type Regressors = [f32; 2];

    fn new(p: Cycle, _: f32) -> Self {
        Self { per_c: if p.period_c > 0.0 { 1.0 / p.period_c } else { 0.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let turns = inputs.own_c() * self.per_c;
        let (sin, cos) = single::sin_cos(core::f32::consts::TAU * (turns - libm::floorf(turns)));
        [sin, cos]
    }
}
