//! Shared parts of the effects: geometric ladders of times and widths, piecewise-linear curves over knots, a smooth rise, and the play operator.

use super::lag_share;
use super::parameters::Taus;
use crate::bias::clamp;

/// Rung `k` of `n` between `low` and `high`, evenly in the logarithm; `low` where there is nothing between.
pub fn rung(low: f32, high: f32, k: usize, n: usize) -> f32 {
    let ratio = if high > low && low > 0.0 { high / low } else { 1.0 };
    low * libm::expf(libm::logf(ratio) * k as f32 / (n - 1) as f32)
}

/// Shares of the way that `N` lags go in `step_s`, whose times are evenly in the logarithm.
#[inline]
pub fn shares<const N: usize>(taus: Taus, step_s: f32) -> [f32; N] {
    core::array::from_fn(|k| lag_share(step_s, rung(taus.tau_min_s, taus.tau_max_s, k, N)))
}

/// Weights of `N` knots evenly over `low..high` at `x`: two neighbours share one; beyond the ends the last knot has it all, so
/// that a curve continues as its edge is.
#[inline]
pub fn hats<const N: usize>(x: f32, low: f32, high: f32) -> [f32; N] {
    let mut out = [0.0; N];
    let (k, part) = cell::<N>(x, low, high);
    out[k] = 1.0 - part;
    out[k + 1] = part;
    out
}

/// The knot at or below `x` (at most the last but one), and how far `x` is on the way to the next, 0 to 1.
#[inline]
pub fn cell<const N: usize>(x: f32, low: f32, high: f32) -> (usize, f32) {
    let span = if high > low { high - low } else { 1.0 };
    let at = clamp((x - low) / span, 0.0, 1.0) * (N - 1) as f32;
    // (NaN is no number of a knot: it becomes the first.)
    let k = (at as usize).min(N - 2);
    (k, at - k as f32)
}

/// A smooth rise from 0 to 1: `s^2 (3 - 2 s)` with `s = 1/2 + (x - middle) / width`, 0 below and 1 above.
#[derive(Debug, Clone)]
pub struct SmoothRise {
    middle: f32,
    slope: f32,
}

impl SmoothRise {
    /// With its middle and its width; without a width it is 1/2 everywhere.
    pub fn new(middle: f32, width: f32) -> Self {
        Self { middle, slope: if width > 0.0 { 1.0 / width } else { 0.0 } }
    }

    /// Its value at `x`.
    #[inline]
    pub fn at(&self, x: f32) -> f32 {
        let s = clamp(0.5 + (x - self.middle) * self.slope, 0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    }
}

/// The play operator: its output lies within half a width of the temperature, and moves only where it must.
#[derive(Debug, Clone)]
pub struct Play {
    half_c: f32,
    /// Place between both ends at the first temperature: see [`Effect::start_on`](super::Effect::start_on).
    pub start: f32,
    /// The output, C; NaN before the first temperature.
    pub state_c: f32,
}

impl Play {
    /// Of a full width, C.
    pub fn new(width_c: f32) -> Self {
        Self { half_c: 0.5 * width_c, start: 0.0, state_c: f32::NAN }
    }

    /// Changes its full width, C.
    #[inline]
    pub fn widen(&mut self, width_c: f32) {
        self.half_c = 0.5 * width_c;
    }

    /// Its output at the next temperature, C.
    #[inline]
    pub fn follow(&mut self, t: f32) -> f32 {
        if self.state_c.is_nan() {
            self.state_c = t + self.start * self.half_c;
        }
        self.state_c = clamp(self.state_c, t - self.half_c, t + self.half_c);
        self.state_c
    }
}
