//! `lag-ladder`: `lag(T, tau_k) - T` for nine times from `tau_min_s` to `tau_max_s`, evenly in the logarithm. Any linear thermal
//! memory is a sum of such lags: several poles, diffusion, a spectrum of time constants. State: the lagged temperatures,
//! starting in equilibrium with the first one. Source: expansion of a relaxation in a discrete spectrum (Prony series).

use super::bank::shares;
use super::parameters::Taus;
use super::{settle, Effect, Inputs, Reach, Span};

/// Lags of the ladder.
pub const RUNGS: usize = 9;

/// Lags of temperature, less temperature; C.
#[derive(Debug, Clone)]
pub struct LagLadder {
    share: [f32; RUNGS],
    state_c: [f32; RUNGS],
    /// The part of the last step that was too small for the states.
    rest_c: [f32; RUNGS],
}

impl Effect for LagLadder {
    const NAME: &'static str = "lag-ladder";
    const ID: u16 = 19;
    const REACH: Reach = Reach::Unit;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self {
            share: shares(p, step_s),
            state_c: [f32::NAN; RUNGS],
            rest_c: [0.0; RUNGS],
        }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state_c
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    // (Two effects step it, and each would hold a copy.)
    #[inline(never)]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let t = inputs.own_c();
        if self.state_c[0].is_nan() {
            self.state_c = [t; RUNGS];
        }
        let mut out = [0.0; RUNGS];
        for k in 0..RUNGS {
            settle(&mut self.state_c[k], &mut self.rest_c[k], self.share[k], t);
            out[k] = self.state_c[k] - t;
        }
        out
    }
}
