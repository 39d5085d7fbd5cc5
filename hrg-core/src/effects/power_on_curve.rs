//! `power-on-curve`: a piecewise-linear curve of the time since power-on, over fourteen knots from power-on to `until_s`, held at its last value beyond: a
//! heater or a loop that cuts in late, a settling that swings. What decays slowly or quickly is rather a [power-on-ladder](super::power_on_ladder). State:
//! none but that time.

use super::bank::hats;
use super::parameters::Until;
use super::{Effect, Inputs, Reach, Span};

/// Weights of the knots.
#[derive(Debug, Clone)]
pub struct PowerOnCurve {
    until_s: f32,
}

impl Effect for PowerOnCurve {
    const NAME: &'static str = "power-on-curve";
    const ID: u16 = 45;
    const COMMON: bool = true;
    const CURVE: bool = true;
    const REACH: Reach = Reach::Unit;

    type Parameters = Until;
    type Regressors = [f32; 14];

    fn new(p: Until, _: f32) -> Self {
        Self { until_s: p.until_s }
    }

    /// Three of these times lead to the last knot: behind it the curve is a constant.
    fn span(p: Until) -> Span {
        Span::Time(p.until_s / 3.0)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 14] {
        hats(inputs.thermal.time_s, 0.0, self.until_s)
    }
}
