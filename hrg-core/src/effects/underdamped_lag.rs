//! `underdamped-lag`: a second-order lag of temperature, less temperature: it swings about the new temperature with `period_s` and `damping` (of the critical one):
//! a mount whose heater is controlled, two bodies that a loop couples. Steps by the implicit Euler rule. State: its temperature, starting in equilibrium, and
//! its rate of change, starting at zero.

use super::parameters::Swing;
use super::{Effect, Inputs, Reach, Span};

/// Output of a second-order lag, less temperature; C.
#[derive(Debug, Clone)]
pub struct UnderdampedLag {
    /// Of the difference in temperature, the part that the speed gains in a step, C.
    pull: f32,
    /// The part of the speed that a step leaves.
    keep: f32,
    /// Temperature, C, and its change in a step, C.
    state: [f32; 2],
}

impl Effect for UnderdampedLag {
    const NAME: &'static str = "underdamped-lag";
    const ID: u16 = 48;
    const REACH: Reach = Reach::Unit;
    const MAY_AGREE: bool = true;

    type Parameters = Swing;
    type Regressors = [f32; 1];

    fn new(p: Swing, step_s: f32) -> Self {
        let angle = core::f32::consts::TAU * step_s / p.period_s;
        let keep = 1.0 / (1.0 + 2.0 * p.damping * angle + angle * angle);
        Self { pull: angle * angle * keep, keep, state: [f32::NAN, 0.0] }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state
    }

    fn soak_at(&mut self, temperature_c: f32) {
        self.state = [temperature_c, 0.0];
    }

    fn span(p: Swing) -> Span {
        Span::Time(p.period_s / (core::f32::consts::TAU * p.damping))
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        let [at, speed] = &mut self.state;
        if at.is_nan() {
            *at = t;
        }
        *speed = *speed * self.keep + (t - *at) * self.pull;
        *at += *speed;
        [*at - t]
    }
}
