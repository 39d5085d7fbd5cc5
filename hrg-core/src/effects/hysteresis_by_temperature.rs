//! `hysteresis-by-temperature`: `play(T, width) - T` times 1, `u` and `u^2`, with `u` the normalised temperature, held at the ends of the calibrated range: a loop
//! whose height changes with temperature, as that of a joint whose friction or preload does. State: the output of the play, starting at the first temperature.

use super::hysteresis::Hysteresis;
use super::parameters::Width;
use super::{Effect, Inputs, Reach, Span};

/// Output of a play of full width `width_c`, less temperature, times a parabola of temperature; C.
#[derive(Debug, Clone)]
pub struct HysteresisByTemperature {
    one: Hysteresis,
}

impl Effect for HysteresisByTemperature {
    const NAME: &'static str = "hysteresis-by-temperature";
    const ID: u16 = 59;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;
    const MAY_AGREE: bool = true;

    type Parameters = Width;
    type Regressors = [f32; 3];

    fn new(p: Width, step_s: f32) -> Self {
        Self { one: Hysteresis::new(p, step_s) }
    }

    fn start_on(&mut self, branch: f32) {
        self.one.start_on(branch);
    }

    fn memory(&mut self) -> &mut [f32] {
        self.one.memory()
    }

    fn span(p: Width) -> Span {
        Hysteresis::span(p)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 3] {
        let [stroke] = self.one.step(inputs);
        let u = inputs.own_u();
        [stroke, stroke * u, stroke * u * u]
    }
}
