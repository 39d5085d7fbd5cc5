//! `temperature-step`: 0 below a temperature, 1 above it, with a smooth rise between: a joint that lets go, a mode that another one takes over, a phase
//! that changes. Stateless: heating and cooling pass it at the same temperature (where they do not, it is a [relay](super::relay)).

use super::parameters::Rise;
use super::{Effect, Inputs, Reach};
use crate::bias::clamp;

/// `s^2 (3 - 2 s)` with `s = 1/2 + (T - middle_c) / width_c`, from 0 to 1.
#[derive(Debug, Clone)]
pub struct TemperatureStep {
    middle_c: f32,
    per_c: f32,
}

impl Effect for TemperatureStep {
    const NAME: &'static str = "temperature-step";
    const ID: u16 = 43;
    const REACH: Reach = Reach::Unit;

    type Parameters = Rise;
    type Regressors = [f32; 1];

    fn new(p: Rise, _: f32) -> Self {
        Self { middle_c: p.middle_c, per_c: if p.width_c > 0.0 { 1.0 / p.width_c } else { 0.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let s = clamp(0.5 + (inputs.own_c() - self.middle_c) * self.per_c, 0.0, 1.0);
        [s * s * (3.0 - 2.0 * s)]
    }
}
