//! `temperature-shape`: a smooth curve of temperature, Chebyshev polynomials of degree 3 to 10 on the calibrated
//! range, held constant outside. Stateless. The fallback for a residual that repeats in temperature but has
//! no named shape.

use super::parameters::TemperatureRange;
use super::{Effect, Inputs, Reach};
use crate::bias::clamp;

/// Chebyshev `T3..T10` of temperature scaled to -1..1 between `low_c` and `high_c`.
#[derive(Debug, Clone)]
pub struct TemperatureShape {
    centre_c: f32,
    half_c: f32,
}

impl Effect for TemperatureShape {
    const NAME: &'static str = "temperature-shape";
    const ID: u16 = 3;
    const REACH: Reach = Reach::Unit;

    type Parameters = TemperatureRange;
    type Regressors = [f32; 8];

    fn new(parameters: TemperatureRange, _: f32) -> Self {
        let half_c = 0.5 * (parameters.high_c - parameters.low_c);
        Self { centre_c: 0.5 * (parameters.low_c + parameters.high_c), half_c: if half_c > 0.0 { half_c } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 8] {
        let x = clamp((inputs.own_c() - self.centre_c) / self.half_c, -1.0, 1.0);
        let (mut before, mut this) = (x, 2.0 * x * x - 1.0);
        let mut out = [0.0; 8];
        for value in &mut out {
            let next = 2.0 * x * this - before;
            before = this;
            this = next;
            *value = next;
        }
        out
    }
}
