//! `warm-up`: `exp(-(t - power_on) / tau)`: electronics or the resonator's own heat settling after power-on.
//! State: none but the time since power-on, which the unit counts.

use super::parameters::Tau;
use super::{Effect, Inputs, Reach, Span};

/// Exponential decay since power-on, 1 to 0.
#[derive(Debug, Clone)]
pub struct WarmUp {
    tau_s: f32,
}

impl Effect for WarmUp {
    const NAME: &'static str = "warm-up";
    const ID: u16 = 9;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unit;

    type Parameters = Tau;
    type Regressors = [f32; 1];

    fn new(parameters: Tau, _: f32) -> Self {
        Self { tau_s: if parameters.tau_s > 0.0 { parameters.tau_s } else { 1.0 } }
    }

    fn span(p: Tau) -> Span {
        Span::Time(p.tau_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [libm::expf(-inputs.thermal.time_s / self.tau_s)]
    }
}
