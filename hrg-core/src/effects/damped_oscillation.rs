//! `damped-oscillation`: `exp(-2 pi damping t / period_s)` times the cosine and the sine of `2 pi t / period_s`, with `t` the time since power-on: a control loop that
//! settles with a swing after it was switched on. Stateless.

use super::parameters::Swing;
use super::{Effect, Inputs, Reach, Span};
use crate::math::single;

/// Cosine and sine of the time since power-on, decaying from 1 to 0.
#[derive(Debug, Clone)]
pub struct DampedOscillation {
    swing: Swing,
}

impl Effect for DampedOscillation {
    const NAME: &'static str = "damped-oscillation";
    const ID: u16 = 55;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unit;
    const MAY_AGREE: bool = true;

    type Parameters = Swing;
    type Regressors = [f32; 2];

    fn new(swing: Swing, _: f32) -> Self {
        Self { swing }
    }

    fn span(p: Swing) -> Span {
        Span::Time(p.period_s / (core::f32::consts::TAU * p.damping))
    }

    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let turns = inputs.thermal.time_s / self.swing.period_s;
        let left = libm::expf(-core::f32::consts::TAU * self.swing.damping * turns);
        let (sin, cos) = single::sin_cos(core::f32::consts::TAU * (turns - libm::floorf(turns)));
        [left * cos, left * sin]
    }
}
