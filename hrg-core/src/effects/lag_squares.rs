//! `lag-squares`: `d^2` and `d |d|` of the differences `d` between temperature and its lags, over the temperature scale of the model, for seven time constants
//! from `tau_min_s` to `tau_max_s`, evenly in the logarithm: stress that grows as the square of a gradient, gas that a gradient stirs, relaxations that heating and cooling
//! stir alike. State: the lags, starting in equilibrium.

use super::bank::shares;
use super::parameters::Taus;
use super::{Effect, Inputs, Reach, Span};

const RUNGS: usize = 7;

/// Squares of lags of temperature, less temperature, without and with the sign.
#[derive(Debug, Clone)]
pub struct LagSquares {
    share: [f32; RUNGS],
    state_c: [f32; RUNGS],
}

impl Effect for LagSquares {
    const NAME: &'static str = "lag-squares";
    const ID: u16 = 46;
    const REACH: Reach = Reach::Unit;
    const MAY_AGREE: bool = true;

    type Parameters = Taus;
    type Regressors = [f32; 2 * RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self {
            share: shares(p, step_s),
            state_c: [f32::NAN; RUNGS],
        }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state_c
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2 * RUNGS] {
        let t = inputs.own_c();
        if self.state_c[0].is_nan() {
            self.state_c = [t; RUNGS];
        }
        let mut out = [0.0; 2 * RUNGS];
        for k in 0..RUNGS {
            // (Without what `settle` keeps: the square of the last digit is nothing.)
            self.state_c[k] += self.share[k] * (t - self.state_c[k]);
            let d = (self.state_c[k] - t) / inputs.scaling.t_scale_c;
            out[k] = d * d;
            out[k + RUNGS] = d * d.abs();
        }
        out
    }
}
