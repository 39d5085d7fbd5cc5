//! `heating-lags`: a leaky sum of what the temperature has risen, for eight times from `tau_min_s` to `tau_max_s`: relaxations that
//! only heating stirs up. (Cooling alone is the lag of both less this one.) State: the sums, starting at zero.

use super::bank::shares;
use super::parameters::Taus;
use super::{Effect, Inputs, Reach, Span};

const RUNGS: usize = 8;

/// Leaky sums of heating; C.
#[derive(Debug, Clone)]
pub struct HeatingLags {
    share: [f32; RUNGS],
    sum_c: [f32; RUNGS],
    step_min: f32,
    /// Temperature of a soak from which the unit was heated or cooled at once to where it begins; NaN: it was there.
    soaked_c: f32,
}

impl Effect for HeatingLags {
    const NAME: &'static str = "heating-lags";
    const ID: u16 = 21;
    const REACH: Reach = Reach::Unit;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self {
            share: shares(p, step_s),
            sum_c: [0.0; RUNGS],
            step_min: step_s / 60.0,
            soaked_c: f32::NAN,
        }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.sum_c
    }

    fn soak_at(&mut self, temperature_c: f32) {
        self.soaked_c = temperature_c;
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let rate = inputs.own().ramp_c_per_min;
        let mut risen = if rate > 0.0 { rate * self.step_min } else { 0.0 };
        let since_soak = inputs.own_c() - core::mem::replace(&mut self.soaked_c, f32::NAN);
        if since_soak > 0.0 {
            risen += since_soak;
        }
        for k in 0..RUNGS {
            self.sum_c[k] += risen - self.share[k] * self.sum_c[k];
        }
        self.sum_c
    }
}
