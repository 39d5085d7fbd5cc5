//! `ramp-square-lags`: `(dT/dt)^2` behind eight lags of `tau_min_s` to `tau_max_s`, evenly in the logarithm: creep, settling of glue or of a coating, which a fast ramp either
//! way stirs and which decays afterwards. State: the lagged squares, (C per minute)^2, starting at zero.

use super::bank::shares;
use super::parameters::Taus;
use super::{Effect, Inputs, Reach, Span};

const RUNGS: usize = 8;

/// Lags of the squared ramp; (C per minute)^2.
#[derive(Debug, Clone)]
pub struct RampSquareLags {
    share: [f32; RUNGS],
    state: [f32; RUNGS],
    /// Temperature of a soak from which the unit was brought to where it begins; NaN: it was there.
    soaked_c: f32,
}

impl Effect for RampSquareLags {
    const NAME: &'static str = "ramp-square-lags";
    const ID: u16 = 49;
    const REACH: Reach = Reach::Unit;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self {
            share: shares(p, step_s),
            state: [0.0; RUNGS],
            soaked_c: f32::NAN,
        }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state
    }

    fn soak_at(&mut self, temperature_c: f32) {
        self.soaked_c = temperature_c;
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        // The two pasts that bound all others: from a hot soak by the fastest ramp of the fit, for long; from a cold one too slowly to stir anything.
        let scaling = inputs.scaling;
        let soaked_c = core::mem::replace(&mut self.soaked_c, f32::NAN);
        if soaked_c > 0.5 * (scaling.linear_below_c + scaling.linear_above_c) {
            let fastest = scaling.linear_beyond_c_per_min;
            self.state = [fastest * fastest; RUNGS];
        }
        let ramp = inputs.own().ramp_c_per_min;
        for (state, share) in self.state.iter_mut().zip(&self.share) {
            *state += share * (ramp * ramp - *state);
        }
        self.state
    }
}
