//! `arrhenius-ladder`: as `lag-ladder`, with times that change with temperature as `exp(-beta (T - T_ref))`: a body whose conduction
//! or creep is faster when warm. `tau_max_s` is the longest at the reference; the shortest is 60 s. Steps by the implicit Euler
//! rule, stable for any time constant. State: the lagged temperatures, starting in equilibrium.
//! Source: Arrhenius' law about a reference temperature.

use super::bank::rung;
use super::parameters::Arrhenius;
use super::{Effect, Inputs, Reach, Span};
use crate::bias::clamp;

const RUNGS: usize = 9;
const SHORTEST_S: f32 = 60.0;

/// Lags of temperature with times that follow temperature, less temperature; C.
#[derive(Debug, Clone)]
pub struct ArrheniusLadder {
    per_tau: [f32; RUNGS],
    beta: f32,
    state_c: [f32; RUNGS],
}

impl Effect for ArrheniusLadder {
    const NAME: &'static str = "arrhenius-ladder";
    const ID: u16 = 22;
    const REACH: Reach = Reach::Unit;

    type Parameters = Arrhenius;
    type Regressors = [f32; RUNGS];

    fn new(p: Arrhenius, step_s: f32) -> Self {
        Self {
            per_tau: core::array::from_fn(|k| step_s / rung(SHORTEST_S, p.tau_max_s, k, RUNGS)),
            beta: p.beta_per_c,
            state_c: [f32::NAN; RUNGS],
        }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state_c
    }

    fn span(p: Arrhenius) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let t = inputs.own_c();
        if self.state_c[0].is_nan() {
            self.state_c = [t; RUNGS];
        }
        let faster = libm::expf(clamp(self.beta * (t - inputs.scaling.t_ref_c), -5.0, 5.0));
        let mut out = [0.0; RUNGS];
        for k in 0..RUNGS {
            let x = self.per_tau[k] * faster;
            self.state_c[k] += x / (1.0 + x) * (t - self.state_c[k]);
            out[k] = self.state_c[k] - t;
        }
        out
    }
}
