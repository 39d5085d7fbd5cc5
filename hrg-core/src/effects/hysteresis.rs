//! `hysteresis`: `play(T, width) - T`: the bias follows temperature through a slack of `width`, as a joint with
//! friction does. State: the output of the play operator, starting at the first temperature.
//! Source: play operator (Krasnosel'skii and Pokrovskii 1989), the element of Prandtl-Ishlinskii models.

use super::parameters::Width;
use super::{Effect, Inputs, Reach, Span};
use crate::bias::clamp;

/// Output of a play of full width `width_c`, less temperature; C.
#[derive(Debug, Clone)]
pub struct Hysteresis {
    half_c: f32,
    start: f32,
    state_c: f32,
}

impl Effect for Hysteresis {
    const NAME: &'static str = "hysteresis";
    const ID: u16 = 6;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = Width;
    type Regressors = [f32; 1];

    fn new(parameters: Width, _: f32) -> Self {
        Self { half_c: 0.5 * parameters.width_c, start: 0.0, state_c: f32::NAN }
    }

    fn start_on(&mut self, branch: f32) {
        self.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.state_c)
    }

    fn span(p: Width) -> Span {
        Span::Range(p.width_c)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        if self.state_c.is_nan() {
            self.state_c = t + self.start * self.half_c;
        }
        self.state_c = clamp(self.state_c, t - self.half_c, t + self.half_c);
        [self.state_c - t]
    }
}
