//! `rate-curve`: a piecewise-linear curve of dT/dt over thirteen knots to `ramp_max_c_per_min` on either side, closer to each other
//! near zero (evenly in the root), held at its edges outside. Stateless.

use super::bank::hats;
use super::parameters::RampRange;
use super::{Effect, Inputs, Reach};
use crate::bias::clamp;

/// Weights of the knots.
#[derive(Debug, Clone)]
pub struct RateCurve {
    per_ramp: f32,
}

impl RateCurve {
    /// At a ramp, C per minute.
    #[inline]
    fn weights(&self, ramp_c_per_min: f32) -> [f32; 13] {
        let x = clamp(ramp_c_per_min * self.per_ramp, -1.0, 1.0);
        let root = libm::sqrtf(if x < 0.0 { -x } else { x });
        hats(if x < 0.0 { -root } else { root }, -1.0, 1.0)
    }
}

impl Effect for RateCurve {
    const NAME: &'static str = "rate-curve";
    const ID: u16 = 29;
    const REACH: Reach = Reach::Unit;

    type Parameters = RampRange;
    type Regressors = [f32; 13];

    fn new(p: RampRange, _: f32) -> Self {
        Self { per_ramp: if p.ramp_max_c_per_min > 0.0 { 1.0 / p.ramp_max_c_per_min } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 13] {
        self.weights(inputs.own().ramp_c_per_min)
    }
}

/// The same, times normalised temperature (held at the edges of the calibrated range).
#[derive(Debug, Clone)]
pub struct RateCurveByTemperature {
    curve: RateCurve,
}

impl Effect for RateCurveByTemperature {
    const NAME: &'static str = "rate-curve-by-temperature";
    const ID: u16 = 30;
    const REACH: Reach = Reach::Unit;

    type Parameters = RampRange;
    type Regressors = [f32; 13];

    fn new(p: RampRange, step_s: f32) -> Self {
        Self { curve: RateCurve::new(p, step_s) }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 13] {
        let u = inputs.own_u();
        self.curve.step(inputs).map(|x| u * x)
    }
}
