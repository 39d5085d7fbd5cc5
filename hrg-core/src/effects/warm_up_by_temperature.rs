//! `warm-up-by-temperature`: `exp(-(t - power_on) / tau)` times 1, `u` and `u^2`, with `u` the normalised temperature, held at the ends of the calibrated range: a
//! slope of the bias that settles after power-on, or a thermometer whose error does (a clock that warms up): its error is a bias by that slope. State: none but
//! the time since power-on, which the unit counts.

use super::parameters::Tau;
use super::{Effect, Inputs, Reach, Span};

/// Exponential decay since power-on, times a parabola of temperature.
#[derive(Debug, Clone)]
pub struct WarmUpByTemperature {
    tau_s: f32,
}

impl Effect for WarmUpByTemperature {
    const NAME: &'static str = "warm-up-by-temperature";
    const ID: u16 = 54;
    const REACH: Reach = Reach::Unit;
    const MAY_AGREE: bool = true;

    type Parameters = Tau;
    type Regressors = [f32; 3];

    fn new(p: Tau, _: f32) -> Self {
        Self { tau_s: p.tau_s }
    }

    fn span(p: Tau) -> Span {
        Span::Time(p.tau_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 3] {
        let left = libm::expf(-inputs.thermal.time_s / self.tau_s);
        let u = inputs.own_u();
        [left, left * u, left * u * u]
    }
}
