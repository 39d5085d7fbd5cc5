//! `kink`: `max(T - Tc, 0) / t_scale`, a change of slope at `Tc`: an adhesive or solder that changes state, a
//! stop that comes into contact. Stateless. Source: wu2023's breakpoint `div_a`.

use super::parameters::Breakpoint;
use super::{Effect, Inputs, Reach};

/// A change of slope at `break_c`.
#[derive(Debug, Clone)]
pub struct Kink {
    break_c: f32,
}

impl Effect for Kink {
    const NAME: &'static str = "kink";
    const ID: u16 = 2;
    const REACH: Reach = Reach::Unit;

    type Parameters = Breakpoint;
    type Regressors = [f32; 1];

    fn new(parameters: Breakpoint, _: f32) -> Self {
        Self { break_c: parameters.break_c }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let above = inputs.own_c() - self.break_c;
        [if above > 0.0 { above / inputs.scaling.t_scale_c } else { 0.0 }]
    }
}
