//! `temperature-spline`: a piecewise-linear curve of temperature over fourteen knots from `low_c` to `high_c`, held at its edges
//! outside. Stateless.

use super::bank::hats;
use super::parameters::TemperatureRange;
use super::{Effect, Inputs, Reach};

/// Weights of the knots.
#[derive(Debug, Clone)]
pub struct TemperatureSpline {
    low_c: f32,
    high_c: f32,
}

impl Effect for TemperatureSpline {
    const NAME: &'static str = "temperature-spline";
    const ID: u16 = 27;
    const REACH: Reach = Reach::Unit;

    type Parameters = TemperatureRange;
    type Regressors = [f32; 14];

    fn new(p: TemperatureRange, _: f32) -> Self {
        Self { low_c: p.low_c, high_c: p.high_c }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 14] {
        hats(inputs.own_c(), self.low_c, self.high_c)
    }
}
